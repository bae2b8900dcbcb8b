//! The motion of the base that forces along the measured path give.

use super::carriage::{Carriage, Path, rotated};
use super::laws::{Cell, Laws};
use crate::memo::{Memo, are_geared_alike, are_pushed_alike};
use crate::path::{EncoderPath, PosePath, TimeGrid};
use fss_multibody::ModelError;
use fss_plant::{BaseMotion, Effect, Grid, JointSample, Physics, Plant, Rollout, ValveHistory};
use std::ops::Range;
use std::sync::Arc;

pub(super) struct Predictor {
    pub(super) pose: PosePath,
    pub(super) encoders: EncoderPath,
    pub(super) valves: ValveHistory,
    paths: Memo<Path>,
    carriages: Memo<Carriage>,
    thrusts: Memo<Vec<[f64; 3]>>,
}

/// A predicted motion at the edges of the grid.
#[derive(Clone)]
pub(super) struct Motion {
    pub(super) physics: Physics,
    pub(super) grid: TimeGrid,
    /// Predicted pose of the base.
    pub(super) pose: Vec<[f64; 3]>,
    pub(super) rate: Vec<f64>,
    /// The markers from the base's origin, table axes (m).
    marker_m: Vec<[f64; 2]>,
}

impl Predictor {
    pub(super) fn new(pose: PosePath, encoders: EncoderPath, valves: ValveHistory) -> Self {
        Self { pose, encoders, valves, paths: Memo::new(), carriages: Memo::new(), thrusts: Memo::new() }
    }

    pub(super) fn path(&self, physics: &Physics) -> Arc<Path> {
        let same = |a: &Physics, b: &Physics| {
            let (a, b) = (&a.sensors, &b.sensors);
            a.mocap_delay_s == b.mocap_delay_s
                && a.mocap_rotation_rad == b.mocap_rotation_rad
                && a.marker_offset_m == b.marker_offset_m
                && a.marker_yaw_rad == b.marker_yaw_rad
                && a.clock_offset_s == b.clock_offset_s
        };
        let make = || {
            let (pose, velocity) = self.pose.unread(physics);
            Ok::<_, std::convert::Infallible>(Path::new(pose, velocity))
        };
        match self.paths.get(physics, same, make) {
            Ok(path) => path,
            Err(never) => match never {},
        }
    }

    pub(super) fn carriage(&self, physics: &Physics) -> Result<Arc<Carriage>, ModelError> {
        let same = |a: &Physics, b: &Physics| {
            a.base == b.base
                && a.links == b.links
                && are_geared_alike(a, b)
                && a.payload_kg == b.payload_kg
                && a.grasped == b.grasped
                && a.sensors.link_delay_s == b.sensors.link_delay_s
                && a.sensors.clock_offset_s == b.sensors.clock_offset_s
        };
        self.carriages.get(physics, same, || Carriage::new(physics, &self.encoders, self.pose.grid.step_s))
    }

    pub(super) fn thrust(
        &self,
        plant: &Plant,
        effects: &[Effect],
        physics: &Physics,
        carriage: &Carriage,
    ) -> Result<Arc<Vec<[f64; 3]>>, ModelError> {
        let grid = self.pose.grid;
        let same = |a: &Physics, b: &Physics| {
            are_pushed_alike(a, b) && !a.thrusters.iter().chain(&b.thrusters).any(|t| t.plume_fraction > 0.0)
        };
        let thrust = || {
            let rollout = Rollout::with(plant, effects)?;
            let cells = Grid { start_s: grid.start_s, step_s: grid.step_s, steps: grid.cells };
            // One sample for the middle of each cell, where the rollout wants two a step.
            let joints: Vec<JointSample> = carriage.samples.iter().flat_map(|s| [*s, *s]).collect();
            Ok(rollout.thrust(&self.valves, &cells, &joints))
        };
        // With an onset, thrusters may be others later.
        let is_steady = Physics::stages(plant, effects).iter().all(|(_, stage)| are_pushed_alike(stage, physics));
        if is_steady { self.thrusts.get(physics, same, thrust) } else { thrust().map(Arc::new) }
    }

    /// Lets the next motion asked for be the one that is kept.
    pub(super) fn forget(&self) {
        self.paths.forget();
        self.carriages.forget();
        self.thrusts.forget();
    }

    /// What begins in the course of the run does so at the edge next to its onset; sensors are from the start what they become.
    pub(super) fn motion(&self, plant: &Plant, effects: &[Effect]) -> Result<Motion, ModelError> {
        let physics = Physics::with(plant, effects);
        let path = self.path(&physics);
        let thrust = self.thrust(plant, effects, &physics, &*self.carriage(&physics)?)?;
        let grid = self.pose.grid;
        let stages = Physics::stages(plant, effects);
        let first = |stage: usize| match stages.get(stage) {
            Some((onset_s, _)) => grid.nearest(*onset_s),
            None => grid.cells,
        };
        let (mut pose, mut rate) = (Vec::with_capacity(grid.cells + 1), Vec::with_capacity(grid.cells + 1));
        let mut state = BaseState { pose: path.pose[0], velocity: path.velocity[0] };
        for (stage, (_, physics)) in stages.iter().enumerate() {
            let cells = if stage == 0 { 0 } else { first(stage) }..first(stage + 1);
            if cells.is_empty() {
                continue;
            }
            let carriage = self.carriage(physics)?;
            let laws = Laws::new(physics, (&carriage, &self.pose, &path), cells.start);
            let parts = (&*path, &*carriage, thrust.as_slice());
            state = integrate(physics, (grid, cells), parts, laws, (state, &mut pose, &mut rate));
        }
        pose.push(state.pose);
        rate.push(state.velocity[2]);
        let [mx, my] = physics.sensors.marker_offset_m;
        let marker_m = path.turn.iter().map(|turn| rotated(*turn, [mx, my])).collect();
        Ok(Motion { physics, grid, pose, rate, marker_m })
    }
}

/// Pose and velocity of the base, table axes.
struct BaseState {
    pose: [f64; 3],
    velocity: [f64; 3],
}

/// Momentum from forces, pose and rate from momentum, at the first edges of the cells from a state there; returns that at the last edge.
fn integrate(
    physics: &Physics,
    (grid, cells): (TimeGrid, Range<usize>),
    (path, carriage, thrust): (&Path, &Carriage, &[[f64; 3]]),
    mut laws: Laws,
    (from, poses, rates): (BaseState, &mut Vec<[f64; 3]>, &mut Vec<f64>),
) -> BaseState {
    let dt = grid.step_s;
    let com: Vec<[f64; 2]> = path.turn.iter().zip(&carriage.com_m).map(|(turn, c)| rotated(*turn, *c)).collect();
    let drift = |k: usize, i: usize| (com[k.min(grid.cells - 1) + 1][i] - com[k.min(grid.cells - 1)][i]) / dt;
    let inertia = &carriage.inertia_kg_m2;
    let Range { start, end } = cells;
    let mut place: [f64; 2] = std::array::from_fn(|i| from.pose[i] + com[start][i]);
    let mut speed: [f64; 2] = std::array::from_fn(|i| from.velocity[i] + drift(start, i));
    let mut momentum = inertia[start] * from.velocity[2] + carriage.joint_momentum[start];
    let mut theta = from.pose[2];
    let rate = |momentum: f64, k: usize| (momentum - carriage.joint_momentum[k]) / inertia[k];
    for k in cells {
        poses.push([place[0] - com[k][0], place[1] - com[k][1], theta]);
        rates.push(rate(momentum, k));
        let middle = |a: f64, b: f64| 0.5 * (a + b);
        let pose: [f64; 3] = std::array::from_fn(|i| middle(path.pose[k][i], path.pose[k + 1][i]));
        let velocity: [f64; 3] = std::array::from_fn(|i| middle(path.velocity[k][i], path.velocity[k + 1][i]));
        let arm: [f64; 2] = std::array::from_fn(|i| middle(com[k][i], com[k + 1][i]));
        let [fx, fy] = rotated(path.mean_turn[k], [thrust[k][0], thrust[k][1]]);
        let mut wrench = [fx, fy, thrust[k][2]];
        if !physics.base_laws.is_empty() {
            let motion = BaseMotion { t_s: grid.edge_s(k) + 0.5 * dt, pose, velocity };
            let inertia_kg_m2 = middle(inertia[k], inertia[k + 1]);
            let law = laws.wrench(k, &Cell { motion, wrench, com_m: arm, inertia_kg_m2 });
            wrench.iter_mut().zip(law).for_each(|(w, l)| *w += l);
        }
        let torque = wrench[2] - (arm[0] * wrench[1] - arm[1] * wrench[0]);
        for i in 0..2 {
            let acceleration = wrench[i] / carriage.mass_kg + physics.gravity_m_s2[i];
            place[i] += dt * (speed[i] + 0.5 * dt * acceleration);
            speed[i] += dt * acceleration;
        }
        let turning = momentum + 0.5 * dt * torque - carriage.mean_joint_momentum[k];
        theta += dt * turning / middle(inertia[k], inertia[k + 1]);
        momentum += dt * torque;
    }
    let [vx, vy] = std::array::from_fn(|i| speed[i] - drift(end, i));
    let pose = [place[0] - com[end][0], place[1] - com[end][1], theta];
    BaseState { pose, velocity: [vx, vy, rate(momentum, end)] }
}

impl Motion {
    fn between(&self, t_s: f64) -> (usize, f64) {
        let (k, into_s) = self.grid.locate(t_s);
        (k, into_s / self.grid.step_s)
    }

    /// What motion capture reads of the base at a time, linear between edges and beyond them.
    pub(super) fn pose_reading(&self, t_s: f64) -> [f64; 3] {
        let (k, share) = self.between(t_s);
        let mix = |a: f64, b: f64| a + share * (b - a);
        let [x, y, theta]: [f64; 3] = std::array::from_fn(|i| mix(self.pose[k][i], self.pose[k + 1][i]));
        let marker: [f64; 2] = std::array::from_fn(|i| mix(self.marker_m[k][i], self.marker_m[k + 1][i]));
        let sensors = &self.physics.sensors;
        sensors.pose_reading([x + marker[0], y + marker[1], theta + sensors.marker_yaw_rad])
    }

    /// Rate of the base at a time (rad/s).
    pub(super) fn rate(&self, t_s: f64) -> f64 {
        let (k, share) = self.between(t_s);
        self.rate[k] + share * (self.rate[k + 1] - self.rate[k])
    }
}
