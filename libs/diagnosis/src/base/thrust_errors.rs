//! What errors of the thrust, in proportion to it, do to the base.
//!
//! No thruster repeats itself: pressure, a valve's play and a propeller's speed differ from pulse to pulse. Each thruster's force is
//! F (1 + s e) with its own Ornstein-Uhlenbeck process e of unit variance; where nothing thrusts, nothing is off.

use super::carriage::{Carriage, Path, rotated};
use super::prediction::Predictor;
use fss_multibody::ModelError;
use fss_plant::{Effect, Grid, Physics, Plant, Rollout};

/// The thrusts along a run.
#[derive(Clone)]
pub(super) struct ThrustErrors {
    /// Of each step from a block to the next, the mean force of each thruster along x and y (table axes, N) and its mean moment
    /// about the centre of mass (N m).
    steps: Vec<Vec<[f64; 3]>>,
    /// How many thrusters push at all.
    count: usize,
}

impl ThrustErrors {
    /// Of a plant with these effects: errors act where and when the thrust does.
    pub(super) fn new(
        (plant, effects): (&Plant, &[Effect]),
        predictor: &Predictor,
        (path, carriage): (&Path, &Carriage),
        times: &[f64],
    ) -> Result<Self, ModelError> {
        let grid = predictor.pose.grid;
        let cells = Grid { start_s: grid.start_s, step_s: grid.step_s, steps: grid.cells };
        let forces = Rollout::with(plant, effects)?.thruster_forces(&predictor.valves, &cells);
        let thrusters = Physics::with(plant, effects).thrusters;
        let pushing: Vec<_> =
            forces.iter().zip(&thrusters).filter(|(force, _)| force.iter().any(|f| *f != 0.0)).collect();
        let mean = |(force, thruster): &(&Vec<f64>, &fss_plant::ThrusterPhysics), from_s: f64, to_s: f64| {
            let [ux, uy, about_origin] = thruster.unit_wrench();
            let mut sum = [0.0; 3];
            for k in grid.locate(from_s).0..=grid.locate(to_s).0 {
                let within_s = (grid.edge_s(k + 1).min(to_s) - grid.edge_s(k).max(from_s)).max(0.0);
                let [fx, fy] = rotated(path.turn[k], [ux, uy]);
                let [cx, cy] = carriage.com_m[k];
                let along = [fx, fy, about_origin - (cx * uy - cy * ux)];
                sum.iter_mut().zip(along).for_each(|(s, a)| *s += within_s / (to_s - from_s) * force[k] * a);
            }
            sum
        };
        let of_step = |t: &[f64]| pushing.iter().map(|thruster| mean(thruster, t[0], t[1])).collect();
        Ok(Self { steps: times.windows(2).map(of_step).collect(), count: pushing.len() })
    }

    /// Number of states: a thruster each.
    pub(super) fn states(&self) -> usize {
        self.count
    }

    /// What each thruster's process of unit variance gives in a step: a share of the thruster's wrench.
    pub(super) fn wrenches(&self, step: usize, share: f64) -> impl Iterator<Item = [f64; 3]> {
        self.steps[step].iter().map(move |wrench| wrench.map(|w| share * w))
    }
}
