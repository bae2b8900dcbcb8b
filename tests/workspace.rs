//! `fss workspace` as a user runs it, on the plant that comes with the program.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn workspace(out: &Path, more: &[&str]) -> Output {
    let plant = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../deploy/etc/plants/fss.toml");
    let mut command = Command::new(env!("CARGO_BIN_EXE_fss"));
    command.arg("workspace").arg("--plant").arg(plant).arg("--out").arg(out).args(more);
    command.output().unwrap()
}

fn answer(out: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(out.join("workspace.json")).unwrap()).unwrap()
}

#[test]
fn the_default_plants_workspace_is_the_references() {
    let folder = tempfile::tempdir().unwrap();
    let output = workspace(folder.path(), &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let answer = answer(folder.path());
    let number = |field: &str| answer[field].as_f64().unwrap_or_else(|| panic!("no {field}"));
    // From independent numpy scripts; the last two are what their planner reaches, and more is better.
    assert!((number("radius_m") - 1.1721176916130882).abs() < 1e-9);
    assert!((number("fixed_area_m2") / 6.157629750054372 - 1.0).abs() < 0.005);
    assert!((number("max_w2_fixed") - 0.7577268346477728).abs() < 1e-6);
    assert!((number("max_w2_floating") - 0.19529583866631725).abs() < 1e-6);
    assert!(number("straight_path_fixed_area_m2") > 4.020905168521219);
    assert!(number("straight_path_floating_area_m2") > 0.3320809547103294);
    assert!(number("straight_path_fixed_area_m2") < number("fixed_area_m2"));
    for name in ["workspace-held.svg", "straight-paths.svg", "manipulability.svg"] {
        let svg = std::fs::read_to_string(folder.path().join(name)).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>") && !svg.contains("NaN"), "{name}");
        assert_eq!(svg.matches("<g").count(), svg.matches("</g>").count(), "{name}");
    }
}

#[test]
fn ellipsoids_of_a_posture_are_the_references() {
    let folder = tempfile::tempdir().unwrap();
    let output =
        workspace(folder.path(), &["--directions", "3", "--posture", "30,30,30,30", "--posture", "-30,60,-60,30"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let answer = answer(folder.path());
    assert_eq!(answer["postures"].as_array().unwrap().len(), 2);
    let posture = &answer["postures"][0];
    // From independent numpy scripts: singular values, direction of the larger axis in degrees.
    for (name, axes, direction_deg) in [
        ("ellipsoid_fixed", [1.743147638470042, 0.3844891106103428], 15.155850494223131_f64),
        ("ellipsoid_floating", [0.636875685607769, 0.03703003805703986], 50.510773258387786),
    ] {
        let ellipsoid = &posture[name];
        for (k, axis) in axes.into_iter().enumerate() {
            assert!((ellipsoid["semi_axes_m"][k].as_f64().unwrap() - axis).abs() < 1e-6, "{name}: {ellipsoid}");
        }
        let turned_deg = ellipsoid["major_axis_rad"].as_f64().unwrap().to_degrees() - direction_deg;
        assert!((turned_deg - 180.0 * (turned_deg / 180.0).round()).abs() < 1e-4, "{name}: {ellipsoid}");
    }
}

#[test]
fn a_posture_that_the_arm_cannot_take_is_refused_with_the_joint() {
    let folder = tempfile::tempdir().unwrap();
    for (posture, word) in [("10,20,30,100", "joint 4"), ("10,20,30", "3 angles"), ("a,b,c,d", "degrees")] {
        let output = workspace(folder.path(), &["--posture", posture]);
        assert!(!output.status.success());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(said.contains(word), "{posture}: {said}");
    }
}
