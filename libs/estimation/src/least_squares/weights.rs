//! Weights of the residuals.

use super::Linearization;

/// What the rows of a problem weigh; may depend on the residuals (iteratively reweighted least squares).
pub trait Weights {
    /// Weight of a row: one over the standard deviation of its noise.
    fn of(&self, row: usize) -> f64;

    /// Sees the problem at the point before the last step; returns whether the weights have settled. Iterations count
    /// from 0.
    fn update(&mut self, iteration: usize, before_step: &Linearization) -> bool;
}

/// Weights that stay.
#[derive(Clone, Debug)]
pub struct Fixed(
    /// One a row.
    pub Vec<f64>,
);

impl Weights for Fixed {
    fn of(&self, row: usize) -> f64 {
        self.0[row]
    }

    fn update(&mut self, _iteration: usize, _before_step: &Linearization) -> bool {
        true
    }
}

/// Huber's weights: the loss is quadratic up to a threshold and linear beyond (Huber, Annals of Mathematical Statistics 35,
/// 1964).
#[derive(Clone, Debug)]
pub struct Huber {
    base: Vec<f64>,
    threshold: f64,
    factors: Vec<f64>,
}

impl Huber {
    /// Of rows that weigh `weights` up to `threshold`, in standard deviations of the noise; 1.345 costs 5 % of the
    /// efficiency where the noise is normal.
    pub fn new(weights: Vec<f64>, threshold: f64) -> Self {
        let factors = vec![1.0; weights.len()];
        Self { base: weights, threshold, factors }
    }
}

impl Weights for Huber {
    fn of(&self, row: usize) -> f64 {
        self.base[row] * self.factors[row]
    }

    fn update(&mut self, _iteration: usize, before_step: &Linearization) -> bool {
        let mut largest_change = 0.0_f64;
        for (i, factor) in self.factors.iter_mut().enumerate() {
            let size = (before_step.residual[i] * self.base[i]).abs();
            // The square of a weight is what its residual's square counts.
            let next = if size > self.threshold { (self.threshold / size).sqrt() } else { 1.0 };
            largest_change = largest_change.max((next - *factor).abs());
            *factor = next;
        }
        largest_change <= 1e-9
    }
}
