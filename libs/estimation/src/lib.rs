//! Estimation: one of each.
//!
//! - [`Columns`]: time series side by side.
//! - [`StateSpace`]: a Kalman filter that whitens them.

mod columns;
mod whitening;

pub use columns::Columns;
pub use whitening::{Measurement, StateSpace, Step};
