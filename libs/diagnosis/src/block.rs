//! What the search needs of a set of channels of one run: a prediction that is linear in small effects, and a noise model
//! that whitens it.
//!
//! Everything is linearized about the measured path: the prediction of a block is what its channels would have read, had the
//! plant with its effects acted along the path that was measured. A small force along a known path acts linearly, so that
//! an effect costs one column: a difference of two predictions.

use fss_estimation::Columns;
use fss_multibody::ModelError;
use fss_plant::{Effect, Plant, Pulse};

/// A hyper-parameter of a block's noise model: a positive number with a log-normal prior.
#[derive(Clone, Debug, PartialEq)]
pub struct HyperParameter {
    /// Its name with its unit, for the report.
    pub name: &'static str,
    /// Median of its prior.
    pub median: f64,
    /// Standard deviation of its logarithm.
    pub log_sd: f64,
    /// Smallest and largest value that makes sense.
    pub bounds: [f64; 2],
    /// Of a structured discrepancy, a process that acts on the motion: what kind; of a sensor's noise or a time, none.
    pub strength_of: Option<Strength>,
}

/// A prior whose logarithm is wider than this states nothing.
const WIDEST_STATEMENT: f64 = 1.0;

impl HyperParameter {
    /// Its value as the plant file states it: the median of its prior; of a discrepancy that is not stated, the least.
    pub fn stated(&self) -> f64 {
        let is_stated = self.strength_of.is_none() || self.log_sd <= WIDEST_STATEMENT;
        if is_stated { self.median } else { self.bounds[0] }
    }
}

/// Variation from run to run of the causes that are present, as a share of their size: a weak thruster is not equally weak every
/// day. What varies by much more than a third of its size has either sign, and is no property of the vehicle. What is absent does not
/// vary, or variation could stand for any cause.
pub(crate) const VARIATION: HyperParameter = HyperParameter {
    name: "variation from run to run, share of size",
    median: 0.05,
    log_sd: 1.5,
    bounds: [1e-4, 0.3],
    strength_of: None,
};

/// What a discrepancy acts as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Strength {
    /// Forces on the base.
    Force,
    /// Torques on the base.
    Torque,
    /// At joints.
    Joint,
}

/// Channels of one run that share a state-space noise model.
pub trait Block: Sync + Send {
    /// What was measured: the channels' values, stacked sample by sample.
    fn measured(&self) -> &[f64];

    /// What the channels would read, in the order of [`Block::measured`], had the plant's values with exactly these effects
    /// acted along the measured path. `plant.effects` are not looked at.
    ///
    /// # Errors
    /// When effects make a mass or an inertia impossible.
    fn predict(&self, plant: &Plant, effects: &[Effect]) -> Result<Vec<f64>, ModelError>;

    /// Each pulse that a thruster was commanded, with the change of the prediction by its not being delivered. Nothing where the
    /// channels do not tell.
    ///
    /// # Errors
    /// As [`Block::predict`].
    fn missing_pulses(&self, _plant: &Plant, _effects: &[Effect]) -> Result<Vec<(Pulse, Vec<f64>)>, ModelError> {
        Ok(Vec::new())
    }

    /// Forgets what earlier predictions left to be used again; the next one is the one about which others vary, and these
    /// hyper-parameters, in the order of [`Block::hyper_parameters`], are those of what it has for noise.
    fn forget(&self, _hyper: &[f64]) {}

    /// The noise model's hyper-parameters, the same for the same block of every run.
    fn hyper_parameters(&self) -> &[HyperParameter];

    /// Whitens columns in place, each as long as [`Block::measured`], with the noise model at these values of the
    /// hyper-parameters. Rows of diffuse initial states come out as (almost) zero. Returns the logarithm of the determinant
    /// of the measurements' covariance: the density of a residual column e is exp(-(log_det + |e_white|^2)/2) but for 2 pi.
    fn whiten(&self, hyper: &[f64], columns: &mut Columns) -> f64;

    /// Strengths of the structured discrepancy at these values of the hyper-parameters, each with what is expected of it: name
    /// with unit, inferred, expected.
    fn discrepancies(&self, hyper: &[f64]) -> Vec<(String, f64, f64)> {
        let strengths = self.hyper_parameters().iter().zip(hyper).filter(|(h, _)| h.strength_of.is_some());
        strengths.map(|(h, value)| (h.name.to_owned(), *value, h.median)).collect()
    }

    /// Channel of each row of [`Block::measured`], an index into [`Block::channels`].
    fn channel_of_row(&self) -> &[usize];

    /// Names of the channels: `base_x`, `gyro`, `joint_2_current`.
    fn channels(&self) -> &[String];

    /// Time of each row, s.
    fn time_of_row(&self) -> &[f64];

    /// Standard deviation of the sensor's noise of each row, stated in the plant file.
    fn noise_of_row(&self) -> &[f64];
}
