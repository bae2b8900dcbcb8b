//! Least squares linearized at a guess: residuals, Jacobian, and its singular values.

use nalgebra::DMatrix;

/// Autocorrelation is looked for in series of this many samples and more.
pub(super) const SHORTEST_SERIES: usize = 12;

/// The weighted problem at one point, columns in units of what is plausible.
pub(super) struct Linear {
    pub(super) residual: Vec<f64>,
    pub(super) jacobian: DMatrix<f64>,
    pub(super) singular: Vec<f64>,
    pub(super) right: DMatrix<f64>,
    pub(super) left: DMatrix<f64>,
}

impl Linear {
    pub(super) fn is_seen(&self, k: usize) -> bool {
        let largest = self.singular.iter().copied().fold(0.0, f64::max);
        self.singular[k] > 1.0 && self.singular[k] > 1e-7 * largest
    }

    /// Of the estimate along a direction: data and first guess together, in units of what is plausible.
    pub(super) fn variance(&self, k: usize) -> f64 {
        1.0 / (self.singular[k].powi(2) + 1.0)
    }

    /// The part of it that the data's noise has, and the part that the first guess has.
    pub(super) fn shares(&self, k: usize) -> (f64, f64) {
        let guessed = self.variance(k).powi(2);
        (self.singular[k].powi(2) * guessed, guessed)
    }

    pub(super) fn rank(&self) -> usize {
        (0..self.singular.len()).filter(|k| self.is_seen(*k)).count()
    }
}
