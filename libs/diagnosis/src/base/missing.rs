//! The motion without one pulse of a thruster.
//!
//! Along a measured path the prediction is linear in forces: what a pulse does not push changes the motion by its own integrals.
//! The thrust is computed anew only in the cells that the pulse reaches.

use super::carriage::{Carriage, Path, rotated};
use super::prediction::{Motion, Predictor};
use fss_multibody::ModelError;
use fss_plant::{Effect, Grid, JointSample, Physics, Plant, Pulse, Rollout, Stream, ThrusterPhysics};
use std::ops::Range;

/// A lag leaves 2e-9 of a level after so many time constants.
const SETTLED_AFTER: f64 = 20.0;

impl Predictor {
    /// Each pulse that acts on the grid, with the rows of the prediction without it less those of the prediction with it.
    pub(super) fn missing_pulses(
        &self,
        plant: &Plant,
        effects: &[Effect],
        read: impl Fn(&Motion) -> Vec<f64>,
    ) -> Result<Vec<(Pulse, Vec<f64>)>, ModelError> {
        let physics = Physics::with(plant, effects);
        let (path, carriage) = (self.path(&physics), self.carriage(&physics)?);
        let delivered = self.thrust(plant, effects, &physics, &carriage)?;
        let rollout = Rollout::with(plant, effects)?;
        let motion = self.motion(plant, effects)?;
        let rows = read(&motion);
        let grid = self.pose.grid;
        let mut out = Vec::new();
        for pulse in self.valves.pulses() {
            let reached = self.reached(&physics, &pulse);
            let cells = Grid { start_s: grid.edge_s(reached.start), step_s: grid.step_s, steps: reached.len() };
            // One sample for the middle of each cell, where the rollout wants two a step.
            let joints: Vec<JointSample> = carriage.samples[reached.clone()].iter().flat_map(|s| [*s, *s]).collect();
            let thrust = rollout.thrust(&self.valves.without(&pulse), &cells, &joints);
            let lack = |(now, before): (&[f64; 3], &[f64; 3])| std::array::from_fn(|i| now[i] - before[i]);
            let lacking: Vec<[f64; 3]> = thrust.iter().zip(&delivered[reached.clone()]).map(lack).collect();
            if lacking.iter().flatten().all(|force| *force == 0.0) {
                continue;
            }
            let without = read(&changed(&motion, (&path, &carriage), reached.start, &lacking));
            out.push((pulse, without.iter().zip(&rows).map(|(without, with)| without - with).collect()));
        }
        Ok(out)
    }

    /// Cells in which a pulse may act: from its command until its thruster has settled after it.
    fn reached(&self, physics: &Physics, pulse: &Pulse) -> Range<usize> {
        let early_s = physics.sensors.clock_offset_s[Stream::Valves as usize];
        let of = |t: &ThrusterPhysics| t.delay_s + t.min_on_s + SETTLED_AFTER * t.rise_s.max(t.fall_s);
        let settling_s = physics.thrusters.iter().map(of).fold(0.0, f64::max);
        let grid = &self.pose.grid;
        let cells = |t_s: f64| ((t_s - grid.start_s) / grid.step_s).clamp(0.0, grid.cells as f64);
        let first = cells(pulse.from_s - early_s).floor() as usize;
        first..cells(pulse.to_s - early_s + settling_s).ceil() as usize
    }
}

/// A motion with additional thrust in the cells from `first` on: base axes, about the base's origin (N, N, N m).
fn changed(motion: &Motion, (path, carriage): (&Path, &Carriage), first: usize, additional: &[[f64; 3]]) -> Motion {
    let mut out = motion.clone();
    let (dt, inertia) = (motion.grid.step_s, &carriage.inertia_kg_m2);
    let middle = |a: f64, b: f64| 0.5 * (a + b);
    let com = |k: usize| rotated(path.pose[k][2].sin_cos(), carriage.com_m[k]);
    let (mut place, mut speed, mut theta, mut momentum) = ([0.0; 2], [0.0; 2], 0.0, 0.0);
    for k in first..motion.grid.cells {
        let (mut acceleration, mut torque) = ([0.0; 2], 0.0);
        if let Some([fx, fy, about_origin]) = additional.get(k - first) {
            let heading = middle(path.pose[k][2], path.pose[k + 1][2]);
            let [fx, fy] = rotated(heading.sin_cos(), [*fx, *fy]);
            let (from, to) = (com(k), com(k + 1));
            torque = about_origin - (middle(from[0], to[0]) * fy - middle(from[1], to[1]) * fx);
            acceleration = [fx / carriage.mass_kg, fy / carriage.mass_kg];
        }
        for i in 0..2 {
            place[i] += dt * (speed[i] + 0.5 * dt * acceleration[i]);
            speed[i] += dt * acceleration[i];
        }
        theta += dt * (momentum + 0.5 * dt * torque) / middle(inertia[k], inertia[k + 1]);
        momentum += dt * torque;
        let pose = &mut out.pose[k + 1];
        *pose = [pose[0] + place[0], pose[1] + place[1], pose[2] + theta];
        out.rate[k + 1] += momentum / inertia[k + 1];
    }
    out
}
