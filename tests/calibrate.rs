//! `fss calibrate` as a user calls it: the answers, and what it says of data that cannot answer.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{refused, succeed};
use std::fmt::Write;
use std::path::{Path, PathBuf};

fn plant() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/etc/plants/fss.toml").to_string_lossy().into_owned()
}

/// A run whose joints stand still while the base drifts.
fn resting_run(folder: &Path) -> PathBuf {
    let run = folder.join("rest");
    std::fs::create_dir_all(&run).unwrap();
    let write = |name: &str, text: String| std::fs::write(run.join(name), text).unwrap();
    write(
        "run.toml",
        "format = \"fss-experiment/1\"\nname = \"rest\"\nduration_s = 10\njoint_mode = \"position\"\nplant = \"../plant.toml\"\n".into(),
    );
    let mut base = "t_s,x_m,y_m,theta_rad\n".to_owned();
    (0..1000).for_each(|k| writeln!(base, "{},{},0.1,0.2", 0.01 * f64::from(k), 1e-4 * f64::from(k)).unwrap());
    write("base_pose.csv", base);
    let mut joints = "t_s,q1_rad,q2_rad,q3_rad,q4_rad\n".to_owned();
    (0..50).for_each(|k| writeln!(joints, "{},0.1,0.2,0.3,0.4", 0.2 * f64::from(k)).unwrap());
    write("joints.csv", joints);
    run
}

#[test]
fn a_flown_excitation_gives_masses_their_places_and_a_plant_file_that_flies() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    succeed(&["run", "experiment-excitation", "--fast", "--quiet", "--out", &path("run")]);
    let (out, json) = (path("calibrated.toml"), path("answer.json"));
    let said = succeed(&["calibrate", "dynamic", &path("run"), "--plant", &plant(), "--out", &out, "--json", &json]);
    assert!(said.contains("weighed") && said.contains("link[2].inertia_kg_m2"), "{said}");
    let answer: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!((answer["format"].as_str(), answer["kind"].as_str()), (Some("fss-calibration/1"), Some("dynamic")));
    // The laboratory that flew it has the plant file's values.
    for (name, truth) in [("link[2].com_to_next_joint_m", 0.191), ("link[4].com_to_next_joint_m", 0.168)] {
        let p = &answer["parameters"][name];
        let (value, std) = (p["value"].as_f64().unwrap(), p["std"].as_f64().unwrap());
        assert!((value - truth).abs() < 4.0 * std && std < 0.005, "{name}: {p}");
    }
    succeed(&["run", "hold", "--fast", "--quiet", "--plant", &out, "--out", &path("again")]);
    refused(
        &["calibrate", "dynamic", &path("run"), "--method", "attitude", "--plant", &plant(), "--out", &out],
        &["no maneuver moves one joint from rest to rest"],
    );
}

#[test]
fn data_that_determine_nothing_are_told_so() {
    let folder = tempfile::tempdir().unwrap();
    let run = resting_run(folder.path()).to_string_lossy().into_owned();
    let out = folder.path().join("out.toml").to_string_lossy().into_owned();
    refused(
        &["calibrate", "dynamic", &run, "--plant", &plant(), "--out", &out],
        &["no joint moves in these runs", "base_pose.csv"],
    );
    refused(
        &["calibrate", "kinematic", &run, "--plant", &plant(), "--out", &out],
        &["nothing to calibrate on", "ee_pose.csv"],
    );
    assert!(!Path::new(&out).exists());
}

#[test]
fn bad_input_names_its_file_and_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let run = resting_run(folder.path());
    let (out, bad) = (path("out.toml"), path("bad.toml"));
    refused(
        &["calibrate", "dynamic", &path("nowhere"), "--plant", &plant(), "--out", &out],
        &["nowhere", "neither a folder nor a log"],
    );
    std::fs::write(&bad, "[base]\nmass_kg = -1\n").unwrap();
    let run_path = run.to_string_lossy().into_owned();
    refused(&["calibrate", "dynamic", &run_path, "--plant", &bad, "--out", &out], &["bad.toml:2"]);
    std::fs::write(run.join("joints.csv"), "t_s,q1_rad\n0,0.1\n0.2,oops\n").unwrap();
    refused(&["calibrate", "dynamic", &run_path, "--plant", &plant(), "--out", &out], &["joints.csv", "oops"]);
}

#[test]
fn a_plan_tells_its_deviations_beforehand_and_is_a_mission_that_can_be_checked() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (mission, out) = (path("calibrate.toml"), path("calibrated.toml"));
    let said = succeed(&["calibrate", "plan", "--plant", &plant(), "--out", &mission, "--poses", "6"]);
    assert!(said.contains("link[2].joint_offset_rad"), "{said}");
    assert_eq!(std::fs::read_to_string(&mission).unwrap().matches("[[phase]]").count(), 6);
    succeed(&["run", &mission, "--fast", "--quiet", "--out", &path("run")]);
    let said = succeed(&["calibrate", "kinematic", &path("run"), "--plant", &plant(), "--out", &out]);
    assert!(said.contains("6 observations of the end-effector, still poses"), "{said}");
    refused(&["calibrate", "plan", "--plant", &plant(), "--out", &mission, "--poses", "2"], &["3 are the fewest"]);
}
