//! What knowing the plant is worth: a vehicle that knows what is wrong with its laboratory flies better in it.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::succeed;
use fss_messages::{TruthState, topic};
use fss_records::log::Log;
use std::path::Path;

/// The base holds its pose while the arm moves its tip along a line.
const REACH: &str = r#"
name = "steady-reach"
description = "A line of the end-effector while the base holds its pose on its thrusters."
[initial]
q_deg = [-30, 60, -60, 30]
x_m = -0.6
[[phase]]
name = "rest"
duration_s = 2
base = { goal = "hold" }
arm = { goal = "hold" }
[[phase]]
name = "line"
duration_s = 30
settle_s = 8
base = { goal = "hold" }
arm = { goal = "line", length_m = 0.1, direction_deg = 240 }
"#;

const NOMINAL: &str = include_str!("../deploy/etc/plants/fss.toml");

/// The plant file with a leaning table and a weak thruster.
fn faulty() -> String {
    let effects = "[[effect]]\nid = \"table_tilt\"\naccel_x_m_s2 = 0.0015\naccel_y_m_s2 = -0.001\n\n\
        [[effect]]\nid = \"thruster_gain\"\nindex = 3\nscale = 0.5\n\n[disturbance]";
    NOMINAL.replacen("[disturbance]", effects, 1)
}

/// RMS of the base's distance from where it shall stay, and its largest, by the laboratory's own truth, m.
fn deviation_m(log: &Path) -> (f64, f64) {
    let truth = Log::open(log).unwrap().samples::<TruthState>(topic::TRUTH_STATE.name).unwrap();
    let flown: Vec<&TruthState> = truth.iter().filter(|t| t.stamp_ns > 1_200_000_000).collect();
    let apart = |t: &&TruthState| (t.x_m - flown[0].x_m).hypot(t.y_m - flown[0].y_m);
    let squares: f64 = flown.iter().map(apart).map(|d| d * d).sum();
    ((squares / flown.len() as f64).sqrt(), flown.iter().map(apart).fold(0.0, f64::max))
}

#[test]
fn a_controller_that_learnt_of_the_tilt_and_the_weak_thruster_holds_the_base_better() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let write = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).unwrap();
        path(name)
    };
    let mission = write("reach.toml", REACH);
    let (nominal, laboratory) = (write("nominal.toml", NOMINAL), write("laboratory.toml", &faulty()));
    let fly = |mission: &str, plant: &str, seed: &str, name: &str| {
        let out = path(name);
        let vehicle = ["run", mission, "--fast", "--quiet", "--seed", seed, "--plant", plant];
        succeed(&[&vehicle[..], &["--laboratory", &laboratory, "--out", &out]].concat());
        out
    };

    // What is wrong is not told: it is found in the logs of four experiments.
    let experiments = ["experiment-coast", "experiment-single-joint", "experiment-thrusters", "experiment-mixed"];
    let logs: Vec<String> = experiments.iter().map(|name| fly(name, &nominal, "7", name)).collect();
    let found = path("found");
    let mut diagnose = vec!["diagnose", "--plant", &nominal, "--out", &found];
    diagnose.extend(logs.iter().map(String::as_str));
    succeed(&diagnose);
    let extended = path("found/extended.toml");

    // Thrusters that switch on and off make single flights differ by chance: it is six together that count.
    let (mut before_m2, mut after_m2, mut better) = (0.0, 0.0, 0);
    for seed in ["1", "2", "3", "4", "5", "6"] {
        let deviation = |plant: &str, name: &str| {
            deviation_m(&Path::new(&fly(&mission, plant, seed, &format!("{name}-{seed}"))).join("run.mcap"))
        };
        let (before, after) = (deviation(&nominal, "before"), deviation(&extended, "after"));
        println!("seed {seed}: RMS and largest deviation {before:?} m before, {after:?} m after");
        before_m2 += before.0.powi(2);
        after_m2 += after.0.powi(2);
        better += usize::from(after.0 < 0.8 * before.0 && after.1 < 0.8 * before.1);
    }
    let share = (after_m2 / before_m2).sqrt();
    assert!(share < 0.7 && better >= 5, "RMS {share} times that of before, {better} of 6 flights better");
}
