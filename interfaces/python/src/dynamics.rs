//! Quantities of a mechanism at many states, on all cores.

use fss_multibody::{Coordinates, Model, State};
use rayon::prelude::*;

/// States that a thread takes at once.
const STATES_AT_ONCE: usize = 256;

/// What is asked of the mechanism.
#[derive(Clone, Copy)]
pub(crate) enum Quantity {
    /// `H`, dof x dof.
    Inertia,
    /// `h`, dof.
    Bias,
    /// `J`, 3 x dof.
    Jacobian,
    /// `J*`, 3 x joints.
    GeneralizedJacobian,
    /// Accelerations under the forces `u`, dof.
    Forward,
    /// Forces for the accelerations `u`, dof.
    Inverse,
    /// Pose of the end-effector, 3.
    EndEffector,
    /// Linear, and angular about the base origin and the centre of mass, 4.
    Momentum,
}

impl Quantity {
    pub(crate) fn named(name: &str) -> Option<Self> {
        Some(match name {
            "inertia" => Self::Inertia,
            "bias" => Self::Bias,
            "jacobian" => Self::Jacobian,
            "generalized_jacobian" => Self::GeneralizedJacobian,
            "forward" => Self::Forward,
            "inverse" => Self::Inverse,
            "end_effector" => Self::EndEffector,
            "momentum" => Self::Momentum,
            _ => return None,
        })
    }

    /// Numbers a state.
    fn size(self, dof: usize) -> usize {
        match self {
            Self::Inertia => dof * dof,
            Self::Bias | Self::Forward | Self::Inverse => dof,
            Self::Jacobian => 3 * dof,
            Self::GeneralizedJacobian => 3 * (dof - 3),
            Self::EndEffector => 3,
            Self::Momentum => 4,
        }
    }

    fn write(self, model: &Model, state: &State, u: &Coordinates, out: &mut [f64]) {
        let dof = model.dof();
        let put = |out: &mut [f64], columns: usize, value: &dyn Fn(usize, usize) -> f64| {
            for (k, slot) in out.iter_mut().enumerate() {
                *slot = value(k / columns, k % columns);
            }
        };
        match self {
            Self::Inertia => {
                let h = model.mass_matrix(&state.q);
                put(out, dof, &|i, j| h[(i, j)]);
            }
            Self::Bias => out.copy_from_slice(&model.bias_forces(state).as_slice()[..dof]),
            Self::Jacobian => {
                let jacobian = model.jacobian(&state.q);
                put(out, dof, &|i, j| jacobian[(i, j)]);
            }
            Self::GeneralizedJacobian => {
                let jacobian = model.generalized_jacobian(&state.q);
                put(out, dof - 3, &|i, j| jacobian[(i, j)]);
            }
            Self::Forward => out.copy_from_slice(&model.forward_dynamics(state, u).as_slice()[..dof]),
            Self::Inverse => out.copy_from_slice(&model.inverse_dynamics(state, u).as_slice()[..dof]),
            Self::EndEffector => out.copy_from_slice(model.end_effector(&state.q).as_slice()),
            Self::Momentum => {
                let m = model.momentum(state);
                out.copy_from_slice(&[m.linear.x, m.linear.y, m.angular_about_base, m.angular_about_com]);
            }
        }
    }
}

/// A quantity at each row of `q`, `v` and `u`, rows of the mechanism's degrees of freedom; an empty one is zero everywhere.
pub(crate) fn at_each(model: &Model, quantity: Quantity, q: &[f64], v: &[f64], u: &[f64]) -> Vec<f64> {
    let dof = model.dof();
    let size = quantity.size(dof);
    let mut values = vec![0.0; q.len() / dof * size];
    if size == 0 {
        return values;
    }
    let row = |of: &[f64], k: usize| -> State {
        let empty: &[f64] = &[];
        State::from_slices(of.get(k * dof..(k + 1) * dof).unwrap_or(empty), empty)
    };
    values.par_chunks_mut(size * STATES_AT_ONCE).enumerate().for_each(|(block, out)| {
        for (k, out) in out.chunks_exact_mut(size).enumerate() {
            let k = block * STATES_AT_ONCE + k;
            let state = State { q: row(q, k).q, v: row(v, k).q };
            quantity.write(model, &state, &row(u, k).q, out);
        }
    });
    values
}
