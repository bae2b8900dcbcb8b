//! The equations of motion of base, arm and drives.

use fss_multibody::{Coordinates, JointVector, Model, ModelError, Prescribed, State};

use crate::check::MAX_LINKS;
use crate::physics::{BaseMotion, JointPhysics, Physics};

/// What moves: base, joints, and the rotors of elastic drives.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion {
    /// Base frame and joints.
    pub(crate) state: State,
    /// Rotor angles as seen at the joint (rad).
    pub(crate) rotor_rad: [f64; MAX_LINKS],
    /// Rotor rates as seen at the joint (rad/s).
    pub(crate) rotor_rad_s: [f64; MAX_LINKS],
}

/// What drives the motion and stays the same through a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Load {
    /// Real motor torques at the joints (N m).
    pub(crate) motor_n_m: [f64; MAX_LINKS],
    /// Thrust on the base, base axes, about the base frame's origin (N, N, N m).
    pub(crate) thrust: [f64; 3],
    /// Room air and plumes on the coordinates.
    pub(crate) steady: Coordinates,
}

/// The plant at one stage of a run, ready to integrate.
#[derive(Debug, Clone)]
pub(crate) struct Dynamics {
    pub(crate) physics: Physics,
    pub(crate) model: Model,
    /// Number of joints.
    pub(crate) joints: usize,
    /// Whether any rotor moves on its own.
    pub(crate) is_elastic: bool,
}

/// Accelerations of a [`Motion`], and what causes them from outside.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rates {
    pub(crate) joints: Coordinates,
    pub(crate) rotors: [f64; MAX_LINKS],
    /// Forces beside gravity and the rigid drives.
    pub(crate) outside: Coordinates,
}

/// Sliding direction of each drive, -1 or 1; 0 is at rest.
pub(crate) type Sliding = [f64; MAX_LINKS];

impl Dynamics {
    pub(crate) fn new(physics: Physics) -> Result<Self, ModelError> {
        Ok(Self {
            model: physics.model(0.0)?,
            joints: physics.joints.len(),
            is_elastic: physics.joints.iter().any(JointPhysics::is_elastic),
            physics,
        })
    }

    /// Makes the base lighter by the gas that has left it.
    pub(crate) fn set_used_gas(&mut self, used_kg: f64) {
        if let Ok(model) = self.physics.model(used_kg) {
            self.model = model;
        }
    }

    /// Accelerations where drives slide as `sliding` says.
    #[inline]
    pub(crate) fn rates(&self, motion: &Motion, t_s: f64, load: &Load, sliding: &Sliding) -> Rates {
        let mut outside = self.outside_forces(motion, t_s, load);
        let mut force = outside;
        let mut rotors = [0.0; MAX_LINKS];
        for (i, joint) in self.physics.joints.iter().enumerate() {
            let at_rest = joint.friction.is_dry() && sliding[i] == 0.0;
            if joint.is_elastic() {
                let torque = self.wind_up_torque(i, motion);
                let passed_on = torque * joint.gear_ratio(motion.state.q[3 + i]);
                force[3 + i] += passed_on;
                outside[3 + i] += passed_on;
                if !at_rest {
                    let rub = joint.friction.sliding_n_m(sliding[i], motion.rotor_rad_s[i]);
                    let inertia = self.physics.servos[i].rotor_inertia_kg_m2;
                    rotors[i] = (load.motor_n_m[i] - rub - torque) / inertia;
                }
            } else if !at_rest {
                force[3 + i] += load.motor_n_m[i] * joint.gear_ratio(motion.state.q[3 + i])
                    - joint.friction.sliding_n_m(sliding[i], motion.state.v[3 + i]);
            }
        }
        let state = &motion.state;
        let joints = match self.resting(sliding) {
            None => self.model.forward_dynamics(state, &force),
            Some(resting) if resting[..self.joints].iter().all(Option::is_some) => {
                let base = force.fixed_rows::<3>(0).into_owned();
                self.model.prescribed_dynamics(state, &JointVector::zeros(), &base)
            }
            Some(resting) => self.model.hybrid_accelerations(state, &force, &resting),
        };
        Rates { joints, rotors, outside }
    }

    /// Rigid joints at rest, which do not accelerate; `None` where there are none.
    pub(crate) fn resting(&self, sliding: &Sliding) -> Option<Prescribed> {
        let mut resting = Prescribed::default();
        let mut any = false;
        for (i, joint) in self.physics.joints.iter().enumerate() {
            if joint.friction.is_dry() && sliding[i] == 0.0 && !joint.is_elastic() {
                resting[i] = Some(0.0);
                any = true;
            }
        }
        any.then_some(resting)
    }

    /// Thrust, air, effects, stops.
    #[inline]
    fn outside_forces(&self, motion: &Motion, t_s: f64, load: &Load) -> Coordinates {
        let (q, v) = (&motion.state.q, &motion.state.v);
        let mut force = load.steady;
        let [fx, fy, torque] = load.thrust;
        if load.thrust != [0.0; 3] {
            let (sin, cos) = q[2].sin_cos();
            force[0] += cos * fx - sin * fy;
            force[1] += sin * fx + cos * fy;
            force[2] += torque;
        }
        if !self.physics.base_laws.is_empty() {
            let base = BaseMotion { t_s, pose: [q[0], q[1], q[2]], velocity: [v[0], v[1], v[2]] };
            let wrench = self.physics.base_wrench(&base);
            for i in 0..3 {
                force[i] += wrench[i];
            }
        }
        for law in &self.physics.joint_laws {
            let i = 3 + law.joint;
            force[i] += (law.law)(&law.values, t_s, q[i], v[i]);
        }
        for (i, joint) in self.physics.joints.iter().enumerate() {
            let beyond = q[3 + i].abs() - joint.limit_rad;
            if beyond > 0.0 {
                let (servo, side) = (&self.physics.servos[i], q[3 + i].signum());
                let push = servo.stop_stiffness_n_m_rad * beyond + servo.stop_damping_n_m_s_rad * v[3 + i] * side;
                // A stop pushes back and never pulls.
                force[3 + i] -= push.max(0.0) * side;
            }
        }
        force
    }

    /// Torque of an elastic drive on its rotor, and by the gear on its link: a spring with play and some damping (N m).
    pub(crate) fn wind_up_torque(&self, i: usize, motion: &Motion) -> f64 {
        let (joint, servo) = (&self.physics.joints[i], &self.physics.servos[i]);
        let q = motion.state.q[3 + i];
        let stiffness = self.drive_stiffness(i);
        let wind_up = motion.rotor_rad[i] - joint.motor_angle(q);
        let play = 0.5 * joint.backlash_rad;
        let engaged = wind_up - wind_up.clamp(-play, play);
        if engaged == 0.0 && play > 0.0 {
            return 0.0;
        }
        let damping = 2.0 * servo.gear_damping_ratio * (stiffness * servo.rotor_inertia_kg_m2).sqrt();
        let rate = motion.rotor_rad_s[i] - motion.state.v[3 + i] * joint.gear_ratio(q);
        let torque = stiffness * engaged + damping * rate;
        if play > 0.0 && torque * engaged < 0.0 {
            // Teeth push and never pull.
            return 0.0;
        }
        torque
    }

    fn drive_stiffness(&self, i: usize) -> f64 {
        self.physics.joints[i].stiffness_n_m_rad.unwrap_or(self.physics.servos[i].gear_stiffness_n_m_rad)
    }

    /// Torque that each drive passes on to its link, as the sensor behind the gear feels it (N m).
    pub(crate) fn drive_torques(&self, motion: &Motion, t_s: f64, load: &Load) -> [f64; MAX_LINKS] {
        let mut torque = [0.0; MAX_LINKS];
        let (_, rates) = self.sliding(motion, t_s, load, 0);
        let needed = self.needed_torques(motion, &rates);
        for (i, joint) in self.physics.joints.iter().enumerate() {
            let q = motion.state.q[3 + i];
            torque[i] =
                if joint.is_elastic() { self.wind_up_torque(i, motion) * joint.gear_ratio(q) } else { needed[3 + i] };
        }
        torque
    }

    /// Torques that the rigid drives pass on for the motion to be what it is.
    pub(crate) fn needed_torques(&self, motion: &Motion, rates: &Rates) -> Coordinates {
        self.model.inverse_dynamics(&motion.state, &rates.joints) - rates.outside
    }

    /// Angle and rate of drive `i`'s motor as seen at the joint (rad, rad/s).
    pub(crate) fn motor(&self, i: usize, motion: &Motion) -> (f64, f64) {
        let joint = &self.physics.joints[i];
        if joint.is_elastic() {
            return (motion.rotor_rad[i], motion.rotor_rad_s[i]);
        }
        let (q, qd) = (motion.state.q[3 + i], motion.state.v[3 + i]);
        (joint.motor_angle(q), qd * joint.gear_ratio(q))
    }

    /// Puts rotors where they hold the joints without torque.
    pub(crate) fn align_rotors(&self, motion: &mut Motion) {
        for (i, joint) in self.physics.joints.iter().enumerate() {
            let (q, qd) = (motion.state.q[3 + i], motion.state.v[3 + i]);
            motion.rotor_rad[i] = joint.motor_angle(q);
            motion.rotor_rad_s[i] = qd * joint.gear_ratio(q);
        }
    }

    /// Longest step that the stiffest elastic drive allows (s).
    pub(crate) fn longest_step_s(&self) -> f64 {
        let mut longest = f64::INFINITY;
        for (i, joint) in self.physics.joints.iter().enumerate() {
            if joint.is_elastic() {
                let inertia = self.physics.servos[i].rotor_inertia_kg_m2;
                longest = longest.min(0.7 * (inertia / self.drive_stiffness(i)).sqrt());
            }
        }
        longest
    }
}

impl JointPhysics {
    /// Whether the rotor moves on its own.
    pub fn is_elastic(&self) -> bool {
        self.stiffness_n_m_rad.is_some() || self.backlash_rad > 0.0
    }

    /// Motor angle, seen at the joint, that holds joint angle `q_rad` without wind-up (rad).
    pub fn motor_angle(&self, q_rad: f64) -> f64 {
        q_rad - self.kinematic_error_rad * (self.kinematic_cycles * q_rad).sin()
    }

    /// Motor rate per joint rate, which is also joint torque per motor torque.
    pub fn gear_ratio(&self, q_rad: f64) -> f64 {
        if self.kinematic_error_rad == 0.0 {
            return 1.0;
        }
        let cycles = self.kinematic_cycles;
        1.0 - self.kinematic_error_rad * cycles * (cycles * q_rad).cos()
    }
}

impl JointPhysics {
    /// What the encoder shows at this motor angle (rad).
    pub fn encoder_reading(&self, motor_rad: f64) -> f64 {
        self.encoder_scale * motor_rad + self.encoder_offset_rad
    }

    /// What the torque sensor says to this torque (N m).
    pub fn torque_reading(&self, torque_n_m: f64) -> f64 {
        self.torque_sensor_scale * torque_n_m + self.torque_sensor_bias_n_m
    }
}

impl Motion {
    /// Everything at zero, at rest.
    pub(crate) fn zero() -> Self {
        Self { state: State::zero(), rotor_rad: [0.0; MAX_LINKS], rotor_rad_s: [0.0; MAX_LINKS] }
    }
}

impl Load {
    /// Nothing drives.
    pub(crate) fn zero() -> Self {
        Self { motor_n_m: [0.0; MAX_LINKS], thrust: [0.0; 3], steady: Coordinates::zeros() }
    }
}
