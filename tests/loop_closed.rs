//! What knowing the plant is worth: a vehicle that knows what is wrong with its laboratory flies better in it.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_messages::{TruthState, topic};
use fss_records::log::Log;
use std::path::Path;
use std::process::Command;

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

fn fss(args: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_fss")).args(args).output().unwrap();
    assert!(output.status.success(), "fss {args:?}: {}", String::from_utf8_lossy(&output.stderr));
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
fn a_controller_that_knows_the_tilt_and_the_weak_thruster_holds_the_base_better() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let mission = write("reach.toml", REACH);
    let (nominal, laboratory) = (write("nominal.toml", NOMINAL), write("laboratory.toml", &faulty()));
    let fly = |plant: &str, seed: &str, name: &str| {
        let out = folder.path().join(name);
        let out_text = out.to_str().unwrap();
        fss(&[
            "run",
            &mission,
            "--fast",
            "--quiet",
            "--seed",
            seed,
            "--plant",
            plant,
            "--laboratory",
            &laboratory,
            "--out",
            out_text,
        ]);
        deviation_m(&out.join("run.mcap"))
    };
    for seed in ["1", "2"] {
        let before = fly(&nominal, seed, &format!("before-{seed}"));
        let after = fly(&laboratory, seed, &format!("after-{seed}"));
        println!("seed {seed}: RMS and largest deviation {before:?} m before, {after:?} m after");
        assert!(after.0 < 0.7 * before.0, "seed {seed}: RMS {} m before, {} m after", before.0, after.0);
        assert!(after.1 < 0.8 * before.1, "seed {seed}: at most {} m before, {} m after", before.1, after.1);
    }
}
