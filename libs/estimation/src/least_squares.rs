//! Nonlinear least squares with priors, bounds and robust weights.
//!
//! Minimizes `sum_i (w_i r_i(x))^2 + sum_j ((x_j - mean_j) / std_j)^2` within bounds on `x`, where `r` is measured less
//! predicted, by Gauss-Newton steps with numerical derivatives.
//!
//! - [`solve`]: the iteration;
//! - [`Linearization`]: the problem at one point, its singular values and variances;
//! - [`Weights`]: [`Fixed`], [`Huber`], or weights of the caller's own that follow the residuals.

mod linearization;
mod weights;

pub use linearization::Linearization;
pub use weights::{Fixed, Huber, Weights};

use nalgebra::{DMatrix, DVector};

const MAX_ITERATIONS: usize = 60;
/// A step of so many standard deviations of the estimate is none.
const NEGLIGIBLE: f64 = 1e-3;
/// Nor is one of so many standard deviations of the prior.
const NEGLIGIBLE_PRIOR: f64 = 1e-7;

/// A parameter: its normal prior distribution, and its bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Mean of the prior.
    pub mean: f64,
    /// Standard deviation of the prior, finite; also the parameter's natural scale.
    pub std: f64,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
}

impl Parameter {
    /// Without bounds.
    pub fn new(mean: f64, std: f64) -> Self {
        Self { mean, std, low: f64::NEG_INFINITY, high: f64::INFINITY }
    }

    /// The same within bounds.
    pub fn within(self, low: f64, high: f64) -> Self {
        Self { low, high, ..self }
    }
}

/// The iteration does not converge, or there are no residuals where it goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the iteration does not converge")]
pub struct Diverged;

/// The values that minimize the sum of squares, from `start`.
///
/// `residuals` gives `None` where the values are impossible; a step that leads there is halved until it does not. The prior
/// keeps a direction that the data do not determine near its mean, where the iteration would else come to rest anywhere.
///
/// # Errors
/// Where the iteration does not converge.
pub fn solve(
    parameters: &[Parameter],
    start: &[f64],
    weights: &mut impl Weights,
    residuals: &(impl Fn(&[f64]) -> Option<Vec<f64>> + Sync),
) -> Result<Vec<f64>, Diverged> {
    let mut values: Vec<f64> = parameters.iter().zip(start).map(|(p, v)| v.clamp(p.low, p.high)).collect();
    for iteration in 0..MAX_ITERATIONS {
        let linear = Linearization::at(parameters, &values, |row| weights.of(row), residuals)?;
        let step = Step::of(parameters, &values, &linear, weights);
        let largest = go(parameters, &mut values, &step.parts, residuals)?;
        let arrived = largest < NEGLIGIBLE_PRIOR || step.sigmas2 < NEGLIGIBLE * NEGLIGIBLE;
        if weights.update(iteration, &linear) && arrived {
            return Ok(values);
        }
    }
    Err(Diverged)
}

/// A Gauss-Newton step.
struct Step {
    /// In standard deviations of the prior.
    parts: Vec<f64>,
    /// Its squared length in standard deviations of the estimate.
    sigmas2: f64,
}

impl Step {
    fn of(parameters: &[Parameter], values: &[f64], linear: &Linearization, weights: &impl Weights) -> Self {
        let n = parameters.len();
        let mut weighted = DVector::zeros(linear.jacobian.nrows());
        for i in 0..linear.residual.len() {
            weighted[i] = linear.residual[i] * weights.of(i);
        }
        let off_mean = |j: usize| (parameters[j].mean - values[j]) / parameters[j].std;
        let mut step = Self { parts: vec![0.0; n], sigmas2: 0.0 };
        for k in 0..linear.singular.len() {
            let from_data = linear.singular[k] * linear.left.column(k).dot(&weighted);
            let from_prior: f64 = (0..n).map(|j| linear.right[(k, j)] * off_mean(j)).sum();
            let along = (from_data + from_prior) * linear.variance(k);
            step.sigmas2 += along * along / linear.variance(k);
            step.parts.iter_mut().enumerate().for_each(|(j, part)| *part += along * linear.right[(k, j)]);
        }
        let room = |j: usize| [parameters[j].low, parameters[j].high].map(|b| (b - values[j]) / parameters[j].std);
        let room: Vec<[f64; 2]> = (0..n).map(room).collect();
        if step.parts.iter().zip(&room).all(|(part, [low, high])| (low..=high).contains(&part)) {
            return step;
        }
        let gradient = linear.jacobian.transpose() * weighted + DVector::from_fn(n, |j, _| off_mean(j));
        let information = linear.jacobian.transpose() * &linear.jacobian + DMatrix::identity(n, n);
        Self::within(&room, &information, &gradient, step)
    }

    /// The step that stays within `room`: parameters that would leave it go to their bound, and the others take the best
    /// step given those (active set).
    fn within(room: &[[f64; 2]], information: &DMatrix<f64>, gradient: &DVector<f64>, free: Self) -> Self {
        let n = room.len();
        let mut step = DVector::from_vec(free.parts);
        let mut at_bound: Vec<Option<f64>> = vec![None; n];
        loop {
            let leaves = |j: usize| at_bound[j].is_none() && !(room[j][0]..=room[j][1]).contains(&step[j]);
            let leaving: Vec<usize> = (0..n).filter(|j| leaves(*j)).collect();
            if leaving.is_empty() {
                break;
            }
            for j in leaving {
                at_bound[j] = Some(step[j].clamp(room[j][0], room[j][1]));
            }
            // A parameter at its bound has a row of its own: its part of the step is given.
            let (mut matrix, mut right) = (information.clone(), gradient.clone());
            for (j, part) in at_bound.iter().enumerate().filter_map(|(j, part)| Some((j, (*part)?))) {
                matrix.row_mut(j).fill(0.0);
                matrix[(j, j)] = 1.0;
                right[j] = part;
            }
            let Some(solved) = matrix.lu().solve(&right) else { break };
            step = solved;
        }
        let sigmas2 = step.dot(&(information * &step));
        Self { parts: step.as_slice().to_vec(), sigmas2 }
    }
}

/// Goes a step, or as much of it as leads to possible values; returns the largest part of it.
fn go(
    parameters: &[Parameter],
    values: &mut Vec<f64>,
    step: &[f64],
    residuals: &impl Fn(&[f64]) -> Option<Vec<f64>>,
) -> Result<f64, Diverged> {
    let mut share = 1.0;
    loop {
        let parts = values.iter().zip(parameters).zip(step);
        let next: Vec<f64> = parts.map(|((v, p), step)| (v + share * step * p.std).clamp(p.low, p.high)).collect();
        let largest = share * step.iter().fold(0.0_f64, |most, part| most.max(part.abs()));
        if !largest.is_finite() {
            return Err(Diverged);
        }
        if residuals(&next).is_some() {
            *values = next;
            return Ok(largest);
        }
        if largest < NEGLIGIBLE_PRIOR {
            return Ok(0.0);
        }
        share *= 0.5;
    }
}
