//! Faults on purpose, and a host that is looked at before it flies.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::fss;
use std::path::Path;
use std::process::Command;

fn summary(folder: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(folder.join("summary.json")).unwrap()).unwrap()
}

fn fly(mission: &str, more: &[&str]) -> serde_json::Value {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let output = fss(&[&["run", mission, "--fast", "--quiet", "--out", out], more].concat());
    assert!(output.status.success(), "{more:?}: {}", String::from_utf8_lossy(&output.stderr));
    summary(folder.path())
}

fn navigation_m(summary: &serde_json::Value) -> f64 {
    summary["navigation"]["position_rms_m"].as_f64().unwrap()
}

#[test]
fn a_rough_day_is_flown_to_its_end_and_every_trouble_is_told() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../deploy/etc/faults/rough.toml");
    let s = fly("hold", &["--faults", path]);
    assert_eq!(s["outcome"], "done");
    assert!(navigation_m(&s) < 1e-3, "{s}");
    let warnings = s["warnings"].to_string();
    for trouble in ["motion capture is missing", "the gyro is missing or faulty", "torque sensor saturated"] {
        assert!(warnings.contains(trouble), "{trouble}: {warnings}");
    }
}

#[test]
fn the_same_fault_seed_gives_the_same_flight_and_another_gives_another() {
    let first = fly("zero-reaction", &["--fault-seed", "11"]);
    assert_eq!(first["outcome"], "done");
    assert_eq!(first, fly("zero-reaction", &["--fault-seed", "11"]));
    assert!(first != fly("zero-reaction", &["--fault-seed", "12"]));
}

#[test]
fn a_thruster_that_does_not_open_is_missed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stuck.toml");
    let stuck =
        |n| format!("[[fault]]\nfrom_s = 0\nto_s = 100\nkind = {{ valve_stuck_shut = {{ thruster = {n} }} }}\n");
    std::fs::write(&path, (1..=8).map(stuck).collect::<String>()).unwrap();
    let s = fly("slew", &["--faults", path.to_str().unwrap()]);
    assert!(s["gas_used_kg"].as_f64().unwrap() == 0.0, "{s}");
    assert!(s["base_rotation_deg"]["end_deg"].as_f64().unwrap().abs() < 5.0, "nothing turns it: {s}");
}

#[test]
fn a_mission_file_brings_its_own_faults() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("blind.toml");
    let fault = "[[fault]]\nfrom_s = 4\nto_s = 4.8\nkind = \"mocap_silent\"\n";
    std::fs::write(&path, format!("{}\n{fault}", include_str!("../deploy/etc/missions/hold.toml"))).unwrap();
    let s = fly(path.to_str().unwrap(), &[]);
    assert!(s["warnings"].to_string().contains("motion capture is missing"), "{s}");
    let none = folder.path().join("none.toml");
    std::fs::write(&none, "").unwrap();
    let s = fly(path.to_str().unwrap(), &["--faults", none.to_str().unwrap()]);
    assert!(!s["warnings"].to_string().contains("motion capture is missing"), "a fault file replaces them: {s}");
}

#[test]
fn faults_that_make_no_sense_are_refused_with_their_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wrong.toml");
    let refused = |text: &str, words: &str| {
        std::fs::write(&path, text).unwrap();
        let output = fss(&["run", "hold", "--fast", "--faults", path.to_str().unwrap(), "--out", "/nonexistent/out"]);
        // The frame around an error breaks lines: compare without it.
        let plain = |text: &str| text.replace([' ', '\n', '│'], "");
        let said = plain(&String::from_utf8_lossy(&output.stderr));
        assert!(!output.status.success() && said.contains("wrong.toml") && said.contains(&plain(words)), "{said}");
    };
    refused("[[fault]]\nfrom_s = 1\nto_s = 2\nkind = \"mocap_asleep\"\n", "mocap_asleep");
    refused("[[fault]]\nfrom_s = 1\nto_s = 2\nkind = { link_dead = { link = 9 } }\n", "links are 1 to 4");
    refused("[network.mocap]\nloss = 2\n", "between 0 and 1");
}

#[test]
fn what_is_wrong_with_a_host_comes_with_its_fix() {
    let output = fss(&["host", "check", "--json"]);
    let findings: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let findings = findings.as_array().unwrap();
    for what in ["kernel", "privileges", "isolation", "governor", "shared memory", "clock"] {
        let finding = findings.iter().find(|f| f["what"] == what).unwrap();
        assert_eq!(finding["verdict"] == "good", finding["fix"] == "", "{finding}");
    }
    let unfit = findings.iter().any(|f| f["verdict"] == "unfit");
    assert_eq!(output.status.success(), !unfit);
}

#[test]
fn top_shows_every_service_of_a_running_stack() {
    let folder = tempfile::tempdir().unwrap();
    let launch = folder.path().join("launch-test.toml");
    let text = include_str!("../deploy/etc/launch/lab.toml").replace("51001", "53410").replace("5110", "5342");
    std::fs::write(&launch, text).unwrap();
    let out = folder.path().join("out");
    let mut run = Command::new(env!("CARGO_BIN_EXE_fss"))
        .args(["run", "hold", "--quiet", "--launch", launch.to_str().unwrap(), "--out", out.to_str().unwrap()])
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_secs(3));
    let top = fss(&["top", "--once", "--bus", &format!("fss_{}_", run.id())]);
    assert!(Command::new("kill").args(["-INT", &run.id().to_string()]).status().unwrap().success());
    assert!(run.wait().unwrap().success());
    let shown = String::from_utf8_lossy(&top.stdout).into_owned();
    for service in ["recorder", "lab", "thrusters", "fusion", "links", "arm", "base", "mission", "navigation", "link 4"]
    {
        assert!(shown.lines().any(|line| line.starts_with(service)), "{service}: {shown}");
    }
    assert!(!shown.contains("SILENT"), "{shown}");
}

#[test]
fn a_soak_reports_every_figure() {
    let folder = tempfile::tempdir().unwrap();
    let launch = folder.path().join("launch-test.toml");
    let text = include_str!("../deploy/etc/launch/lab.toml").replace("51001", "53210").replace("5110", "5322");
    std::fs::write(&launch, text).unwrap();
    let json = folder.path().join("soak.json");
    let (launch, json) = (launch.to_str().unwrap(), json.to_str().unwrap());
    let args =
        ["soak", "--minutes", "0.3", "--seed", "5", "--blows-per-minute", "30", "--launch", launch, "--json", json];
    let output = fss(&args);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let soak: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    let number = |key: &str| soak[key].as_f64().unwrap_or_else(|| panic!("no number {key}: {soak}"));
    let told =
        ["overruns", "lost_records", "rss_growth_bytes", "shm_leaked_bytes", "valve_open_after_command_loss_ms_max"];
    for key in told {
        number(key);
    }
    assert!(number("cycles") > 10_000.0 && number("restarts") > 0.0, "{soak}");
    assert!(number("valve_open_while_world_ran_ms_max") <= 110.0, "{soak}");
    assert!(number("navigation_rms_m") > 0.0 && number("navigation_rms_m") < 0.01, "{soak}");
    assert_eq!((number("unreadable_logs"), soak["ended_early"].as_array().unwrap().len()), (0.0, 0), "{soak}");
}
