//! Joint rates for motions of the end-effector, and manipulability, against independent scripts.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::random::{Random, random_model, random_state};
use common::{model, numbers, reference, relative_error};
use fss_multibody::{
    Base, Coordinates, JointVector, Manipulability, Model, damped_pseudoinverse, damping_near_singularity,
    singular_values,
};
use nalgebra::{SMatrix, Vector3, Vector4};
use serde_json::Value;

fn configurations() -> (Model, Vec<(Coordinates, Value)>) {
    let file = reference("paper.json");
    let cases = file["manipulability"].as_array().unwrap().iter().map(|case| {
        let mut q = Coordinates::zeros();
        for (i, angle) in numbers(&case["q_deg"]).iter().enumerate() {
            q[3 + i] = angle.to_radians();
        }
        (q, case.clone())
    });
    (model(&file["params"]), cases.collect())
}

#[test]
fn manipulability_of_free_and_held_base_agrees_with_the_independent_scripts() {
    let (free, cases) = configurations();
    let held = Model::new(Base { clamped: true, ..*free.base() }, free.links(), [0.0; 2]).unwrap();
    for (q, case) in cases {
        for (model, expected) in [(&free, &case["floating"]), (&held, &case["fixed"])] {
            let jacobian = model.generalized_jacobian(&q);
            let ellipse = Manipulability::of(&jacobian);
            let check = |value: f64, key: &str| {
                let error = relative_error([value], &expected[key]);
                assert!(error < 1e-8, "{:?}: {key} is off by {error:e}", case["q_deg"]);
            };
            check(ellipse.measure_m2(), "w2");
            check(ellipse.measure_m2() * std::f64::consts::PI, "ellipse_area");
            assert!(relative_error(ellipse.semi_axes_m, &expected["sigma"]) < 1e-8);
            let turn = (ellipse.major_axis_rad.to_degrees() - expected["major_axis_deg"].as_f64().unwrap()) / 180.0;
            assert!((turn - turn.round()).abs() < 1e-8, "the major axis is off by {turn} half turns");
            check(singular_values(&jacobian).product(), "w3");
        }
    }
}

#[test]
fn zero_reaction_rates_agree_with_the_independent_scripts_and_leave_the_base_alone() {
    let (model, cases) = configurations();
    let all = JointVector::repeat(1.0);
    for (q, case) in cases {
        let pose = model.zero_reaction_jacobian(&q);
        let position = SMatrix::<f64, 3, 8>::from_rows(&[pose.row(0), pose.row(1), pose.row(3)]);
        let rates = damped_pseudoinverse(&position, &all, 0.0).unwrap() * Vector3::new(0.01, 0.02, 0.0);
        let error = relative_error(rates.iter().copied().take(4), &case["zrm2_qd_for_v=[0.01,0.02]"]);
        assert!(error < 1e-7, "{:?}: joint rates for a position are off by {error:e}", case["q_deg"]);
        let rates = damped_pseudoinverse(&pose, &all, 0.0).unwrap() * Vector4::new(0.01, 0.02, 0.05, 0.0);
        let error = relative_error(rates.iter().copied().take(4), &case["zrm3_qd_for_twist=[0.01,0.02,0.05]"]);
        assert!(error < 1e-5, "{:?}: joint rates for a pose are off by {error:e}", case["q_deg"]);
        let base = model.base_twist(&q, &rates, &Vector3::zeros());
        assert!(base.z.abs() < 1e-12 * rates.norm(), "the base turns at {} rad/s", base.z);
    }
}

#[test]
fn a_locked_joint_stays_and_the_others_make_the_motion() {
    let mut random = Random::announced("locked", 61);
    for _ in 0..50 {
        let model = random_model(&mut random, 5, false);
        let state = random_state(&mut random, model.dof());
        let jacobian = model.generalized_jacobian(&state.q);
        let mobility = JointVector::from_fn(|i, _| [1.0, 0.0, 0.5, 1.0, 1.0].get(i).copied().unwrap_or(0.0));
        let twist = Vector3::new(0.02, -0.01, 0.03);
        let Some(inverse) = damped_pseudoinverse(&jacobian, &mobility, 0.0) else { continue };
        let rates = inverse * twist;
        assert_eq!(rates[1], 0.0);
        assert!((jacobian * rates - twist).norm() < 1e-8 * rates.norm().max(1.0), "the motion is missed");
        let damped = damped_pseudoinverse(&jacobian, &mobility, 0.1).unwrap() * twist;
        assert!(damped.norm() < rates.norm(), "damping does not slow the joints");
    }
}

#[test]
fn a_stretched_arm_has_no_undamped_inverse_and_a_bounded_damped_one() {
    let (model, _) = configurations();
    let mut straight = Coordinates::zeros();
    for (i, link) in model.links().iter().enumerate() {
        straight[3 + i] = -link.joint_offset_rad;
    }
    let held = Model::new(Base { clamped: true, ..*model.base() }, model.links(), [0.0; 2]).unwrap();
    let jacobian = held.generalized_jacobian(&straight);
    let rows = jacobian.fixed_rows::<2>(0).into_owned();
    assert!(damped_pseudoinverse(&rows, &JointVector::repeat(1.0), 0.0).is_none());
    let sigma = singular_values(&rows)[1];
    let damping = damping_near_singularity(sigma, 0.05, 0.02);
    assert!((damping - 0.02).abs() < 1e-12);
    let inverse = damped_pseudoinverse(&rows, &JointVector::repeat(1.0), damping).unwrap();
    assert!(inverse.norm() < 1.0 / (2.0 * damping) + 1.0, "rates of {} per m/s", inverse.norm());
    assert_eq!(damping_near_singularity(0.06, 0.05, 0.02), 0.0);
}
