//! Jacobians and derivatives by parameters against finite differences.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::random::{Random, random_model, random_state};
use fss_multibody::{Model, Parameter, State};
use nalgebra::Vector3;

const ROUNDS: usize = 27;

/// Models of 0 to 8 links, clamped now and then.
fn round(random: &mut Random, index: usize) -> (Model, State) {
    let links = index % 9;
    let model = random_model(random, links, links > 0 && index % 4 == 3);
    let state = random_state(random, model.dof());
    (model, state)
}

#[test]
fn the_jacobians_rate_is_its_change_along_the_motion() {
    let mut random = Random::announced("jacobian", 45);
    for index in 0..ROUNDS {
        let (model, state) = round(&mut random, index);
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

#[test]
fn the_tips_derivatives_by_parameters_are_what_differences_give() {
    let mut random = Random::announced("parameters", 42);
    for index in 0..ROUNDS {
        let (model, state) = round(&mut random, index);
        let links = model.link_count();
        assert_eq!(model.parameters().count(), 9 + 7 * links);
        for parameter in model.parameters() {
            let value = model.parameter(parameter).unwrap();
            // Masses and inertias must stay positive.
            let h = 1e-3 * value.abs().max(1e-2);
            if value.abs() <= 2.0 * h {
                continue;
            }
            let tip = |h: f64| model.with_parameter(parameter, value + h).unwrap().end_effector(&state.q);
            let expected = (8.0 * (tip(h) - tip(-h)) - (tip(2.0 * h) - tip(-2.0 * h))) / (12.0 * h);
            let by = model.end_effector_by_parameter(&state.q, parameter);
            let error = (by - expected).amax();
            assert!(error < 1e-7, "round {index}: the tip by {parameter:?} is off by {error:e}");
        }
        let absent = Parameter::LinkMass(links + 1);
        assert!(model.parameter(absent).is_none() && model.with_parameter(absent, 1.0).is_err());
    }
}
