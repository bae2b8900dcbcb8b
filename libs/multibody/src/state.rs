//! Vectors and matrices of fixed capacity.

use nalgebra::{SMatrix, SVector};
use std::f64::consts::TAU;

use crate::{MAX_DOF, MAX_LINKS};

/// One number per degree of freedom, in the order `[x, y, theta, q_1 .. q_n]`; zero beyond `n + 3`.
pub type Coordinates = SVector<f64, MAX_DOF>;
/// One number per joint, zero beyond `n`.
pub type JointVector = SVector<f64, MAX_LINKS>;
/// `MAX_DOF` x `MAX_DOF`, zero outside the leading `(n + 3)` x `(n + 3)` block.
pub type MassMatrix = SMatrix<f64, MAX_DOF, MAX_DOF>;
/// 3 x `MAX_DOF`: twist `[vx, vy, omega]` in table axes per generalized velocity; zero columns beyond `n + 3`.
pub type Jacobian = SMatrix<f64, 3, MAX_DOF>;
/// 3 x `MAX_LINKS`: twist `[vx, vy, omega]` in table axes per joint rate; zero columns beyond `n`.
pub type JointJacobian = SMatrix<f64, 3, MAX_LINKS>;

/// Generalized coordinates and velocities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// `[x, y, theta, q_1 .. q_n]`, metres and radians.
    pub q: Coordinates,
    /// `dq/dt`, metres per second and radians per second.
    pub v: Coordinates,
}

impl State {
    /// Everything at zero, at rest.
    pub fn zero() -> Self {
        Self { q: Coordinates::zeros(), v: Coordinates::zeros() }
    }

    /// At rest in configuration `q`.
    pub fn at_rest(q: Coordinates) -> Self {
        Self { q, v: Coordinates::zeros() }
    }

    /// From slices of equal meaning; what is beyond a slice's end is zero, what is beyond [`MAX_DOF`] is ignored.
    pub fn from_slices(q: &[f64], v: &[f64]) -> Self {
        let all = |values: &[f64]| -> Coordinates {
            let mut values = values.iter().copied();
            Coordinates::from_fn(|_, _| values.next().unwrap_or(0.0))
        };
        Self { q: all(q), v: all(v) }
    }
}

/// Generalized coordinates of a base `[x, y, theta]` and joints, or their rates; joints beyond a slice's end are zero.
pub fn coordinates(base: [f64; 3], joints: &[f64]) -> Coordinates {
    let mut values = base.into_iter().chain(joints.iter().copied());
    Coordinates::from_fn(|_, _| values.next().unwrap_or(0.0))
}

impl Default for State {
    fn default() -> Self {
        Self::zero()
    }
}

/// An angle less its whole turns, between -pi and pi (rad).
pub fn wrapped(angle_rad: f64) -> f64 {
    angle_rad - TAU * (angle_rad / TAU).round()
}
