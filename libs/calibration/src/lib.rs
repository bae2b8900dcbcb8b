//! Calibration: parameters of the plant from measured runs, with what the data cannot determine said in words.
//!
//! - [`solve`]: least squares with the noise estimated from the residuals, rank and covariance;
//! - [`kinematic`]: link lengths, joint offsets and the first joint's pose from end-effector poses (the paper's section 4.1);
//! - [`attitude`]: a common inertia of the links from how far the base turned (the paper's section 4.2);
//! - [`dynamic`]: kinematic and dynamic parameters together from whole trajectories;
//! - [`write`](mod@write): an estimate into a plant file.
//!
//! # Intervals on moving data
//!
//! What is wrong with one telemetry report is wrong with all samples between it and its neighbours. The autocorrelation of
//! the residuals tells by how much: `n` samples then count as `n / (1 + 2 sum of autocorrelations)`, the sum ended where
//! pairs of neighbouring lags are no more than chance (after
//! Geyer, "Practical Markov chain Monte Carlo", Statistical Science 7, 1992). Where the residuals of blocks of time show more
//! than that, they count (`sandwich.rs`).

pub mod attitude;
mod drift;
pub mod dynamic;
mod estimate;
pub mod kinematic;
mod motion;
pub mod plan;
mod sandwich;
mod words;
pub mod write;

pub use estimate::solve;

use fss_estimation::least_squares::Diverged;

/// One unknown of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknown {
    /// Where it stands in the plant file, unit in its name.
    pub name: String,
    /// First guess.
    pub value: f64,
    /// Known no better than this, a parameter counts as not determined.
    pub plausible: f64,
}

/// Autocorrelation is looked for in series of this many samples and more.
const SHORTEST_SERIES: usize = 12;

/// Observations of one kind share a noise that is estimated from their residuals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Kind of the observation.
    pub kind: usize,
    /// Observations of one instant are kept or rejected together.
    pub instant: usize,
    /// Rows of one kind and series stand in the order of time and may share errors; those of two series do not.
    pub series: usize,
}

/// A parameter as the data determine it.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimated {
    /// Name of the unknown.
    pub name: String,
    /// Best value.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
}

/// What came out.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Parameters that are determined.
    pub parameters: Vec<Estimated>,
    /// Directions that are not, in words.
    pub undetermined: Vec<String>,
    /// Parameters with a share in such a direction.
    pub undetermined_parameters: Vec<String>,
    /// Determined directions.
    pub rank: usize,
    /// Number of unknowns.
    pub unknowns: usize,
    /// Largest over smallest singular value of the weighted Jacobian with columns of unit norm; infinite without full rank.
    pub condition: f64,
    /// Standard deviation of the residuals, one a kind of observation; divided by what is left of its degrees of freedom,
    /// and enlarged where neighbours share their errors.
    pub noise: Vec<f64>,
    /// Root mean square of the residuals, one a kind.
    pub residual_std: Vec<f64>,
    /// Observations less determined directions.
    pub degrees_of_freedom: usize,
    /// The same of the kind of observation that has the fewest to tell its noise by: what intervals are computed with.
    pub noise_degrees_of_freedom: f64,
    /// Instants taken for outliers.
    pub rejected: Vec<usize>,
    /// All values, also the undetermined ones, which are as near to their first guess as the data let them.
    pub values: Vec<f64>,
}

/// Where an iteration starts that knows nothing better.
fn first_guess(unknowns: &[Unknown]) -> Vec<f64> {
    unknowns.iter().map(|unknown| unknown.value).collect()
}

impl Estimate {
    /// Half the width of the interval that holds a parameter of standard deviation `std` with 90 or 95 percent, from
    /// Student's distribution (Abramowitz and Stegun 26.7.5).
    pub fn half_width(&self, std: f64, normal_quantile: f64) -> f64 {
        let (z, nu) = (normal_quantile, self.noise_degrees_of_freedom.max(1.0));
        let first = (z.powi(3) + z) / (4.0 * nu);
        let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * nu * nu);
        std * (z + first + second)
    }
}

/// Why a calibration is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// There is nothing to calibrate on.
    #[error("{0}")]
    NoData(String),
    /// The iteration left the numbers that a mechanism can have.
    #[error("the iteration does not converge: the first guess is too far off, or the data are not of this plant")]
    Diverged,
}

impl From<Diverged> for CalibrationError {
    fn from(_: Diverged) -> Self {
        Self::Diverged
    }
}
