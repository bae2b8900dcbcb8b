//! The inner loops of the dynamics, for a number of bodies `B` that the compiler knows.
//!
//! Unknowns are the absolute angular accelerations; the translations are eliminated (crate documentation). A clamped
//! base is one of infinite mass: nothing is eliminated and the base's row is left out.

use nalgebra::Vector2;

use crate::chain::{Chain, absolute, cross, perp};
use crate::{Coordinates, MassMatrix, Model, Prescribed, State};

/// Acceleration of the end of a vector that turns: `alpha u^perp - omega^2 u`.
#[inline(always)]
pub(crate) fn spin(u: &Vector2<f64>, omega: f64, alpha: f64) -> Vector2<f64> {
    alpha * perp(u) - omega * omega * u
}

/// Recursive Newton-Euler: accelerations outwards, forces inwards.
#[inline(always)]
pub(crate) fn inverse<const B: usize>(model: &Model, state: &State, acc: &Coordinates) -> Coordinates {
    let chain = Chain::<B>::at(model, &state.q);
    let rate = absolute::<B>(&state.v);
    let turn = absolute::<B>(acc);
    let lumps = &model.lumps;
    // A field of gravity is the same as a table that accelerates the other way.
    let start = Vector2::new(acc[0], acc[1]) - Vector2::from(model.gravity_m_s2());
    let mut origin = start;
    let mut moment = [0.0; B];
    for i in 0..B {
        moment[i] = lumps.j[i] * turn[i] + cross(&chain.s[i], &origin);
        origin += spin(&chain.d[i], rate[i], turn[i]);
    }
    let mut tau = Coordinates::zeros();
    let mut beyond = Vector2::zeros();
    let mut total = 0.0;
    for i in (0..B).rev() {
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

/// Generalized inertia: in absolute angles first, then summed over all bodies that a coordinate carries.
#[inline(always)]
pub(crate) fn inertia<const B: usize>(model: &Model, q: &Coordinates) -> MassMatrix {
    let chain = Chain::<B>::at(model, q);
    let lumps = &model.lumps;
    let mut lower = [[0.0; B]; B];
    for j in 0..B {
        lower[j][j] = lumps.j[j];
        for i in 0..j {
            lower[j][i] = chain.d[i].dot(&chain.s[j]);
        }
    }
    let mut matrix = MassMatrix::zeros();
    let mut moment = Vector2::zeros();
    for i in (0..B).rev() {
        moment += chain.s[i];
        let lever = perp(&moment);
        for axis in 0..2 {
            matrix[(axis, 2 + i)] = lever[axis];
            matrix[(2 + i, axis)] = lever[axis];
        }
        // Row i of the sums from row i + 1: what is new is body i's own row.
        let mut row = 0.0;
        for j in (0..B).rev() {
            row += lower[i.max(j)][i.min(j)];
            let below = if i + 1 < B { matrix[(3 + i, 2 + j)] } else { 0.0 };
            matrix[(2 + i, 2 + j)] = row + below;
        }
    }
    for i in 1..B {
        matrix[(2 + i, 2 + i)] += lumps.rotor[i];
    }
    matrix[(0, 0)] = lumps.total_mass;
    matrix[(1, 1)] = lumps.total_mass;
    matrix
}

#[inline(always)]
pub(crate) fn forward<const B: usize>(model: &Model, state: &State, tau: &Coordinates) -> Coordinates {
    let mut system = System::<B>::assemble(model, state, tau);
    system.solve(model, tau)
}

/// Forward dynamics together with `H^-1`, from one factorisation.
#[inline(always)]
pub(crate) fn forward_with_inverse<const B: usize>(
    model: &Model,
    state: &State,
    tau: &Coordinates,
) -> (Coordinates, MassMatrix) {
    let mut system = System::<B>::assemble(model, state, tau);
    let acc = system.solve(model, tau);
    (acc, system.inverse(model))
}

#[inline(always)]
pub(crate) fn hybrid<const B: usize>(
    model: &Model,
    state: &State,
    tau: &Coordinates,
    prescribed: &Prescribed,
) -> Coordinates {
    let mut system = System::<B>::assemble(model, state, tau);
    let (inertia, moment) = (&mut system.inertia, &mut system.moment);
    // The prescribed accelerations as if the bodies before them stood still ..
    let mut known = [0.0; B];
    for i in 1..B {
        known[i] = prescribed[i - 1].map_or(0.0, |acc| known[i - 1] + acc);
    }
    for i in 0..B {
        for j in 0..B {
            moment[i] -= inertia[i.max(j)][i.min(j)] * known[j];
        }
    }
    // .. and each such body fused to the one before it: its equation, with the unknown torque, adds to that one's.
    for i in (1..B).rev().filter(|i| prescribed[i - 1].is_some()) {
        moment[i - 1] += moment[i];
        inertia[i - 1][i - 1] += inertia[i][i] + 2.0 * inertia[i][i - 1];
        for j in 0..i - 1 {
            inertia[i - 1][j] += inertia[i][j];
        }
        for j in i + 1..B {
            inertia[j][i - 1] += inertia[j][i];
            inertia[j][i] = 0.0;
        }
        inertia[i] = [0.0; B];
        inertia[i][i] = 1.0;
        moment[i] = 0.0;
    }
    let first = usize::from(model.base().clamped);
    factor(inertia, first);
    let mut turn = *moment;
    substitute(inertia, &mut turn, first);
    for i in 1..B {
        if let Some(acc) = prescribed[i - 1] {
            turn[i] = turn[i - 1] + acc;
        }
    }
    system.accelerations(model, tau, &turn)
}

#[inline(always)]
pub(crate) fn inverse_inertia<const B: usize>(model: &Model, q: &Coordinates) -> MassMatrix {
    forward_with_inverse::<B>(model, &State::at_rest(*q), &Coordinates::zeros()).1
}

/// Fills the block of force to translation: that of the whole mass, and what turning adds through the levers `s_i`.
#[inline(always)]
fn translations<const B: usize>(chain: &Chain<B>, per_mass: f64, inverse: &mut MassMatrix) {
    let mut lever = Vector2::zeros();
    let mut levers = [Vector2::zeros(); B];
    for i in (0..B).rev() {
        lever += perp(&chain.s[i]);
        levers[i] = lever;
    }
    for axis in 0..2 {
        for other in 0..2 {
            let mut sum = if axis == other { 1.0 } else { 0.0 };
            for i in 0..B {
                sum -= levers[i][axis] * inverse[(2 + i, other)];
            }
            inverse[(axis, other)] = sum * per_mass;
        }
    }
}

/// The equations of motion in absolute angles, `inertia turn = moment`.
struct System<const B: usize> {
    chain: Chain<B>,
    rate: [f64; B],
    /// Lower triangle.
    inertia: [[f64; B]; B],
    moment: [f64; B],
}

impl<const B: usize> System<B> {
    #[inline(always)]
    fn assemble(model: &Model, state: &State, tau: &Coordinates) -> Self {
        let chain = Chain::<B>::at(model, &state.q);
        let rate = absolute::<B>(&state.v);
        let lumps = &model.lumps;
        let clamped = model.base().clamped;
        let per_mass = if clamped { 0.0 } else { lumps.per_mass };
        // What accelerates the frame in which only angles are left: gravity itself where the base is held, and
        // nothing but the applied force where gravity takes all alike.
        let pull = if clamped { Vector2::from(model.gravity_m_s2()) } else { -per_mass * Vector2::new(tau[0], tau[1]) };
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
        Self { chain, rate, inertia, moment }
    }

    /// Factors the inertia in place and gives the accelerations.
    #[inline(always)]
    fn solve(&mut self, model: &Model, tau: &Coordinates) -> Coordinates {
        let first = usize::from(model.base().clamped);
        factor(&mut self.inertia, first);
        let mut turn = self.moment;
        substitute(&self.inertia, &mut turn, first);
        self.accelerations(model, tau, &turn)
    }

    /// `H^-1`, once [`System::solve`] has factored the inertia.
    #[inline(always)]
    fn inverse(&self, model: &Model) -> MassMatrix {
        let clamped = model.base().clamped;
        let first = usize::from(clamped);
        // Column k of the right-hand side: a torque turns its body and turns the one before it back.
        let mut turn = [[0.0; B]; B];
        for k in first..B {
            turn[k][k] = 1.0;
            if k > 0 {
                turn[k - 1][k] = -1.0;
            }
        }
        substitute_all(&self.inertia, &mut turn, first);
        let mut inverse = MassMatrix::zeros();
        let mut origin = [[0.0; B]; 2];
        for i in 0..B {
            let lever = model.lumps.per_mass * perp(&self.chain.s[i]);
            for k in 0..B {
                let before = if i > 0 { turn[i - 1][k] } else { 0.0 };
                inverse[(2 + i, 2 + k)] = turn[i][k] - before;
                origin[0][k] -= lever.x * turn[i][k];
                origin[1][k] -= lever.y * turn[i][k];
            }
        }
        if !clamped {
            for (axis, row) in origin.iter().enumerate() {
                for k in 0..B {
                    inverse[(axis, 2 + k)] = row[k];
                    inverse[(2 + k, axis)] = row[k];
                }
            }
            translations(&self.chain, model.lumps.per_mass, &mut inverse);
        }
        inverse
    }

    /// Generalized accelerations from the absolute angular ones; the translations follow from the momentum principle.
    #[inline(always)]
    fn accelerations(&self, model: &Model, tau: &Coordinates, turn: &[f64; B]) -> Coordinates {
        let mut acc = response(turn);
        if !model.base().clamped {
            let mut force = Vector2::new(tau[0], tau[1]);
            for i in 0..B {
                force -= spin(&self.chain.s[i], self.rate[i], turn[i]);
            }
            let [gx, gy] = model.gravity_m_s2();
            acc[0] = force.x * model.lumps.per_mass + gx;
            acc[1] = force.y * model.lumps.per_mass + gy;
        }
        acc
    }
}

/// Relative angles from absolute ones.
#[inline(always)]
fn response<const B: usize>(turn: &[f64; B]) -> Coordinates {
    let mut acc = Coordinates::zeros();
    acc[2] = turn[0];
    for i in 1..B {
        acc[2 + i] = turn[i] - turn[i - 1];
    }
    acc
}

/// Factors a symmetric positive definite matrix, given by its lower triangle, from row and column `first` on, as
/// `L D L'` in place: below the diagonal `L`, on it `1 / D`.
#[inline(always)]
fn factor<const B: usize>(a: &mut [[f64; B]; B], first: usize) {
    for j in first..B {
        let inverse = 1.0 / a[j][j];
        a[j][j] = inverse;
        let mut ratio = [0.0; B];
        for i in j + 1..B {
            ratio[i] = a[i][j] * inverse;
        }
        for i in j + 1..B {
            for k in j + 1..=i {
                a[i][k] -= ratio[i] * a[k][j];
            }
        }
        for i in j + 1..B {
            a[i][j] = ratio[i];
        }
    }
}

/// Solves with the factors of [`factor`]; the rows before `first` get zero.
#[inline(always)]
fn substitute<const B: usize>(l: &[[f64; B]; B], x: &mut [f64; B], first: usize) {
    for row in x.iter_mut().take(first) {
        *row = 0.0;
    }
    for j in first..B {
        for i in j + 1..B {
            x[i] -= l[i][j] * x[j];
        }
    }
    for i in (first..B).rev() {
        x[i] *= l[i][i];
        for k in i + 1..B {
            x[i] -= l[k][i] * x[k];
        }
    }
}

/// [`substitute`] for many right-hand sides side by side, which the processor takes several at a time.
#[inline(always)]
fn substitute_all<const B: usize>(l: &[[f64; B]; B], x: &mut [[f64; B]; B], first: usize) {
    for row in x.iter_mut().take(first) {
        *row = [0.0; B];
    }
    for j in first..B {
        let pivot = x[j];
        for i in j + 1..B {
            for k in 0..B {
                x[i][k] -= l[i][j] * pivot[k];
            }
        }
    }
    for i in (first..B).rev() {
        for k in 0..B {
            x[i][k] *= l[i][i];
        }
        for below in i + 1..B {
            let solved = x[below];
            for k in 0..B {
                x[i][k] -= l[below][i] * solved[k];
            }
        }
    }
}
