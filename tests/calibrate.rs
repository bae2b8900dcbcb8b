//! `fss calibrate` as a user calls it: the answers, and what it says of data that cannot answer.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{json, refused, succeed};
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
    assert!(said.contains("poses of the end-effector: 6 at rest"), "{said}");
    refused(&["calibrate", "plan", "--plant", &plant(), "--out", &mission, "--poses", "2"], &["3 are the fewest"]);
}

/// The laboratory's arm is not the one of the plant file: what the flight finds is the laboratory's.
#[test]
fn a_flight_that_calibrates_finds_the_laboratorys_arm_and_leaves_a_plant_file_that_flies() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let truth = [
        ("link[1..3].length_m", 0.379, 0.3825),
        ("link[4].length_m", 0.337, 0.3351),
        ("base.joint1_x_m", 0.204, 0.2058),
        ("base.joint1_y_m", 0.0175, 0.0155),
        ("base.joint1_angle_rad", 0.33, 0.317_841_91),
        ("link[2].joint_offset_rad", 0.08, 0.101_246_55),
        ("link[3].joint_offset_rad", -0.04, -0.059_376_101),
        ("link[4].joint_offset_rad", -0.03, -0.024_277_53),
    ];
    let laboratory = std::fs::read_to_string(plant()).unwrap();
    let laboratory = laboratory
        .replace("length_m = 0.3825", "length_m = 0.379")
        .replace("length_m = 0.3351", "length_m = 0.337")
        .replace("[0.2058, 0.0155]", "[0.204, 0.0175]")
        .replace("joint1_angle_rad = 0.317841910", "joint1_angle_rad = 0.33")
        .replace("joint_offset_rad = 0.101246550", "joint_offset_rad = 0.08")
        .replace("joint_offset_rad = -0.059376101", "joint_offset_rad = -0.04")
        .replace("joint_offset_rad = -0.024277530", "joint_offset_rad = -0.03");
    std::fs::write(path("laboratory.toml"), laboratory).unwrap();
    let (mut inside, mut worst) = (0, 0.0_f64);
    for seed in ["1", "2", "3"] {
        let run = path(seed);
        let laboratory = path("laboratory.toml");
        let flight =
            ["run", "calibrate", "--fast", "--quiet", "--laboratory", &laboratory, "--seed", seed, "--out", &run];
        let said = succeed(&flight);
        assert!(said.contains("poses of the end-effector: 13 at rest"), "{said}");
        let calibration = &json(&folder.path().join(seed).join("summary.json"))["calibration"];
        for (name, truth, believed) in truth {
            let p = &calibration["parameters"][name];
            let interval: Vec<f64> = serde_json::from_value(p["interval_95"].clone()).unwrap();
            let (value, std) = (p["value"].as_f64().unwrap(), p["std"].as_f64().unwrap());
            println!("seed {seed}: {name:<28} {value:.5} std {std:.5}, off by {:.2}", (value - truth) / std);
            assert!((value - truth).abs() < 0.1 * (believed - truth).abs(), "{name}: {p}");
            inside += usize::from((interval[0]..=interval[1]).contains(&truth));
            worst = worst.max((value - truth).abs() / std);
        }
    }
    assert!(
        inside >= 20 && worst < 4.0,
        "{inside} of 24 intervals hold the truth, the worst error is {worst} deviations"
    );
    // The command says of the log what the flight has said.
    let (again, calibrated) = (path("again.toml"), path("1/calibrated.toml"));
    succeed(&["calibrate", "kinematic", &path("1"), "--plant", &plant(), "--out", &again]);
    assert_eq!(std::fs::read_to_string(&again).unwrap(), std::fs::read_to_string(&calibrated).unwrap());
    succeed(&["run", "reach", "--fast", "--quiet", "--plant", &calibrated, "--out", &path("reach")]);
    let replayed = succeed(&["replay", &path("1/run.mcap")]);
    assert!(replayed.lines().any(|line| line.starts_with("calibration ") && line.ends_with(" 0")), "{replayed}");
}

#[test]
fn only_a_mission_that_asks_for_it_starts_the_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    succeed(&["run", "hold", "--fast", "--quiet", "--out", &path("hold")]);
    let steps = |run: &str| succeed(&["replay", &format!("{run}/run.mcap")]);
    assert!(!steps(&path("hold")).contains("calibration"));
    assert!(!folder.path().join("hold/calibrated.toml").exists());
    let hold = include_str!("../deploy/etc/missions/hold.toml");
    std::fs::write(path("odd.toml"), format!("services = [\"lunch\"]\n{hold}")).unwrap();
    refused(&["run", &path("odd.toml"), "--fast"], &["odd.toml:1", "asks for the service 'lunch'"]);
}

/// Logs of flights: joints ripple with their commands, links keep clocks of their own, air moves in the room.
#[test]
fn intervals_from_flown_excitations_hold_the_laboratorys_truth_with_joint_offsets_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let laboratory = std::fs::read_to_string(plant())
        .unwrap()
        .replace("joint_offset_rad = 0.101246550", "joint_offset_rad = 0.08")
        .replace("joint_offset_rad = -0.059376101", "joint_offset_rad = -0.04")
        .replace("joint_offset_rad = -0.024277530", "joint_offset_rad = -0.03");
    std::fs::write(path("laboratory.toml"), laboratory).unwrap();
    let mut truth = vec![("link[1..3].length_m".to_owned(), 0.3825), ("link[4].length_m".to_owned(), 0.3351)];
    truth.extend([("base.joint1_x_m".to_owned(), 0.2058), ("base.joint1_y_m".to_owned(), 0.0155)]);
    truth.extend([("base.joint1_angle_rad".to_owned(), 0.317_841_91), ("base.inertia_kg_m2".to_owned(), 0.25)]);
    truth.extend((2..).zip([0.08, -0.04, -0.03]).map(|(i, q)| (format!("link[{i}].joint_offset_rad"), q)));
    truth.extend((1..).zip([0.191, 0.191, 0.191, 0.168]).map(|(i, b)| (format!("link[{i}].com_to_next_joint_m"), b)));
    truth.extend((1..=4).map(|i| (format!("link[{i}].inertia_kg_m2"), 0.034)));
    let (mut inside, mut all, mut squares, mut of_lengths) = (0, 0, 0.0, 0.0);
    let flights = 12;
    for seed in 0..flights {
        let (run, laboratory, seed) = (path(&format!("{seed}")), path("laboratory.toml"), format!("{}", 100 + seed));
        let fly = ["run", "experiment-excitation", "--fast", "--quiet", "--laboratory", &laboratory, "--seed", &seed];
        succeed(&[&fly[..], &["--out", &run]].concat());
        let (out, answer) = (path("out.toml"), path("answer.json"));
        succeed(&["calibrate", "dynamic", &run, "--plant", &plant(), "--out", &out, "--json", &answer]);
        let answer = json(Path::new(&answer));
        for (name, truth) in &truth {
            let p = &answer["parameters"][name];
            if p.is_null() {
                continue; // so much air moved in this flight that it was not determined, and got no number
            }
            let interval: Vec<f64> = serde_json::from_value(p["interval_95"].clone()).unwrap();
            let off = (p["value"].as_f64().unwrap() - truth) / p["std"].as_f64().unwrap();
            inside += usize::from((interval[0]..=interval[1]).contains(truth));
            all += 1;
            squares += off * off;
            of_lengths += if name.ends_with("length_m") { off * off / 2.0 / f64::from(flights) } else { 0.0 };
        }
    }
    let (coverage, rms) = (inside as f64 / all as f64, (squares / all as f64).sqrt());
    println!("coverage {coverage:.3} of {all}, errors {rms:.2} deviations RMS, of lengths {:.2}", of_lengths.sqrt());
    assert!(all >= 170 && (0.91..0.99).contains(&coverage) && of_lengths.sqrt() < 1.35);
}
