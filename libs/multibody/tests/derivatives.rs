//! Analytic derivatives against finite differences, and what is linear against what it is linear in.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::random::{Random, random_model, random_state};
use fss_multibody::{
    Cause, Coordinates, ForceGradient, ForceLaw, InertialVector, MassMatrix, Model, Parameter, Sensitivity, State,
    integrate, step_with_derivatives,
};
use nalgebra::Vector3;
use rand::RngExt;

const ROUNDS: usize = 27;

fn random_force(random: &mut Random, dof: usize) -> Coordinates {
    Coordinates::from_fn(|i, _| if i < dof { random.random_range(-5.0..5.0) } else { 0.0 })
}

/// Models of 0 to 8 links, clamped now and then.
fn round(random: &mut Random, index: usize) -> (Model, State, Coordinates) {
    let links = index % 9;
    let model = random_model(random, links, links > 0 && index % 4 == 3);
    let state = random_state(random, model.dof());
    let tau = random_force(random, model.dof());
    (model, state, tau)
}

/// Fourth-order central difference.
fn difference(h: f64, f: impl Fn(f64) -> Coordinates) -> Coordinates {
    (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)
}

fn assert_close(actual: &Coordinates, expected: &Coordinates, scale: f64, what: &str) {
    let error = (actual - expected).amax() / scale.max(expected.amax());
    assert!(error < 1e-7, "{what} is off by {error:e}: {actual} instead of {expected}");
}

#[test]
fn derivatives_by_state_and_force_are_what_differences_give() {
    let mut random = Random::announced("derivatives", 41);
    for index in 0..ROUNDS {
        let (model, state, tau) = round(&mut random, index);
        let exact = model.forward_dynamics_derivatives(&state, &tau);
        let scale = exact.acc.amax();
        assert_eq!(exact.acc, model.forward_dynamics(&state, &tau));
        for k in 0..model.dof() {
            let moved = |dq: f64, dv: f64, df: f64| {
                let (mut at, mut force) = (state, tau);
                at.q[k] += dq;
                at.v[k] += dv;
                force[k] += df;
                model.forward_dynamics(&at, &force)
            };
            let label = |by: &str| format!("round {index}: d acc / d {by}{k}");
            let column = |m: &MassMatrix| m.column(k).into_owned();
            assert_close(&column(&exact.by_q), &difference(1e-3, |h| moved(h, 0.0, 0.0)), scale, &label("q"));
            assert_close(&column(&exact.by_v), &difference(1e-3, |h| moved(0.0, h, 0.0)), scale, &label("v"));
            assert_close(&column(&exact.by_force), &difference(1e-1, |h| moved(0.0, 0.0, h)), scale, &label("tau"));
        }
    }
}

#[test]
fn derivatives_by_every_parameter_are_what_differences_give() {
    let mut random = Random::announced("parameters", 42);
    for index in 0..ROUNDS {
        let (model, state, tau) = round(&mut random, index);
        let at = model.forward_dynamics_derivatives(&state, &tau);
        let links = model.link_count();
        assert_eq!(model.parameters().count(), 9 + 7 * links);
        for parameter in model.parameters() {
            let value = model.parameter(parameter).unwrap();
            // Masses and inertias must stay positive.
            let h = 1e-3 * value.abs().max(1e-2);
            let changed = |h: f64| model.with_parameter(parameter, value + h).unwrap_or(model);
            let label = format!("round {index}: by {parameter:?}");
            let by = model.forward_dynamics_by_parameter(&state, &at, parameter);
            if value > 2.0 * h || value < -2.0 * h {
                let expected = difference(h, |h| changed(h).forward_dynamics(&state, &tau));
                assert_close(&by, &expected, at.acc.amax(), &label);
                let tip = |h: f64| {
                    Coordinates::from_fn(|i, _| if i < 3 { changed(h).end_effector(&state.q)[i] } else { 0.0 })
                };
                let by = model.end_effector_by_parameter(&state.q, parameter);
                let by = Coordinates::from_fn(|i, _| if i < 3 { by[i] } else { 0.0 });
                assert_close(&by, &difference(h, tip), 1.0, &format!("{label}: the tip"));
            }
        }
        let absent = Parameter::LinkMass(links + 1);
        assert!(model.parameter(absent).is_none() && model.with_parameter(absent, 1.0).is_err());
        assert_eq!(model.forward_dynamics_by_parameter(&state, &at, absent).amax(), 0.0);
    }
}

#[test]
fn inverse_dynamics_and_momentum_are_linear_in_the_inertial_parameters() {
    let mut random = Random::announced("regressor", 43);
    for index in 0..ROUNDS {
        let (model, state, acc) = round(&mut random, index);
        let pi = model.inertial_vector();
        let mut tau = model.inverse_dynamics_regressor(&state, &acc) * pi;
        for (i, link) in model.links().iter().enumerate() {
            tau[3 + i] += link.rotor_inertia_kg_m2 * acc[3 + i];
        }
        let expected = model.inverse_dynamics(&state, &acc);
        let error = (tau - expected).amax() / expected.amax();
        assert!(error < 1e-13, "round {index}: Y pi is off by {error:e}");
        let momentum = model.momentum_regressor(&state) * pi;
        let expected = model.momentum(&state).about_base();
        let error = (momentum - expected).amax() / expected.amax();
        assert!(error < 1e-13, "round {index}: the momentum is off by {error:e}");

        let other: InertialVector = pi * 1.25;
        let heavier = model.with_inertial_vector(&other).unwrap();
        let error = (heavier.inertial_vector() - other).amax() / other.amax();
        assert!(error < 1e-14, "round {index}: the parameters come back off by {error:e}");
        assert!((heavier.base().com_m[0] - model.base().com_m[0]).abs() < 1e-15);
    }
}

#[test]
fn a_body_with_less_inertia_than_its_first_moment_needs_is_refused() {
    let mut random = Random::announced("impossible", 44);
    let model = random_model(&mut random, 2, false);
    let mut pi = model.inertial_vector();
    pi[7] = 0.0;
    let error = model.with_inertial_vector(&pi).unwrap_err().to_string();
    assert!(error.contains("link 1") && error.contains("inertia_kg_m2"), "{error}");
}

#[test]
fn the_jacobians_rate_is_its_change_along_the_motion() {
    let mut random = Random::announced("jacobian", 45);
    for index in 0..ROUNDS {
        let (model, state, _) = round(&mut random, index);
        let jacobian = |t: f64| model.jacobian(&(state.q + t * state.v));
        let h = 1e-3;
        let expected = (8.0 * (jacobian(h) - jacobian(-h)) - (jacobian(2.0 * h) - jacobian(-2.0 * h))) / (12.0 * h);
        let error = (model.jacobian_derivative(&state) - expected).amax() / expected.amax().max(1.0);
        assert!(error < 1e-9, "round {index}: the Jacobian's rate is off by {error:e}");
        let tip = |t: f64| model.end_effector(&(state.q + t * state.v));
        let twist: Vector3<f64> = (8.0 * (tip(h) - tip(-h)) - (tip(2.0 * h) - tip(-2.0 * h))) / (12.0 * h);
        let error = (model.jacobian(&state.q) * state.v - twist).amax() / twist.amax().max(1.0);
        assert!(error < 1e-9, "round {index}: J v is off by {error:e}");
    }
}

/// Springs and dampers of one stiffness and one damping coefficient at all joints, driven by a sine.
struct SpringsAndDampers {
    stiffness: f64,
    damping: f64,
}

impl ForceLaw for SpringsAndDampers {
    fn forces(&self, time_s: f64, state: &State) -> Coordinates {
        let mut tau = -self.stiffness * state.q - self.damping * state.v;
        tau.fixed_rows_mut::<3>(0).fill((3.0 * time_s).sin());
        tau
    }

    fn gradient(&self, _time_s: f64, _state: &State) -> Option<ForceGradient> {
        let joints = MassMatrix::from_fn(|i, j| if i == j && i >= 3 { 1.0 } else { 0.0 });
        Some(ForceGradient { by_q: -self.stiffness * joints, by_v: -self.damping * joints })
    }

    fn by_parameter(&self, _time_s: f64, state: &State, index: usize) -> Coordinates {
        let mut tau = if index == 0 { -state.q } else { -state.v };
        tau.fixed_rows_mut::<3>(0).fill(0.0);
        tau
    }
}

#[test]
fn the_tangents_of_many_steps_are_the_derivatives_of_the_computed_motion() {
    let mut random = Random::announced("tangents", 46);
    for index in 0..12 {
        let (model, start, _) = round(&mut random, index);
        let law = SpringsAndDampers { stiffness: 1.5, damping: 0.3 };
        let n = model.dof();
        let mut sensitivities: Vec<Sensitivity> = (0..n).map(Sensitivity::to_coordinate).collect();
        sensitivities.extend((0..n).map(Sensitivity::to_velocity));
        sensitivities.extend((0..n).map(|i| Sensitivity::to(Cause::Force(i))));
        sensitivities.extend(model.parameters().map(|p| Sensitivity::to(Cause::Parameter(p))));
        sensitivities.extend([0, 1].map(|i| Sensitivity::to(Cause::Law(i))));
        let (steps, step_s) = (10, 0.01);
        let fly = |model: &Model, start: &State, law: &SpringsAndDampers, extra: &Coordinates| {
            (0..steps)
                .fold(*start, |state, _| integrate::step_rk4(model, &state, step_s, |t, at| law.forces(t, at) + extra))
        };
        let mut state = start;
        for _ in 0..steps {
            state = step_with_derivatives(&model, &state, step_s, &law, &mut sensitivities);
        }
        let none = Coordinates::zeros();
        let expected = fly(&model, &start, &law, &none);
        assert!((state.q - expected.q).amax() + (state.v - expected.v).amax() < 1e-13, "round {index}: another motion");
        for (k, sensitivity) in sensitivities.iter().enumerate() {
            let value = match sensitivity.cause {
                Cause::Parameter(p) => model.parameter(p).unwrap(),
                _ => 1.0,
            };
            let h = 1e-3 * value.abs().max(1e-2);
            if value == 0.0 {
                continue;
            }
            let moved = |h: f64| match sensitivity.cause {
                Cause::Start if k < n => {
                    let mut from = start;
                    from.q[k] += h;
                    fly(&model, &from, &law, &none)
                }
                Cause::Start => {
                    let mut from = start;
                    from.v[k - n] += h;
                    fly(&model, &from, &law, &none)
                }
                Cause::Force(i) => {
                    let mut extra = none;
                    extra[i] = h;
                    fly(&model, &start, &law, &extra)
                }
                Cause::Parameter(p) => {
                    let changed = model.with_parameter(p, value + h).unwrap_or(model);
                    fly(&changed, &start, &law, &none)
                }
                Cause::Law(0) => fly(&model, &start, &SpringsAndDampers { stiffness: 1.5 + h, ..law }, &none),
                Cause::Law(_) => fly(&model, &start, &SpringsAndDampers { damping: 0.3 + h, ..law }, &none),
            };
            let label = format!("round {index}: {:?} ({k})", sensitivity.cause);
            assert_close(&sensitivity.tangent.q, &difference(h, |h| moved(h).q), 1.0, &label);
            assert_close(&sensitivity.tangent.v, &difference(h, |h| moved(h).v), 10.0, &label);
        }
    }
}
