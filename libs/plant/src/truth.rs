//! What is really so at one time, and how long it is remembered.

use crate::check::MAX_LINKS;
use crate::dynamics::{Dynamics, Load, Motion};
use crate::physics::{Physics, Stream};

/// The true state of the laboratory at one time. Joint arrays hold as many values as the plant has
/// joints, then zeros.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Time since the start of the run (s).
    pub t_s: f64,
    /// Base frame in the table frame (m, m, rad).
    pub base_pose: [f64; 3],
    /// Its velocity (m/s, m/s, rad/s).
    pub base_velocity: [f64; 3],
    /// End-effector frame in the table frame; the base frame's for a base without arm.
    pub ee_pose: [f64; 3],
    /// Its velocity.
    pub ee_velocity: [f64; 3],
    /// Target body in the table frame; zeros without one.
    pub target_pose: [f64; 3],
    /// Its velocity.
    pub target_velocity: [f64; 3],
    /// Joint angles without encoder errors (rad).
    pub q_rad: [f64; MAX_LINKS],
    /// Joint rates (rad/s).
    pub qd_rad_s: [f64; MAX_LINKS],
    /// Motor angles as seen at the joints, where the encoders are (rad).
    pub motor_rad: [f64; MAX_LINKS],
    /// Motor rates as seen at the joints (rad/s).
    pub motor_rad_s: [f64; MAX_LINKS],
    /// Motor currents (A).
    pub current_a: [f64; MAX_LINKS],
    /// Torques that the drives pass on, where the torque sensors are (N m).
    pub torque_n_m: [f64; MAX_LINKS],
}

/// What the truth at one time follows from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moment {
    pub(crate) t_s: f64,
    /// Stage of the run, whose dynamics held.
    pub(crate) stage: usize,
    pub(crate) motion: Motion,
    pub(crate) load: Load,
    pub(crate) current_a: [f64; MAX_LINKS],
    /// Pose and velocity of the target.
    pub(crate) target: ([f64; 3], [f64; 3]),
}

impl Truth {
    pub(crate) fn of(moment: &Moment, dynamics: &Dynamics) -> Self {
        let (t_s, motion, load) = (moment.t_s, &moment.motion, &moment.load);
        let (q, v) = (&motion.state.q, &motion.state.v);
        let links = dynamics.joints;
        let base_pose = [q[0], q[1], q[2]];
        let base_velocity = [v[0], v[1], v[2]];
        let (ee_pose, ee_velocity) = if links == 0 {
            (base_pose, base_velocity)
        } else {
            let pose = dynamics.model.end_effector(q);
            let twist = dynamics.model.jacobian(q) * v;
            ([pose.x, pose.y, pose.z], [twist.x, twist.y, twist.z])
        };
        let (target_pose, target_velocity) = moment.target;
        let mut truth = Self {
            t_s,
            base_pose,
            base_velocity,
            ee_pose,
            ee_velocity,
            target_pose,
            target_velocity,
            q_rad: [0.0; MAX_LINKS],
            qd_rad_s: [0.0; MAX_LINKS],
            motor_rad: [0.0; MAX_LINKS],
            motor_rad_s: [0.0; MAX_LINKS],
            current_a: moment.current_a,
            torque_n_m: dynamics.drive_torques(motion, t_s, load),
        };
        truth.q_rad[..links].copy_from_slice(&q.as_slice()[3..3 + links]);
        truth.qd_rad_s[..links].copy_from_slice(&v.as_slice()[3..3 + links]);
        for i in 0..links {
            (truth.motor_rad[i], truth.motor_rad_s[i]) = dynamics.motor(i, motion);
        }
        truth
    }

    /// Linear between this truth and a later one, `share` of the way.
    pub(crate) fn toward(&self, later: &Self, share: f64) -> Self {
        let mix = |a: f64, b: f64| a + share * (b - a);
        let mix3 = |a: &[f64; 3], b: &[f64; 3]| std::array::from_fn(|i| mix(a[i], b[i]));
        let mix_joints = |a: &[f64; MAX_LINKS], b: &[f64; MAX_LINKS]| std::array::from_fn(|i| mix(a[i], b[i]));
        Self {
            t_s: mix(self.t_s, later.t_s),
            base_pose: mix3(&self.base_pose, &later.base_pose),
            base_velocity: mix3(&self.base_velocity, &later.base_velocity),
            ee_pose: mix3(&self.ee_pose, &later.ee_pose),
            ee_velocity: mix3(&self.ee_velocity, &later.ee_velocity),
            target_pose: mix3(&self.target_pose, &later.target_pose),
            target_velocity: mix3(&self.target_velocity, &later.target_velocity),
            q_rad: mix_joints(&self.q_rad, &later.q_rad),
            qd_rad_s: mix_joints(&self.qd_rad_s, &later.qd_rad_s),
            motor_rad: mix_joints(&self.motor_rad, &later.motor_rad),
            motor_rad_s: mix_joints(&self.motor_rad_s, &later.motor_rad_s),
            current_a: mix_joints(&self.current_a, &later.current_a),
            torque_n_m: mix_joints(&self.torque_n_m, &later.torque_n_m),
        }
    }
}

/// Age of the oldest sample that any sensor gives (s).
pub(crate) fn oldest_sample_s(physics: &Physics) -> f64 {
    let sensors = &physics.sensors;
    let streams = [Stream::BasePose, Stream::EePose, Stream::TargetPose, Stream::Gyro];
    let ages = streams.iter().map(|s| sensors.age_s(*s));
    let links = (0..physics.links.len()).map(|i| sensors.link_age_s(i));
    ages.chain(links).fold(0.0, f64::max)
}

/// The last moments, one for each internal step; a ring that is filled once and then overwritten.
#[derive(Debug, Clone)]
pub(crate) struct History {
    ring: Vec<Moment>,
    capacity: usize,
    next: usize,
}

impl History {
    /// Room for `span_s` of internal steps and some more.
    pub(crate) fn new(span_s: f64, step_s: f64) -> Self {
        let capacity = (span_s / step_s).ceil() as usize + 64;
        Self { ring: Vec::with_capacity(capacity), capacity, next: 0 }
    }

    pub(crate) fn clear(&mut self) {
        self.ring.clear();
        self.next = 0;
    }

    pub(crate) fn push(&mut self, moment: &Moment) {
        if self.ring.len() < self.capacity {
            self.ring.push(*moment);
        } else {
            self.ring[self.next] = *moment;
        }
        self.next = (self.next + 1) % self.capacity;
    }

    /// The moments that `t_s` lies between, earlier and later; twice the same at a moment or beyond the ends.
    pub(crate) fn around(&self, t_s: f64) -> Option<(&Moment, &Moment)> {
        let mut later = self.back(0)?;
        for i in 1..self.ring.len() {
            if t_s >= later.t_s {
                break;
            }
            let earlier = self.back(i)?;
            if earlier.t_s <= t_s {
                return Some((earlier, later));
            }
            later = earlier;
        }
        Some((later, later))
    }

    /// The `back`-th moment before the last.
    fn back(&self, back: usize) -> Option<&Moment> {
        let len = self.ring.len();
        self.ring.get((self.next + 2 * len - 1 - back).checked_rem(len)?)
    }
}
