//! Force of a thruster, on the base and, by its plume, on the arm.

use fss_multibody::{Coordinates, Model};

use crate::dynamics::{Dynamics, Load, Motion};
use crate::physics::{SupplyPhysics, ThrusterPhysics};
use crate::valves::powers;

/// Half angle of a plume's cone (rad).
const PLUME_HALF_ANGLE_RAD: f64 = 0.4;
/// Beyond this a plume is too thin to push (m).
const PLUME_REACH_M: f64 = 1.0;

impl SupplyPhysics {
    /// Thrust at `t_s` over thrust before the trend began.
    pub fn trend(&self, t_s: f64) -> f64 {
        let since = (t_s - self.trend_since_s).max(0.0);
        (1.0 + self.trend_per_s * since).max(0.0)
    }
}

impl ThrusterPhysics {
    /// Thrust at level 1 with all others shut and a full tank (N).
    pub fn thrust_n(&self) -> f64 {
        self.curve_n.iter().sum()
    }

    /// Force at this level, a valve's opening, where all levels add up to `level_sum` (N).
    ///
    /// A leak is there as far as the level is below 1.
    pub fn force_n(&self, level: f64, level_sum: f64, supply: &SupplyPhysics) -> f64 {
        self.mean_force_n(powers(level), level_sum, supply)
    }

    /// Mean force over a time in which the level, its square and its cube have these means (N), where all mean levels add
    /// up to `level_sum`. Exact but for the droop, which takes the others at their means.
    pub(crate) fn mean_force_n(&self, mean: [f64; 3], level_sum: f64, supply: &SupplyPhysics) -> f64 {
        let others = (level_sum - mean[0]).max(0.0);
        let droop = (1.0 - supply.droop_per_extra_valve * others).max(0.0);
        let [c1, c2, c3] = self.curve_n.map(|c| droop * c);
        c1 * mean[0] + c2 * mean[1] + c3 * mean[2] + self.leak_n * (1.0 - mean[0])
    }

    /// Force and torque on the base for one newton, base axes, about the base frame's origin (-, -, m).
    pub fn unit_wrench(&self) -> [f64; 3] {
        let (sin, cos) = self.direction_rad.sin_cos();
        [cos, sin, self.position_m[0] * sin - self.position_m[1] * cos]
    }
}

/// Adds a thruster's force to the load of a step.
pub(crate) fn push(load: &mut Load, thruster: &ThrusterPhysics, force_n: f64, dynamics: &Dynamics, motion: &Motion) {
    if force_n == 0.0 {
        return;
    }
    let unit = thruster.unit_wrench();
    for (sum, u) in load.thrust.iter_mut().zip(unit) {
        *sum += force_n * u;
    }
    let (model, q) = (&dynamics.model, &motion.state.q);
    if let Some(hit) = plume_hit(thruster, model, q) {
        push_arm(load, &hit, force_n, model, q);
    }
}

/// A link that a plume hits.
pub(crate) struct Hit {
    /// Which link, from 1.
    pub(crate) link: usize,
    /// Its centre of mass, where the plume pushes, table frame (m).
    pub(crate) at_m: [f64; 2],
    /// Push for one newton of thrust, table axes.
    pub(crate) push: [f64; 2],
}

/// The nearest link along the arm whose centre of mass lies in the thruster's plume, if any.
pub(crate) fn plume_hit(thruster: &ThrusterPhysics, model: &Model, q: &Coordinates) -> Option<Hit> {
    if thruster.plume_fraction <= 0.0 {
        return None;
    }
    let kinematics = model.kinematics(q);
    let (sin, cos) = q[2].sin_cos();
    let [px, py] = thruster.position_m;
    let nozzle = [q[0] + cos * px - sin * py, q[1] + sin * px + cos * py];
    let (dy, dx) = (q[2] + thruster.direction_rad).sin_cos();
    for link in 1..=model.link_count() {
        let com = kinematics.com[link];
        let to_link = [com.x - nozzle[0], com.y - nozzle[1]];
        let along = -(to_link[0] * dx + to_link[1] * dy);
        let across = to_link[0] * dy - to_link[1] * dx;
        if along <= 0.0 || along > PLUME_REACH_M {
            continue;
        }
        let off_axis = across.atan2(along).abs() / PLUME_HALF_ANGLE_RAD;
        if off_axis < 1.0 {
            // Full on the axis, nothing at the cone's edge, smooth between.
            let share = -thruster.plume_fraction * (1.0 - off_axis * off_axis).powi(2);
            return Some(Hit { link, at_m: [com.x, com.y], push: [share * dx, share * dy] });
        }
    }
    None
}

fn push_arm(load: &mut Load, hit: &Hit, force_n: f64, model: &Model, q: &Coordinates) {
    let body = &model.links()[hit.link - 1];
    let at = [body.length_m - body.com_to_next_joint_m, body.com_offset_m];
    let jacobian = model.point_jacobian(q, hit.link, at);
    for i in 0..model.dof() {
        load.steady[i] += force_n * (jacobian[(0, i)] * hit.push[0] + jacobian[(1, i)] * hit.push[1]);
    }
}
