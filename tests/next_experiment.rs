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

/// One push along x, and nothing else: whatever slows the base down there does it at nearly one speed.
const ONE_PUSH: &str = r#"name = "one-push"
description = "A push, then the base drifts; the arm holds."

[initial]
q_deg = [-30, 60, -60, 30]
x_m = -1

[[phase]]
name = "coast"
duration_s = 25
base = { goal = "valves", pulses = [{ at_s = 0.5, for_s = 2.5, thrusters = [5, 6] }] }
arm = { goal = "hold" }
"#;

#[test]
fn what_one_flight_leaves_undecided_the_next_one_decides() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let nominal = include_str!("../deploy/etc/plants/fss.toml");
    let rubbing = format!("{nominal}\n[[effect]]\nid = \"base_coulomb_drag\"\nforce_N = 0.004\n");
    for (name, text) in [("plant.toml", nominal), ("rubbing.toml", &rubbing), ("one-push.toml", ONE_PUSH)] {
        std::fs::write(path(name), text).unwrap();
    }
    let fly = |mission: &str, seed: &str, out: &str| {
        let laboratory = ["--plant", &path("plant.toml"), "--laboratory", &path("rubbing.toml")];
        let mission = path(mission);
        let out = path(out);
        succeed(&[&["run", &mission, "--fast", "--quiet", "--seed", seed, "--out", &out], &laboratory[..]].concat());
        out
    };
    let diagnose = |logs: &[&str], out: &str| {
        let out = path(out);
        let said = succeed(&[&["diagnose"], logs, &["--plant", &path("plant.toml"), "--out", &out]].concat());
        (said, common::json(&Path::new(&out).join("diagnosis.json"))["causes"].clone())
    };
    let first = fly("one-push.toml", "3", "first");
    let (said, causes) = diagnose(&[&first], "undecided");
    assert!(said.contains("fss next-experiment"), "{said}");
    let cause = &causes[0];
    let others = cause["alternatives"].as_array().unwrap();
    let possible: Vec<_> = std::iter::once(cause).chain(others).map(|c| c["effect"].as_str().unwrap()).collect();
    assert!(cause["probability"].as_f64().unwrap() < 0.9 && possible.contains(&"base_coulomb_drag"), "{cause}");
    succeed(&["next-experiment", &path("undecided"), "--plant", &path("plant.toml"), "--out", &path("next.toml")]);
    let second = fly("next.toml", "9", "second");
    let (said, causes) = diagnose(&[&first, &second], "decided");
    assert_eq!((causes.as_array().unwrap().len(), &causes[0]["effect"]), (1, &"base_coulomb_drag".into()), "{said}");
    assert!(causes[0]["probability"].as_f64().unwrap() > 0.9, "{said}");
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
