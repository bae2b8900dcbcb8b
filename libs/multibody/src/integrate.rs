//! Fixed-step integration. `forces` is asked for the generalized forces at a time within the step (s, from its start)
//! and a state; a clamped base ignores the first three. Nothing allocates.

use crate::{Coordinates, Model, State};

/// One step of the semi-implicit (symplectic) Euler method, order 1: velocity first, then position with the new
/// velocity. Energy of free motion stays bounded.
pub fn step_semi_implicit(
    model: &Model,
    state: &State,
    step_s: f64,
    forces: impl FnOnce(f64, &State) -> Coordinates,
) -> State {
    let v = state.v + step_s * model.forward_dynamics(state, &forces(0.0, state));
    State { q: state.q + step_s * v, v }
}

/// One step of the classical Runge-Kutta method, order 4.
pub fn step_rk4(
    model: &Model,
    state: &State,
    step_s: f64,
    mut forces: impl FnMut(f64, &State) -> Coordinates,
) -> State {
    let half = 0.5 * step_s;
    let mut acc = |time_s: f64, at: &State| model.forward_dynamics(at, &forces(time_s, at));
    let a1 = acc(0.0, state);
    let second = State { q: state.q + half * state.v, v: state.v + half * a1 };
    let a2 = acc(half, &second);
    let third = State { q: state.q + half * second.v, v: state.v + half * a2 };
    let a3 = acc(half, &third);
    let fourth = State { q: state.q + step_s * third.v, v: state.v + step_s * a3 };
    let a4 = acc(step_s, &fourth);
    State {
        q: state.q + step_s / 6.0 * (state.v + 2.0 * (second.v + third.v) + fourth.v),
        v: state.v + step_s / 6.0 * (a1 + 2.0 * (a2 + a3) + a4),
    }
}
