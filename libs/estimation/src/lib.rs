//! Estimation: one of each.
//!
//! - [`least_squares`]: nonlinear least squares with priors, bounds and robust weights.
//! - [`quasi_newton`]: the maximum of a smooth function, from its values alone.
//! - [`evidence`]: marginal likelihoods of linear models with spikes and slabs.
//! - [`Columns`]: time series side by side.
//! - [`smoothing`]: a motion between sparse measurements.
//! - [`Whitener`]: a Kalman filter that whitens them.
//! - [`statistics`]: median, normal distribution.

mod columns;
pub mod evidence;
pub mod least_squares;
pub mod processes;
pub mod quasi_newton;
pub mod smoothing;
pub mod statistics;
mod whitening;

pub use columns::Columns;
pub use whitening::{Step, Whitener};
