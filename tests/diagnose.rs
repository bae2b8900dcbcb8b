//! The simulation meets measured data: where is it wrong?
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

fn data(case: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data").join(case)
}

/// A case beside the repository, if the cases are there.
fn shared(case: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/measured/cases").join(case);
    if path.is_dir() {
        return Some(path);
    }
    common::skipped(&format!("no {case} beside the repository"));
    None
}

/// Diagnoses the runs of a case whose name says validation, or all where none does.
fn diagnose(case: &Path) -> Value {
    let mut runs: Vec<PathBuf> = std::fs::read_dir(case).unwrap().map(|e| e.unwrap().path()).collect();
    runs.retain(|path| path.is_dir());
    runs.sort();
    let (validation, fitted): (Vec<_>, Vec<_>) =
        runs.into_iter().partition(|p| p.to_string_lossy().contains("validation"));
    let out = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_fss"));
    command.arg("diagnose").args(&fitted).arg("--plant").arg(case.join("plant.toml")).arg("--out").arg(out.path());
    if !validation.is_empty() {
        command.arg("--validate").args(&validation);
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let page = std::fs::read_to_string(out.path().join("diagnosis.html")).unwrap();
    assert!(page.contains("<svg") && !page.contains("http"), "the page is self-contained");
    serde_json::from_str(&std::fs::read_to_string(out.path().join("diagnosis.json")).unwrap()).unwrap()
}

/// A figure of each run's channel.
fn of<'a>(diagnosis: &'a Value, channel: &'a str, figure: &'a str) -> impl Iterator<Item = (&'a str, f64)> {
    let misfit = diagnosis["misfit"].as_array().unwrap().iter();
    misfit
        .filter(move |m| m["channel"] == channel)
        .map(move |m| (m["run"].as_str().unwrap(), m[figure].as_f64().unwrap()))
}

fn assert_base_within_noise(diagnosis: &Value) {
    for channel in ["base_x", "base_y", "base_theta", "gyro"] {
        for (run, ratio) in of(diagnosis, channel, "ratio") {
            assert!(ratio < 1.3, "{channel} of {run}: {ratio}");
        }
    }
    assert_eq!(diagnosis["verdict"], "consistent");
}

#[test]
fn another_engines_coasting_base_is_simulated_to_its_noise() {
    assert_base_within_noise(&diagnose(&data("dev-clean")));
}

#[test]
fn a_tilted_table_stands_out_where_it_acts_and_is_named() {
    let diagnosis = diagnose(&data("dev-tilt"));
    assert!(of(&diagnosis, "base_x", "ratio").all(|(_, r)| r > 4.0));
    assert!(of(&diagnosis, "base_y", "ratio").all(|(_, r)| r > 2.5));
    assert!(of(&diagnosis, "base_theta", "ratio").all(|(_, r)| r < 2.0), "a tilt turns nothing");
    let cause = &diagnosis["causes"][0];
    assert_eq!((diagnosis["causes"].as_array().unwrap().len(), &cause["effect"]), (1, &Value::from("table_tilt")));
    // The case's truth.json.
    assert_within(&cause["parameters"]["accel_x_m_s2"]["value"], 0.0021, 0.05);
    assert_within(&cause["parameters"]["accel_y_m_s2"]["value"], -0.0013, 0.05);
}

#[test]
fn a_weak_thruster_hidden_by_another_engine_is_found_and_the_extended_model_predicts() {
    let diagnosis = diagnose(&data("dev-thruster"));
    let cause = &diagnosis["causes"][0];
    assert_eq!((&cause["effect"], &cause["index"]), (&Value::from("thruster_gain"), &Value::from(3)));
    assert_eq!(diagnosis["causes"].as_array().unwrap().len(), 1);
    // The case's truth.json.
    assert_within(&cause["parameters"]["scale"]["value"], 0.72, 0.05);
    let gain = |key: &str| diagnosis["gain"][key].as_f64().unwrap();
    assert!(gain("ratio_after") < gain("ratio_before"), "{} -> {}", gain("ratio_before"), gain("ratio_after"));
}

/// Rewrites the rows of a run's valves, each a time and the levels of all.
fn rewrite_valves(run: &Path, rewrite: impl Fn(Vec<(f64, Vec<String>)>) -> Vec<(f64, Vec<String>)>) {
    let file = run.join("valves.csv");
    let text = std::fs::read_to_string(&file).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let row = |row: &str| {
        let mut fields = row.split(',').map(str::to_owned);
        (fields.next().unwrap().parse().unwrap(), fields.collect())
    };
    let rows = rewrite(rows.lines().map(row).collect());
    let rows: Vec<String> = rows.into_iter().map(|(t_s, levels)| format!("{t_s},{}", levels.join(","))).collect();
    std::fs::write(file, format!("{header}\n{}\n", rows.join("\n"))).unwrap();
}

const THRUSTER_RUNS: [&str; 3] = ["run-4-thrusters", "run-5-mixed", "run-6-validation"];

#[test]
fn commands_shuffled_in_one_run_get_no_confident_wrong_name() {
    // The valves of one run under the motion of another: no cause can be true of these data.
    let case = tempfile::tempdir().unwrap();
    copy(&data("dev-thruster"), case.path());
    let reversed = |(t_s, levels): (f64, Vec<String>)| (t_s, levels.into_iter().rev().collect());
    rewrite_valves(&case.path().join("run-4-thrusters"), |rows| rows.into_iter().map(reversed).collect());
    let diagnosis = diagnose(case.path());
    assert!(diagnosis["verdict"] == "unexplained" || diagnosis["verdict"] == "partly_explained", "{diagnosis}");
}

#[test]
fn a_harness_plugged_in_anyhow_is_told_line_by_line_and_hides_no_weak_thruster() {
    let case = tempfile::tempdir().unwrap();
    copy(&data("dev-thruster"), case.path());
    // What opened thruster WIRED[i] is now called command i.
    const WIRED: [usize; 8] = [3, 6, 1, 5, 7, 0, 4, 2];
    let renamed = |(t_s, levels): (f64, Vec<String>)| (t_s, WIRED.map(|j| levels[j].clone()).to_vec());
    for run in THRUSTER_RUNS {
        rewrite_valves(&case.path().join(run), |rows| rows.into_iter().map(renamed).collect());
    }
    let diagnosis = diagnose(case.path());
    let mut lines: Vec<usize> = (0..8).collect();
    let (exchanges, rest): (Vec<&Value>, Vec<&Value>) =
        diagnosis["causes"].as_array().unwrap().iter().partition(|cause| cause["effect"] == "valve_swap");
    for exchange in exchanges {
        let other = exchange["parameters"]["other_index"]["value"].as_f64().unwrap();
        lines.swap(exchange["index"].as_u64().unwrap() as usize - 1, other as usize - 1);
    }
    assert_eq!(WIRED.map(|j| lines[j]), [0, 1, 2, 3, 4, 5, 6, 7], "{}", diagnosis["causes"]);
    assert!(matches!(rest[..], [one] if one["effect"] == "thruster_gain" && one["index"] == 3), "{rest:?}");
    assert_within(&rest[0]["parameters"]["scale"]["value"], 0.72, 0.02);
}

#[test]
fn commands_of_another_time_are_told_as_such_and_nothing_is_asserted() {
    let case = tempfile::tempdir().unwrap();
    copy(&data("dev-thruster"), case.path());
    for run in THRUSTER_RUNS {
        rewrite_valves(&case.path().join(run), |rows| {
            let until_s = rows.last().unwrap().0;
            let mut moved: Vec<_> = rows.into_iter().map(|(t_s, levels)| ((t_s + 11.0) % until_s, levels)).collect();
            moved.sort_by(|a, b| a.0.total_cmp(&b.0));
            moved.dedup_by(|a, b| a.0 == b.0);
            moved
        });
    }
    let diagnosis = diagnose(case.path());
    assert_eq!(diagnosis["verdict"], "unexplained");
    assert_eq!(diagnosis["causes"], Value::Array(vec![]));
    assert!(diagnosis["remarks"][0].as_str().unwrap().contains("no command of a thruster shows"), "{diagnosis}");
}

#[test]
fn a_tilt_is_named_without_gyro_from_few_frames_of_which_some_are_empty() {
    let case = tempfile::tempdir().unwrap();
    copy(&data("dev-tilt"), case.path());
    let run = case.path().join("run-1-coast");
    std::fs::remove_file(run.join("gyro.csv")).unwrap();
    // One frame in eight; where the cameras lose the body they say that it is at the origin.
    let poses = std::fs::read_to_string(run.join("base_pose.csv")).unwrap();
    let mut rows = poses.lines();
    let mut few = vec![rows.next().unwrap().to_owned()];
    for (k, row) in rows.step_by(8).enumerate() {
        let time = row.split(',').next().unwrap();
        few.push(if (100..110).contains(&k) { format!("{time},0,0,0") } else { row.to_owned() });
    }
    std::fs::write(run.join("base_pose.csv"), few.join("\n") + "\n").unwrap();

    let diagnosis = diagnose(case.path());
    assert_eq!(diagnosis["causes"].as_array().unwrap().len(), 1, "{diagnosis}");
    let cause = &diagnosis["causes"][0];
    assert_eq!(cause["effect"], "table_tilt");
    assert_within(&cause["parameters"]["accel_x_m_s2"]["value"], 0.0021, 0.1);
    assert!(diagnosis["remarks"].to_string().contains("10 frames without a body"), "{}", diagnosis["remarks"]);
}

/// A drive follows its command to hundredths of a radian, which the base notices: an arm that moves unseen tells nothing.
#[test]
fn a_weak_thruster_is_named_though_the_arm_is_not_measured() {
    let case = tempfile::tempdir().unwrap();
    copy(&data("dev-thruster"), case.path());
    for run in ["run-4-thrusters", "run-5-mixed"] {
        std::fs::remove_file(case.path().join(run).join("joints.csv")).unwrap();
    }
    let diagnosis = diagnose(case.path());
    let cause = &diagnosis["causes"][0];
    assert_eq!((diagnosis["causes"].as_array().unwrap().len(), &cause["effect"]), (1, &Value::from("thruster_gain")));
    assert_eq!(cause["index"], 3);
    assert_within(&cause["parameters"]["scale"]["value"], 0.72, 0.05);
    assert!(diagnosis["remarks"].to_string().contains("no telemetry of the arm in run-4-thrusters, run-5-mixed"));
}

/// Cases beside the repository whose truth is known: the right names and no more, or an honest "unexplained".
#[test]
fn measured_cases_are_named_right() {
    let cases = ["dev-friction", "dev-room-clean", "dev-room-drag", "dev-unknown"];
    // An arm of two links with another gear and rate, and two vehicles without an arm.
    for name in cases.into_iter().chain(["dev-other-01", "dev-other-05", "dev-other-10"]) {
        let Some(case) = shared(name) else { continue };
        let truth: Value = serde_json::from_str(&std::fs::read_to_string(case.join("truth.json")).unwrap()).unwrap();
        let diagnosis = diagnose(&case);
        let named = |causes: &Value| -> Vec<String> {
            let mut all: Vec<String> =
                causes.as_array().unwrap().iter().map(|c| format!("{} {}", c["effect"], c["index"])).collect();
            all.sort();
            all
        };
        let wanted = named(&truth["causes"]);
        if wanted.iter().any(|w| w.contains("unmodelled")) {
            assert_eq!((&diagnosis["verdict"], named(&diagnosis["causes"]).len()), (&Value::from("unexplained"), 0));
        } else {
            assert_eq!(named(&diagnosis["causes"]), wanted, "{name}");
            assert!(diagnosis["gain"]["ratio_after"].as_f64().unwrap() < 1.3, "{name}");
        }
    }
}

fn assert_within(value: &Value, truth: f64, share: f64) {
    let value = value.as_f64().unwrap();
    assert!((value / truth - 1.0).abs() < share, "{value}, true {truth}");
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).unwrap();
        }
    }
}

#[test]
fn a_moving_arm_and_firing_thrusters_are_simulated_to_the_noise() {
    for case in ["dev-clean", "dev-room-clean"] {
        let Some(case) = shared(case) else { continue };
        assert_base_within_noise(&diagnose(&case));
    }
}

#[test]
fn real_arms_without_friction_in_their_model_lack_friction() {
    for (name, wanted) in [
        // Its owners publish dry friction on both joints.
        ("real-double-pendulum", Some(vec!["joint_coulomb_friction 1", "joint_coulomb_friction 2"])),
        ("real-single-swing", None),
        ("real-double-swing", None),
    ] {
        let Some(case) = shared(name) else { continue };
        let diagnosis = diagnose(&case);
        let causes = diagnosis["causes"].as_array().unwrap();
        let mut names: Vec<String> =
            causes.iter().map(|c| format!("{} {}", c["effect"].as_str().unwrap(), c["index"])).collect();
        names.sort();
        println!("{name}: {names:?}, {}", diagnosis["gain"]);
        assert!(!names.is_empty() && names.iter().all(|name| name.contains("friction")), "{names:?}");
        assert!(wanted.is_none_or(|wanted| names == wanted), "{names:?}");
        let gain = |when: &str| diagnosis["gain"][when].as_f64().unwrap();
        assert!(gain("ratio_after") < 0.8 * gain("ratio_before"), "the validation runs are predicted better");
    }
}

#[test]
fn a_damaged_file_is_named_with_its_row_and_column() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    std::fs::create_dir(&run).unwrap();
    std::fs::write(run.join("run.toml"), "format = \"fss-experiment/1\"\nname = \"x\"\njoint_mode = \"none\"\n")
        .unwrap();
    std::fs::write(run.join("base_pose.csv"), "t_s,x_m,y_m,theta_rad\n0,0,0,0\n0.01,0,oops,0\n").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_fss"))
        .arg("diagnose")
        .arg(&run)
        .arg("--plant")
        .arg(data("dev-clean").join("plant.toml"))
        .arg("--out")
        .arg(folder.path().join("out"))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).replace(['\n', ' ', '│'], "");
    assert!(!output.status.success() && said.contains("base_pose.csv:3:column'y_m':'oops'isnonumber"), "{said}");
}
