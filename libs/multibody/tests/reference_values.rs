//! Numbers that others computed: SPART, Pinocchio and numpy scripts.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{coordinates, model, numbers, reference, relative_error};
use fss_multibody::State;

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
