//! The gripper at the arm's end, and the handle on the target's rim that it takes.
//!
//! A magnet: closed, it takes the handle as soon as that is within millimetres and nearly at rest before it, and holds it
//! rigidly (a plastic impact, `Simulation::grasp`); opened, it lets go.

use fss_messages::TruthState;
use fss_plant::{Simulation, Target};
use std::f64::consts::PI;

/// The handle must be as near as this (m),
pub const GRIPPER_REACH_M: f64 = 0.003;
/// pass the gripper no faster than this (m/s),
pub const GRIPPER_SPEED_M_S: f64 = 0.01;
/// and face it within this angle (rad).
const ANGLE_RAD: f64 = 0.35;

/// A gripper and what it took.
#[derive(Debug, Clone)]
pub(crate) struct Gripper {
    mass_kg: f64,
    inertia_kg_m2: f64,
    radius_m: f64,
    taken: Option<Taken>,
    holds: bool,
}

/// How the target was taken.
#[derive(Debug, Clone, Copy)]
struct Taken {
    at_ns: u64,
    miss_m: f64,
    speed_m_s: f64,
    before: [f64; 3],
    after: [f64; 3],
}

impl Gripper {
    /// For this target, whose handle is on its rim at the body's angle 0.
    pub(crate) fn new(target: &Target) -> Self {
        let Target { mass_kg, inertia_kg_m2, radius_m, .. } = *target;
        Self { mass_kg, inertia_kg_m2, radius_m, taken: None, holds: false }
    }

    /// Closes or opens at `now_ns`.
    pub(crate) fn step(&mut self, now_ns: u64, closed: bool, simulation: &mut Simulation) {
        if self.holds {
            if !closed {
                simulation.release();
                self.holds = false;
            }
            return;
        }
        if !closed {
            return;
        }
        let Some((miss_m, speed_m_s)) = self.within_reach(simulation) else { return };
        let before = self.momentum(simulation, true);
        if simulation.grasp().is_ok() {
            let after = self.momentum(simulation, false);
            self.taken = Some(Taken { at_ns: now_ns, miss_m, speed_m_s, before, after });
            self.holds = true;
        }
    }

    /// Distance and speed of the end-effector from the handle, where they let the gripper take it.
    fn within_reach(&self, simulation: &Simulation) -> Option<(f64, f64)> {
        let truth = simulation.truth();
        let ([x, y, theta], [vx, vy, omega]) = (truth.target_pose, truth.target_velocity);
        let (sin, cos) = theta.sin_cos();
        let arm = [self.radius_m * cos, self.radius_m * sin];
        let miss_m = (truth.ee_pose[0] - x - arm[0]).hypot(truth.ee_pose[1] - y - arm[1]);
        if miss_m > GRIPPER_REACH_M {
            return None;
        }
        let facing = truth.ee_pose[2] - theta - PI;
        let tip = truth.ee_velocity;
        let speed_m_s = (tip[0] - vx + omega * arm[1]).hypot(tip[1] - vy - omega * arm[0]);
        let faces = (facing - 2.0 * PI * (facing / (2.0 * PI)).round()).abs() <= ANGLE_RAD;
        (faces && speed_m_s <= GRIPPER_SPEED_M_S).then_some((miss_m, speed_m_s))
    }

    /// Momentum of everything that floats: kg m/s, kg m/s and kg m2/s about the table's middle.
    fn momentum(&self, simulation: &Simulation, target_is_free: bool) -> [f64; 3] {
        let mut sum = simulation.momentum();
        if target_is_free {
            let truth = simulation.truth();
            let ([x, y, _], [vx, vy, omega]) = (truth.target_pose, truth.target_velocity);
            sum[0] += self.mass_kg * vx;
            sum[1] += self.mass_kg * vy;
            sum[2] += self.mass_kg * (x * vy - y * vx) + self.inertia_kg_m2 * omega;
        }
        sum
    }

    /// Adds what it knows to the truth.
    pub(crate) fn tell(&self, truth: &mut TruthState) {
        truth.target_held = u64::from(self.holds);
        if let Some(taken) = self.taken {
            truth.grasp_ns = taken.at_ns;
            (truth.grasp_miss_m, truth.grasp_speed_m_s) = (taken.miss_m, taken.speed_m_s);
            (truth.grasp_momentum_before, truth.grasp_momentum_after) = (taken.before, taken.after);
        }
    }
}
