//! What a diagnosis could not decide, the next experiment does.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::succeed;
use std::path::Path;

/// A diagnosis that could not tell a thruster that leaks from a force that is fixed to the body.
const UNDECIDED: &str = r#"{ "format": "fss-diagnosis/1", "verdict": "explained", "causes": [
    { "effect": "body_force", "probability": 0.6,
      "parameters": { "force_x_N": { "value": -0.01, "std": 0.001 }, "force_y_N": { "value": 0, "std": 0.001 },
                      "torque_N_m": { "value": 0, "std": 0.0001 } },
      "alternatives": [ { "effect": "table_tilt", "probability": 0.4,
          "parameters": { "accel_x_m_s2": { "value": -0.0005 }, "accel_y_m_s2": { "value": 0 } } } ] } ] }"#;

#[test]
fn a_maneuver_is_found_that_tells_a_tilted_table_from_a_force_of_the_body_and_it_can_be_flown() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("diagnosis.json"), UNDECIDED).unwrap();
    let plant = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/etc/plants/fss.toml");
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (mission, json, out) = (path("next.toml"), path("next.json"), path("out"));
    let plant = plant.to_string_lossy();
    succeed(&["next-experiment", &path(""), "--plant", &plant, "--out", &mission, "--json", &json]);
    let ranked: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let separation = |k: usize| ranked[k]["separation"].as_f64().unwrap();
    let last = ranked.as_array().unwrap().len() - 1;
    assert!(separation(0) > 1.0, "{} times noise and disturbance", separation(0));
    assert!(separation(0) > 1.2 * separation(last), "{} and {}", separation(0), separation(last));
    succeed(&["run", &mission, "--fast", "--quiet", "--out", &out]);
    assert!(Path::new(&out).join("run.mcap").exists());
}

#[test]
fn where_nothing_is_undecided_it_says_so_and_writes_no_mission() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("diagnosis.json"), r#"{ "causes": [] }"#).unwrap();
    let plant = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/etc/plants/fss.toml");
    let mission = folder.path().join("next.toml");
    let said = succeed(&[
        "next-experiment",
        &folder.path().to_string_lossy(),
        "--plant",
        &plant.to_string_lossy(),
        "--out",
        &mission.to_string_lossy(),
    ]);
    assert!(said.contains("Nothing is undecided") && !mission.exists(), "{said}");
}
