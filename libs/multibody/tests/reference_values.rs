//! Numbers that others computed: SPART, Pinocchio and numpy scripts.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{coordinates, model, numbers, reference, relative_error};
use fss_multibody::{Coordinates, JointVector, Model, State, integrate};
use nalgebra::Vector3;

#[test]
fn all_fifty_states_agree_with_spart_to_ten_digits() {
    let file = reference("dynamics.json");
    let model = model(&file["params"]);
    let n = model.dof();
    let cases = file["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 50);
    for (index, case) in cases.iter().enumerate() {
        let state = State { q: coordinates(&case["q"]), v: coordinates(&case["v"]) };
        let tau = coordinates(&case["tau"]);
        let momentum = model.momentum(&state);
        let acc = model.forward_dynamics(&state, &tau);
        let check = |name: &str, error: f64| assert!(error < 1e-10, "state {index}: {name} is off by {error:e}");
        check("H", relative_error(rows(&model.mass_matrix(&state.q), n, n), &case["H"]));
        check("h", relative_error(model.bias_forces(&state).iter().copied().take(n), &case["h"]));
        check("J", relative_error(rows(&model.jacobian(&state.q), 3, n), &case["J"]));
        check("P", relative_error(momentum.linear.iter().copied(), &case["P"]));
        check("L_base", relative_error([momentum.angular_about_base], &case["L_base"]));
        check("L_com", relative_error([momentum.angular_about_com], &case["L_com"]));
        check("Jg", relative_error(rows(&model.generalized_jacobian(&state.q), 3, n - 3), &case["Jg"]));
        check("com", relative_error(model.center_of_mass(&state.q).iter().copied(), &case["com"]));
        check("acc", relative_error(acc.iter().copied().take(n), &case["acc"]));
        check("tau", relative_error(model.inverse_dynamics(&state, &acc).iter().copied().take(n), &case["tau"]));
        let mut tip = model.end_effector(&state.q);
        let expected = numbers(&case["ee"]);
        tip.z -= std::f64::consts::TAU * ((tip.z - expected[2]) / std::f64::consts::TAU).round();
        check("ee", relative_error(tip.iter().copied(), &case["ee"]));
    }
}

fn rows<const R: usize, const C: usize>(
    matrix: &nalgebra::SMatrix<f64, R, C>,
    rows: usize,
    columns: usize,
) -> Vec<f64> {
    (0..rows * columns).map(|i| matrix[(i / columns, i % columns)]).collect()
}

/// Moves the joints at constant rates to `target`, momentum zero, and lets the base follow: RK4 over the joint path.
fn follow(model: &Model, start: &Coordinates, target: &JointVector) -> Coordinates {
    let steps = 400;
    let rates = target - start.fixed_rows::<8>(3);
    let velocity = |q: &Coordinates| {
        let base = model.base_twist(q, &rates, &Vector3::zeros());
        Coordinates::from_fn(|i, _| if i < 3 { base[i] } else { rates[i - 3] })
    };
    let h = 1.0 / f64::from(steps);
    (0..steps).fold(*start, |q, _| {
        let k1 = velocity(&q);
        let k2 = velocity(&(q + 0.5 * h * k1));
        let k3 = velocity(&(q + 0.5 * h * k2));
        let k4 = velocity(&(q + h * k3));
        q + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    })
}

fn joints_deg(degrees: &[f64]) -> JointVector {
    JointVector::from_fn(|i, _| degrees.get(i).map_or(0.0, |angle| angle.to_radians()))
}

#[test]
fn a_swinging_arm_turns_the_free_base_as_far_as_the_independent_integration_says() {
    let file = reference("paper.json");
    let model = model(&file["params"]);
    for sweep in file["path_integration"]["single_joint_sweeps"].as_array().unwrap() {
        let joint = sweep["joint"].as_u64().unwrap() as usize - 1;
        let ends = numbers(&sweep["sweep_deg"]);
        let at = |angle: f64| {
            let mut degrees = [0.0; 4];
            degrees[joint] = angle;
            joints_deg(&degrees)
        };
        let mut start = Coordinates::zeros();
        start.fixed_rows_mut::<8>(3).copy_from(&at(ends[0]));
        let end = follow(&model, &start, &at(ends[1]));
        let error = relative_error(end.iter().copied().take(3), &sweep["base_final_xy_theta"]);
        assert!(error < 1e-6, "joint {}: the base is off by {error:e}", joint + 1);
    }
}

#[test]
fn a_closed_loop_of_the_joints_leaves_the_base_turned() {
    let file = reference("paper.json");
    let model = model(&file["params"]);
    let square = &file["path_integration"]["square_loop"];
    let mut degrees = numbers(&square["q_start_deg"]);
    let mut q = Coordinates::zeros();
    q.fixed_rows_mut::<8>(3).copy_from(&joints_deg(&degrees));
    for (joint, change) in [(0, 60.0), (1, 60.0), (0, -60.0), (1, -60.0)] {
        degrees[joint] += change;
        q = follow(&model, &q, &joints_deg(&degrees));
    }
    let error = relative_error(q.iter().copied().take(3), &square["base_final"]);
    assert!(error < 1e-6, "the base is off by {error:e}");
}

#[test]
fn two_seconds_of_constant_torques_end_where_the_independent_integration_ends() {
    let file = reference("paper.json");
    let model = model(&file["params"]);
    let case = &file["forward_dynamics_2s"];
    let start = numbers(&case["q0"]);
    let (q0, v0) = start.split_at(model.dof());
    let tau = coordinates(&case["tau"]);
    let mut state = State::from_slices(q0, v0);
    for _ in 0..2000 {
        state = integrate::step_rk4(&model, &state, 1e-3, |_, _| tau);
    }
    let end = state.q.iter().take(model.dof()).chain(state.v.iter().take(model.dof())).copied();
    let error = relative_error(end, &case["yf"]);
    assert!(error < 1e-9, "the end state is off by {error:e}");
    let work = case["work_of_torques"].as_f64().unwrap();
    let energy = model.kinetic_energy(&state);
    assert!((energy / work - 1.0).abs() < 1e-6, "{energy} J of kinetic energy from {work} J of work");
}

#[test]
fn reaction_vectors_and_base_coupling_agree_with_the_independent_scripts() {
    let file = reference("paper.json");
    let model = model(&file["params"]);
    for case in file["manipulability"].as_array().unwrap() {
        let mut q = Coordinates::zeros();
        q.fixed_rows_mut::<8>(3).copy_from(&joints_deg(&numbers(&case["q_deg"])));
        let reaction = model.reaction_vector(&q);
        let error = relative_error(reaction.iter().copied().take(4), &case["base_rate_per_joint"]);
        assert!(error < 1e-10, "the reaction vector is off by {error:e}");
        let error = relative_error([model.inertia_about_com(&q)], &case["Hs"]);
        assert!(error < 1e-10, "the locked inertia is off by {error:e}");
        // Joint rates in the reaction null space leave the base's attitude alone.
        let rates = JointVector::from_fn(|i, _| if i < 4 { 0.3 - 0.2 * i as f64 } else { 0.0 });
        let silent = rates - reaction * (reaction.dot(&rates) / reaction.norm_squared());
        assert!(model.base_twist(&q, &silent, &Vector3::zeros()).z.abs() < 1e-15);
    }
}
