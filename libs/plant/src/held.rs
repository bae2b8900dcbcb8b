//! Accelerations with some of the coordinates held, and velocity jumps under impulses.

use fss_multibody::{Coordinates, MAX_DOF, MassMatrix, Model, State};

/// A set of coordinates, one bit each.
pub(crate) type Mask = u32;

/// Coordinates of a clamped base.
pub(crate) const BASE: Mask = 0b111;

/// Accelerations under `force` when the coordinates in `held` do not accelerate.
#[inline]
pub(crate) fn accelerations(model: &Model, state: &State, force: &Coordinates, held: Mask) -> Coordinates {
    if held & !BASE == 0 {
        return model.forward_dynamics(state, force);
    }
    let right = force - model.bias_forces(state);
    let mut out = Coordinates::zeros();
    solve(&model.mass_matrix(&state.q), model.dof(), &right, held, &mut out);
    out
}

/// Solves `mass * x = right` for the coordinates that are not `held`; those of `held` are given in `x`.
#[inline]
pub(crate) fn solve(mass: &MassMatrix, dof: usize, right: &Coordinates, held: Mask, x: &mut Coordinates) {
    let mut free = [0_usize; MAX_DOF];
    let mut count = 0;
    for i in (0..dof).filter(|i| held & (1 << i) == 0) {
        free[count] = i;
        count += 1;
    }
    let free = &free[..count];
    let mut y = [0.0; MAX_DOF];
    for (r, &i) in y.iter_mut().zip(free) {
        *r = right[i];
        for j in (0..dof).filter(|j| held & (1 << j) != 0) {
            *r -= mass[(i, j)] * x[j];
        }
    }
    // Cholesky; the mass matrix is positive definite, and so is every part of it on its diagonal.
    let mut lower = [[0.0; MAX_DOF]; MAX_DOF];
    let mut per_diagonal = [0.0; MAX_DOF];
    for a in 0..count {
        let mut diagonal = mass[(free[a], free[a])];
        for b in 0..a {
            let mut sum = mass[(free[a], free[b])];
            for c in 0..b {
                sum -= lower[a][c] * lower[b][c];
            }
            lower[a][b] = sum * per_diagonal[b];
            diagonal -= lower[a][b] * lower[a][b];
        }
        per_diagonal[a] = 1.0 / diagonal.sqrt();
    }
    for a in 0..count {
        for b in 0..a {
            y[a] -= lower[a][b] * y[b];
        }
        y[a] *= per_diagonal[a];
    }
    for a in (0..count).rev() {
        for b in a + 1..count {
            y[a] -= lower[b][a] * y[b];
        }
        y[a] *= per_diagonal[a];
        x[free[a]] = y[a];
    }
}
