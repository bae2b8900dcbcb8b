//! Fixed-step integration. `forces` is asked for the generalized forces at a time within the step (s, from its start)
//! and a state; a clamped base ignores the first three. Nothing allocates.

use nalgebra::{Vector2, Vector3};

use crate::chain::{cross, perp};
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

/// As [`step_rk4`], order 4, and besides the centre of mass and the momentum change by exactly what forces and gravity
/// do to them (Newton's laws, integrated by the same method): a free base and arm keep their momentum to rounding,
/// whatever the step. What Runge-Kutta loses goes to the base. A clamped base takes plain [`step_rk4`] steps.
pub fn step_rk4_momentum(
    model: &Model,
    state: &State,
    step_s: f64,
    mut forces: impl FnMut(f64, &State) -> Coordinates,
) -> State {
    if model.base().clamped {
        return step_rk4(model, state, step_s, forces);
    }
    // Stage by stage: weights of the impulse and, for the way it sets the whole off, of the double integral.
    let mut weights = [(1.0, 1.0), (2.0, 1.0), (2.0, 1.0), (1.0, 0.0)].into_iter();
    let (mut impulse, mut shift) = (Vector3::zeros(), Vector2::zeros());
    let mut end = step_rk4(model, state, step_s, |time_s, at| {
        let tau = forces(time_s, at);
        let outside = external(model, at, &tau);
        if let Some((once, twice)) = weights.next() {
            impulse += once * step_s / 6.0 * outside;
            shift += twice * step_s * step_s / 6.0 * outside.xy();
        }
        tau
    });
    let before = model.whole(state);
    let after = model.whole(&end);
    let (mass, linear) = (model.total_mass_kg(), before.generalized_momentum.xy());
    let way = (step_s * linear + shift) / mass;
    let center = state.q.xy() + before.center_m + way;
    let origin = center - after.center_m;
    end.q[0] = origin.x;
    end.q[1] = origin.y;

    // What is missing moves base and arm as one rigid body.
    let wanted = about_table(state, &before.generalized_momentum.xyz()) + impulse;
    let missing = wanted - about_table(&end, &after.generalized_momentum.xyz());
    let spin = (missing.z - cross(&center, &missing.xy())) / after.inertia_kg_m2;
    let velocity = missing.xy() / mass - spin * perp(&after.center_m);
    end.v[0] += velocity.x;
    end.v[1] += velocity.y;
    end.v[2] += spin;
    end
}

/// Force and moment from outside, about the table's origin.
fn external(model: &Model, state: &State, tau: &Coordinates) -> Vector3<f64> {
    let mut sum = about_table(state, &Vector3::new(tau[0], tau[1], tau[2]));
    let gravity = Vector2::from(model.gravity_m_s2());
    if gravity != Vector2::zeros() {
        let weight = model.total_mass_kg() * gravity;
        sum += Vector3::new(weight.x, weight.y, cross(&model.center_of_mass(&state.q), &weight));
    }
    sum
}

/// A force or momentum `[x, y, moment]` about the base origin, about the table's instead.
fn about_table(state: &State, about_base: &Vector3<f64>) -> Vector3<f64> {
    let lever = cross(&Vector2::new(state.q[0], state.q[1]), &about_base.xy());
    Vector3::new(about_base.x, about_base.y, about_base.z + lever)
}
