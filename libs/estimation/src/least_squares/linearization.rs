//! Least squares linearized at a point: residuals, Jacobian, and its singular values.

use super::{Diverged, Parameter};
use nalgebra::DMatrix;
use rayon::prelude::*;

/// Step of numerical derivatives, in standard deviations of the prior.
const STEP: f64 = 1e-5;

/// The weighted problem at one point, its columns in standard deviations of the prior.
pub struct Linearization {
    /// Measured less predicted, not weighted.
    pub residual: Vec<f64>,
    /// Derivatives of the weighted predictions; with rows of zeros below, as many rows as columns at least.
    pub jacobian: DMatrix<f64>,
    /// Singular values of the Jacobian.
    pub singular: Vec<f64>,
    /// Right singular vectors, one a row: directions of the parameters.
    pub right: DMatrix<f64>,
    /// Left singular vectors, one a column.
    pub left: DMatrix<f64>,
}

impl Linearization {
    /// Of `residuals` at `values`, by forward differences, where row `i` weighs `weight(i)`.
    ///
    /// # Errors
    /// Where there are no residuals.
    pub fn at(
        parameters: &[Parameter],
        values: &[f64],
        weight: impl Fn(usize) -> f64,
        residuals: &(impl Fn(&[f64]) -> Option<Vec<f64>> + Sync),
    ) -> Result<Self, Diverged> {
        let residual = residuals(values).ok_or(Diverged)?;
        let (n, m) = (parameters.len(), residual.len());
        // Rows of zeros below change nothing, and give the null space where there are fewer rows than parameters.
        let mut jacobian = DMatrix::zeros(m.max(n), n);
        // Beyond a bound there may be nothing to compare with: there the difference is taken backwards.
        let step = |j: usize| if values[j] + STEP * parameters[j].std > parameters[j].high { -STEP } else { STEP };
        let ahead = |j: usize| {
            let mut moved = values.to_vec();
            moved[j] += step(j) * parameters[j].std;
            residuals(&moved).ok_or(Diverged)
        };
        let ahead: Vec<Vec<f64>> = (0..n).into_par_iter().map(ahead).collect::<Result<_, _>>()?;
        let weights: Vec<f64> = (0..m).map(weight).collect();
        for (j, ahead) in ahead.iter().enumerate() {
            for i in 0..m {
                jacobian[(i, j)] = (residual[i] - ahead[i]) / step(j) * weights[i];
            }
        }
        // The singular values of the small triangle are those of the tall matrix.
        let svd = jacobian.clone().qr().r().svd(false, true);
        let Some(right) = svd.v_t else { return Err(Diverged) };
        let mut left = &jacobian * right.transpose();
        for (mut column, singular) in left.column_iter_mut().zip(&svd.singular_values) {
            column /= singular.max(f64::MIN_POSITIVE);
        }
        Ok(Self { residual, jacobian, singular: svd.singular_values.as_slice().to_vec(), right, left })
    }

    /// Whether the data determine direction `k`: they say more of it than the prior.
    pub fn is_determined(&self, k: usize) -> bool {
        let largest = self.singular.iter().copied().fold(0.0, f64::max);
        self.singular[k] > 1.0 && self.singular[k] > 1e-7 * largest
    }

    /// Number of directions that the data determine.
    pub fn rank(&self) -> usize {
        (0..self.singular.len()).filter(|k| self.is_determined(*k)).count()
    }

    /// Posterior variance along direction `k`, of data and prior together, in variances of the prior.
    pub fn variance(&self, k: usize) -> f64 {
        1.0 / (self.singular[k].powi(2) + 1.0)
    }

    /// The part of [`Self::variance`] that comes from the noise of the data, and the part that comes from the prior.
    pub fn variance_shares(&self, k: usize) -> (f64, f64) {
        let of_prior = self.variance(k).powi(2);
        (self.singular[k].powi(2) * of_prior, of_prior)
    }

    /// Posterior variance of parameter `j`, in variances of its prior.
    pub fn parameter_variance(&self, j: usize) -> f64 {
        (0..self.singular.len()).map(|k| self.right[(k, j)].powi(2) * self.variance(k)).sum()
    }
}
