//! Where the simulation is wrong: its error over what noise alone would give, channel by channel, window by window.
//!
//! Long simulations drift apart for any small reason, so each run is cut into windows with an initial state of their own
//! (multiple shooting). For a floating base the joints go as telemetry and commands say, the base follows from momentum
//! and thrust ([`fss_plant::Rollout`]), and its initial state is fitted to the window. For a clamped arm the joints
//! themselves are simulated from their measured state, driven by the measured current or by nothing.

mod arm;
mod base;

use fss_experiments::measured::{Drive, Run};
use fss_multibody::ModelError;
use fss_plant::Plant;

pub use fss_diagnosis::diagnosis::ChannelMisfit;

/// How runs are cut.
#[derive(Clone, Copy, Debug)]
pub struct Windows {
    /// Length of a window of a floating base, s.
    pub base_s: f64,
    /// Length of a window of a clamped arm, s.
    pub arm_s: f64,
}

impl Windows {
    /// What suits a plant and its runs: 5 s of a floating base; 0.5 s of an arm that is driven by a measured current, whose
    /// errors add up; 4.5 s of one free link and 2 s of several, whose motion is chaotic.
    pub fn suited_to(plant: &Plant, runs: &[Run]) -> Self {
        let driven = runs.iter().any(|run| run.drive != Drive::Free);
        let arm_s = match (driven, plant.link_count()) {
            (true, _) => 0.5,
            (false, 1) => 4.5,
            _ => 2.0,
        };
        Self { base_s: 5.0, arm_s }
    }
}

/// The misfit of every channel that a run has; empty where the run has nothing that can be simulated.
///
/// # Errors
/// Where the plant's effects make a mass or an inertia impossible.
pub fn of_run(plant: &Plant, run: &Run, windows: Windows) -> Result<Vec<ChannelMisfit>, ModelError> {
    if plant.base.clamped { arm::misfit(plant, run, windows.arm_s) } else { base::misfit(plant, run, windows) }
}

/// Residuals of one channel as they are gathered.
#[derive(Default)]
struct Gathered {
    residuals: Vec<(f64, f64)>,
    square_sum: f64,
    /// Variance that noise alone gives, summed over the samples.
    noise_square_sum: f64,
    /// Degrees of freedom: samples less the parameters fitted to them.
    freedom: f64,
}

impl Gathered {
    fn add(&mut self, t_s: f64, residual: f64, noise_variance: f64) {
        self.residuals.push((t_s, residual));
        self.square_sum += residual * residual;
        self.noise_square_sum += noise_variance;
        self.freedom += 1.0;
    }

    fn finish(self, run: &str, channel: &str) -> Option<ChannelMisfit> {
        let noise = (self.noise_square_sum / self.residuals.len().max(1) as f64).sqrt();
        let rms = (self.square_sum / self.freedom.max(1.0)).sqrt();
        let (run, channel) = (run.to_owned(), channel.to_owned());
        (!self.residuals.is_empty()).then_some(ChannelMisfit { run, channel, rms, noise, residuals: self.residuals })
    }
}
