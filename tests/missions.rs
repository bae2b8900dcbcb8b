//! Whole missions: stopping a tumbling vehicle, capturing a target, and what happens where that cannot be.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{fss, json, refused, succeed, text};
use std::path::{Path, PathBuf};

const CAPTURE: &str = include_str!("../deploy/etc/missions/capture.toml");
const SERVICE: &str = include_str!("../deploy/etc/missions/service.toml");

fn number(value: &serde_json::Value, path: &str) -> f64 {
    path.split('.').fold(value, |v, key| &v[key]).as_f64().unwrap_or_else(|| panic!("no number {path} in {value}"))
}

fn vector(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// The summary of a fast flight.
fn flown(folder: &Path, mission: &str, seed: u32) -> serde_json::Value {
    println!("{mission}, seed {seed}");
    let out = folder.join(format!("{seed}"));
    succeed(&["run", mission, "--fast", "--quiet", "--seed", &seed.to_string(), "--out", out.to_str().unwrap()]);
    json(&out.join("summary.json"))
}

fn mission_file(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("mission-test.toml");
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_tumbling_vehicle_is_stopped_with_the_least_gas() {
    let folder = tempfile::tempdir().unwrap();
    for seed in 1..=5 {
        let s = flown(folder.path(), "detumble", seed);
        assert_eq!(s["outcome"], "done");
        let [before, after] = [vector(&s["stop"]["rate_deg_s"])[0], vector(&s["stop"]["rate_deg_s"])[1]];
        assert!(before.abs() > 3.9 && after.abs() < 0.3, "{s}");
        assert!(vector(&s["stop"]["speed_m_s"])[1] < 0.005, "{s}");
        let ratio = number(&s, "stop.ratio");
        // Below one by no more than what it leaves of the motion.
        assert!((0.93..1.1).contains(&ratio), "gas is {ratio} of the least: {s}");
    }
}

#[test]
fn a_drifting_target_is_captured_and_momentum_goes_nowhere() {
    let folder = tempfile::tempdir().unwrap();
    for seed in 1..=4 {
        let s = flown(folder.path(), "capture", seed);
        let c = &s["capture"];
        assert_eq!((&s["outcome"], &c["success"]), (&"done".into(), &true.into()), "{s}");
        assert!(number(c, "miss_m") <= 0.003 && number(c, "contact_speed_m_s") <= 0.01, "{c}");
        assert!(number(c, "base_turned_deg") < 2.0 && number(c, "room_on_table_m") > 0.1, "{c}");
        let (before, after) = (vector(&c["momentum_before"]), vector(&c["momentum_after"]));
        assert!(before.iter().any(|p| p.abs() > 1e-3), "something moved: {c}");
        for (before, after) in before.iter().zip(&after) {
            assert!((before - after).abs() < 1e-9, "{c}");
        }
        assert!(vector(&s["stop"]["speed_m_s"])[1] < 0.005, "the compound stands: {s}");
    }
}

#[test]
fn a_part_is_fetched_carried_along_its_path_and_left_at_rest() {
    let folder = tempfile::tempdir().unwrap();
    for seed in 1..=3 {
        let s = flown(folder.path(), "service", seed);
        let c = &s["carry"];
        assert_eq!((&s["outcome"], &c["success"]), (&"done".into(), &true.into()), "{s}");
        assert!(number(c, "path_m") > 1.0 && number(c, "deviation_max_m") < 0.03, "{c}");
        // The laboratory's own truth of the part, long after it was let go.
        assert!(number(c, "placed_error_m") <= 0.01 && number(c, "left_speed_m_s") < 0.003, "{c}");
        assert_eq!(s["capture"]["success"], true, "{s}");
    }
    succeed(&["replay", folder.path().join("3/run.mcap").to_str().unwrap()]);
}

#[test]
fn what_nobody_holds_is_not_carried() {
    let folder = tempfile::tempdir().unwrap();
    let never = SERVICE.replace("gripper = \"closed\"\n", "");
    let path = mission_file(folder.path(), &never);
    let out = folder.path().join("never");
    let words = ["nothing can be carried here: the gripper is open", "mission-test.toml:74"];
    refused(&["run", path.to_str().unwrap(), "--fast", "--out", out.to_str().unwrap()], &words);
    // In flight: the last link dies on the way, and with it the gripper's word.
    let fault = "\n[[fault]]\nfrom_s = 110\nto_s = 500\nkind = { link_dead = { link = 4 } }\n";
    let path = mission_file(folder.path(), &format!("{SERVICE}{fault}"));
    let output = fss(&["run", path.to_str().unwrap(), "--fast", "--quiet", "--out", out.to_str().unwrap()]);
    assert!(!output.status.success(), "an aborted mission is no success");
    let s = json(&out.join("summary.json"));
    assert_eq!((&s["outcome"], &s["carry"]["success"]), (&"aborted".into(), &false.into()), "{s}");
}

#[test]
fn a_capture_is_replayed_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    flown(folder.path(), "capture", 2);
    let log = folder.path().join("2/run.mcap");
    let said = succeed(&["replay", log.to_str().unwrap()]);
    assert!(said.contains("mission") && said.contains("base"), "{said}");
}

#[test]
fn a_target_that_is_lost_is_left_by_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let fault = "\n[[fault]]\nfrom_s = 40\nto_s = 500\nkind = { mocap_zeros = { object = \"target\" } }\n";
    let mission = mission_file(folder.path(), &format!("{CAPTURE}{fault}"));
    let out = folder.path().join("out");
    let arguments = ["run", mission.to_str().unwrap(), "--fast", "--quiet", "--out", out.to_str().unwrap()];
    let output = fss(&arguments);
    assert!(!output.status.success(), "an aborted mission is no success");
    assert!(text(&output.stdout).contains("the target is lost"), "{}", text(&output.stdout));
    let s = json(&out.join("summary.json"));
    assert_eq!((&s["outcome"], &s["capture"]["success"]), (&"aborted".into(), &false.into()), "{s}");
    // 40 s until it is lost, and then the 30 s of backing off.
    assert!((70.0..80.0).contains(&number(&s, "duration_s")), "{s}");
    let events: Vec<_> = s["warnings"].as_array().unwrap().iter().map(|w| w.as_str().unwrap().to_owned()).collect();
    assert!(events.iter().any(|e| e.contains("its way out is flown")), "{events:?}");
}

#[test]
fn a_mission_that_leaves_the_table_is_refused_before_flight_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let refused_with = |text: &str, words: &[&str]| {
        let path = mission_file(folder.path(), text);
        let out = folder.path().join("never");
        refused(&["run", path.to_str().unwrap(), "--fast", "--out", out.to_str().unwrap()], words);
        assert!(!out.join("run.mcap").exists(), "it flew");
    };
    let phase = "[[phase]]\nduration_s = 100\nbase = { goal = \"free\" }\narm = { goal = \"hold\" }\n";
    let drifting = format!("name = \"drift\"\n[initial]\nvx_m_s = 0.05\n{phase}");
    refused_with(&drifting, &["leaves the table after", "mission-test.toml:5"]);
    let beyond = format!("name = \"edge\"\n[initial]\nx_m = 0.9\n{phase}");
    refused_with(&beyond, &["joint 4 is off the table at the start", "mission-test.toml:3"]);
    let thirsty = CAPTURE
        .replace("gas_g = 60", "gas_g = 0.5")
        .replace("\"meet\", standoff_m = 0.1", "\"goto\", x_m = 0.5, relative = true");
    refused_with(&thirsty, &["g of gas", "[limits] gas_g allows 0.5 g"]);
    let aimless = CAPTURE.replace("on_abort = \"back off\"", "on_abort = \"give up\"");
    refused_with(&aimless, &["there is no [[abort]] phase named 'give up'", "back off"]);
}
