//! A clamped arm: joints are simulated from their measured state.
//!
//! A measured state is as noisy as its sensors, and the motion carries that on: an encoder that tells angles to 0.2 mrad and
//! rates to 10 mrad/s leaves a free link 10 mrad off after a second, whatever the plant. What noise alone would give counts that
//! too, found by simulating from states that are one standard deviation off, one after the other.

use super::{ChannelMisfit, Gathered};
use crate::clamped::{drive, wander};
use fss_experiments::measured::{Joints, Run};
use fss_multibody::ModelError;
use fss_plant::{Plant, Simulation};
use std::ops::Range;

/// The misfit of joint angles and rates.
pub(super) fn misfit(plant: &Plant, run: &Run, window_s: f64) -> Result<Vec<ChannelMisfit>, ModelError> {
    let Some(joints) = &run.joints else { return Ok(Vec::new()) };
    let n = plant.link_count();
    if joints.q_rad.len() < n || joints.qd_rad_s.len() < n {
        return Ok(Vec::new()); // without angles and rates there is no state to begin from
    }
    let simulation = Simulation::new(plant, 0)?;
    let mut gathered: Vec<Gathered> = (0..2 * n).map(|_| Gathered::default()).collect();
    let mut start = 0;
    while start + 1 < joints.t_s.len() {
        let end = joints.t_s.partition_point(|t| *t - joints.t_s[start] < window_s).min(joints.t_s.len() - 1);
        let window = start..end.max(start + 1);
        Window { plant, run, joints, samples: window.clone(), simulation: &simulation }.gather(&mut gathered);
        start = window.end;
    }
    let name = |i: usize| if i < n { format!("q{}", i + 1) } else { format!("qd{}", i - n + 1) };
    let named = gathered.into_iter().enumerate();
    Ok(named.filter_map(|(i, channel)| channel.finish(&run.name, &name(i))).collect())
}

/// Samples from one at which the state is measured to the next one.
struct Window<'a> {
    plant: &'a Plant,
    run: &'a Run,
    joints: &'a Joints,
    samples: Range<usize>,
    simulation: &'a Simulation,
}

impl Window<'_> {
    /// Adds measured less simulated, with the variance that noise alone gives.
    fn gather(&self, gathered: &mut [Gathered]) {
        let (n, joints) = (gathered.len() / 2, self.joints);
        let sd = [self.plant.sensors.encoder_rad, self.plant.sensors.encoder_rate_rad_s];
        let measured = |i: usize, k: usize| if i < n { joints.q_rad[i][k] } else { joints.qd_rad_s[i - n][k] };
        let state: Vec<f64> = (0..2 * n).map(|i| measured(i, self.samples.start)).collect();
        let simulated = self.from(&state);
        let off = |i: usize| {
            let mut off = state.clone();
            off[i] += sd[i / n];
            self.from(&off)
        };
        let carried: Vec<Vec<Vec<f64>>> = (0..2 * n).filter(|i| sd[i / n] > 0.0).map(off).collect();
        let wander = wander(self.plant, self.run.drive, joints, &(self.samples.start..self.samples.end + 1));
        for (row, k) in (self.samples.start + 1..=self.samples.end).enumerate() {
            let since_s = joints.t_s[k] - joints.t_s[self.samples.start];
            for (i, channel) in gathered.iter_mut().enumerate() {
                let of_state: f64 = carried.iter().map(|c| (c[row][i] - simulated[row][i]).powi(2)).sum();
                let of_drive = wander[i % n] * if i < n { since_s.powi(3) / 3.0 } else { since_s };
                let variance = sd[i / n].powi(2) + of_state + of_drive;
                channel.add(joints.t_s[k], measured(i, k) - simulated[row][i], variance);
            }
        }
    }

    /// What encoders show at each sample after the first, from a state that they showed there.
    fn from(&self, shown: &[f64]) -> Vec<Vec<f64>> {
        let n = shown.len() / 2;
        let mut simulation = self.simulation.clone();
        let joints = simulation.physics().joints.clone();
        let late_s: Vec<f64> = (0..n).map(|i| simulation.physics().sensors.link_age_s(i)).collect();
        let rates: Vec<f64> = (0..n).map(|i| shown[n + i] / joints[i].encoder_scale).collect();
        let angle =
            |i: usize| (shown[i] - joints[i].encoder_offset_rad) / joints[i].encoder_scale + late_s[i] * rates[i];
        let angles: Vec<f64> = (0..n).map(angle).collect();
        simulation.begin_at(self.joints.t_s[self.samples.start]);
        simulation.set_state([0.0; 3], [0.0; 3], &angles, &rates);
        let step = |k: usize| {
            drive(&mut simulation, self.run.drive, self.joints, k);
            simulation.step(self.joints.t_s[k + 1] - self.joints.t_s[k]);
            let state: Vec<(f64, f64)> = (0..n).map(|i| simulation.joint(i)).collect();
            let angles = (0..n).map(|i| joints[i].encoder_reading(state[i].0 - late_s[i] * state[i].1));
            angles.chain((0..n).map(|i| joints[i].encoder_scale * state[i].1)).collect()
        };
        self.samples.clone().map(step).collect()
    }
}
