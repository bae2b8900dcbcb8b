//! Generalized inertia, bias forces, inverse and forward dynamics, energies.

use nalgebra::{SMatrix, Vector2};

use crate::chain::{Chain, absolute, cross, perp};
use crate::{Coordinates, MAX_BODIES, MassMatrix, Model, State};

impl Model {
    /// Generalized inertia `H(q)`, symmetric positive definite in its leading dof x dof block: `T = v' H v / 2`.
    pub fn mass_matrix(&self, q: &Coordinates) -> MassMatrix {
        let chain = Chain::<MAX_BODIES>::at(self, q);
        let lumps = &self.lumps;
        let bodies = self.link_count() + 1;
        // In absolute angles first; then sums over all that a coordinate carries.
        let mut inertia = SMatrix::<f64, MAX_BODIES, MAX_BODIES>::zeros();
        for j in 0..bodies {
            inertia[(j, j)] = lumps.j[j];
            for i in 0..j {
                inertia[(i, j)] = chain.d[i].dot(&chain.s[j]);
                inertia[(j, i)] = inertia[(i, j)];
            }
        }
        for i in (0..bodies - 1).rev() {
            for j in 0..bodies {
                inertia[(i, j)] += inertia[(i + 1, j)];
            }
        }
        for j in (0..bodies - 1).rev() {
            for i in 0..bodies {
                inertia[(i, j)] += inertia[(i, j + 1)];
            }
        }
        let mut matrix = MassMatrix::zeros();
        matrix[(0, 0)] = lumps.total_mass;
        matrix[(1, 1)] = lumps.total_mass;
        let mut moment = Vector2::zeros();
        for i in (0..bodies).rev() {
            moment += chain.s[i];
            let lever = perp(&moment);
            for axis in 0..2 {
                matrix[(axis, 2 + i)] = lever[axis];
                matrix[(2 + i, axis)] = lever[axis];
            }
            for j in 0..bodies {
                matrix[(2 + i, 2 + j)] = inertia[(i, j)];
            }
            matrix[(2 + i, 2 + i)] += lumps.rotor[i];
        }
        matrix
    }

    /// Bias forces `h(q, v)`: centrifugal, Coriolis and gravity, in `H acc + h = tau`.
    pub fn bias_forces(&self, state: &State) -> Coordinates {
        self.inverse_dynamics(state, &Coordinates::zeros())
    }

    /// Generalized forces `tau = H acc + h` that give the accelerations `acc`. Linear cost in the number of links.
    ///
    /// For a clamped base the first three are the force and moment that the clamp must supply.
    pub fn inverse_dynamics(&self, state: &State, acc: &Coordinates) -> Coordinates {
        let chain = Chain::<MAX_BODIES>::at(self, &state.q);
        let rate = absolute::<MAX_BODIES>(&state.v);
        let turn = absolute::<MAX_BODIES>(acc);
        let lumps = &self.lumps;
        let bodies = self.link_count() + 1;
        let mut origin = Vector2::new(acc[0], acc[1]) - Vector2::from(self.gravity_m_s2());
        let mut moment = [0.0; MAX_BODIES];
        let start = origin;
        for i in 0..bodies {
            moment[i] = lumps.j[i] * turn[i] + cross(&chain.s[i], &origin);
            origin += spin(&chain.d[i], rate[i], turn[i]);
        }
        let mut tau = Coordinates::zeros();
        let mut beyond = Vector2::zeros();
        let mut total = 0.0;
        for i in (0..bodies).rev() {
            total += moment[i] + cross(&chain.d[i], &beyond);
            beyond += spin(&chain.s[i], rate[i], turn[i]);
            tau[2 + i] = total;
            if i > 0 {
                tau[2 + i] += lumps.rotor[i] * acc[2 + i];
            }
        }
        let force = beyond + lumps.total_mass * start;
        tau[0] = force.x;
        tau[1] = force.y;
        tau
    }

    /// Accelerations `acc = H^-1 (tau - h)` under the generalized forces `tau = [Fx, Fy, Mz about the base origin,
    /// t_1 .. t_n]`, table axes, N and N m. A clamped base has none.
    ///
    /// The two translations are eliminated by hand (crate documentation), what is left is factored as `L D L'` with
    /// the number of bodies known to the compiler.
    pub fn forward_dynamics(&self, state: &State, tau: &Coordinates) -> Coordinates {
        match self.link_count() {
            0 => forward::<1>(self, state, tau),
            1 => forward::<2>(self, state, tau),
            2 => forward::<3>(self, state, tau),
            3 => forward::<4>(self, state, tau),
            4 => forward::<5>(self, state, tau),
            5 => forward::<6>(self, state, tau),
            6 => forward::<7>(self, state, tau),
            7 => forward::<8>(self, state, tau),
            _ => forward::<MAX_BODIES>(self, state, tau),
        }
    }

    /// Kinetic energy, J.
    pub fn kinetic_energy(&self, state: &State) -> f64 {
        0.5 * state.v.dot(&(self.mass_matrix(&state.q) * state.v))
    }

    /// Potential energy in the model's gravity, J; zero with the centre of mass at the table's origin.
    pub fn potential_energy(&self, q: &Coordinates) -> f64 {
        -self.lumps.total_mass * self.center_of_mass(q).dot(&Vector2::from(self.gravity_m_s2()))
    }
}

/// Acceleration of the end of a vector that turns: `alpha u^perp - omega^2 u`.
#[inline(always)]
fn spin(u: &Vector2<f64>, omega: f64, alpha: f64) -> Vector2<f64> {
    alpha * perp(u) - omega * omega * u
}

#[inline(always)]
fn forward<const B: usize>(model: &Model, state: &State, tau: &Coordinates) -> Coordinates {
    let chain = Chain::<B>::at(model, &state.q);
    let rate = absolute::<B>(&state.v);
    let lumps = &model.lumps;
    let clamped = model.base().clamped;
    // A clamped base is infinitely heavy: then e_i is d_i and gravity does not cancel.
    let per_mass = if clamped { 0.0 } else { lumps.per_mass };
    let gravity = Vector2::from(model.gravity_m_s2());
    let force = Vector2::new(tau[0], tau[1]);
    let pull = if clamped { gravity } else { -per_mass * force };

    let mut inertia = [[0.0; B]; B];
    let mut moment = [0.0; B];
    let mut square = [0.0; B];
    for i in 0..B {
        square[i] = rate[i] * rate[i];
        let next = if i + 1 < B { tau[3 + i] } else { 0.0 };
        moment[i] = tau[2 + i] - next + cross(&chain.s[i], &pull);
        inertia[i][i] = lumps.j[i] - per_mass * lumps.s[i].norm_squared();
    }
    for i in 0..B {
        let e = chain.d[i] - per_mass * chain.s[i];
        for j in i + 1..B {
            let s = &chain.s[j];
            inertia[j][i] = e.dot(s);
            let lever = cross(&e, s);
            moment[i] += square[j] * lever;
            moment[j] -= square[i] * lever;
        }
    }
    for i in 1..B {
        inertia[i][i] += lumps.rotor[i];
        inertia[i - 1][i - 1] += lumps.rotor[i];
        inertia[i][i - 1] -= lumps.rotor[i];
    }
    let turn = solve(&inertia, &moment, usize::from(clamped));

    let mut acc = Coordinates::zeros();
    if !clamped {
        let mut origin = force;
        for i in 0..B {
            origin -= spin(&chain.s[i], rate[i], turn[i]);
        }
        acc[0] = origin.x * per_mass + gravity.x;
        acc[1] = origin.y * per_mass + gravity.y;
    }
    acc[2] = turn[0];
    for i in 1..B {
        acc[2 + i] = turn[i] - turn[i - 1];
    }
    acc
}

/// Solves `A x = b` for the rows and columns from `first` on, `A` symmetric positive definite and given by its lower
/// triangle, by `L D L'`; the rows before `first` get zero.
#[inline(always)]
fn solve<const B: usize>(a: &[[f64; B]; B], b: &[f64; B], first: usize) -> [f64; B] {
    let mut l = *a;
    let mut x = *b;
    let mut inverse = [0.0; B];
    for j in first..B {
        inverse[j] = 1.0 / l[j][j];
        for i in j + 1..B {
            let factor = l[i][j] * inverse[j];
            for k in j + 1..=i {
                l[i][k] -= factor * l[k][j];
            }
            x[i] -= factor * x[j];
        }
    }
    for i in (first..B).rev() {
        let mut sum = x[i];
        for k in i + 1..B {
            sum -= l[k][i] * x[k];
        }
        x[i] = sum * inverse[i];
    }
    for row in x.iter_mut().take(first) {
        *row = 0.0;
    }
    x
}
