//! Lines of an ideal vehicle against the reference, which others computed.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod support;

use fss_messages::MissionState;
use serde_json::Value;
use support::{Record, START_DEG, fly, line};

fn reference() -> Value {
    serde_json::from_str(include_str!("reference/zero_reaction.json")).unwrap()
}

fn the_line(arm_mode: u8, period_s: f64) -> Record {
    fly(&START_DEG, line(arm_mode, 0.1, 240.0, 20.0), period_s)
}

/// Compares a run with the reference's run of this name, angles within `within_deg`.
#[track_caller]
fn agrees(record: &Record, name: &str, within_deg: f64) {
    let reference = &reference()[name];
    let number = |key: &str| reference[key].as_f64().unwrap();
    println!("{name}: {record:?}");
    for (i, q) in record.q_deg.iter().enumerate() {
        let expected = reference["q_final_deg"][i].as_f64().unwrap();
        assert!((q - expected).abs() < within_deg, "{name}: joint {} ends at {q}, reference {expected}", i + 1);
    }
    let turn = number("base_rot_final_deg");
    assert!((record.base_turn_deg - turn).abs() < within_deg, "{name}: base turns {}", record.base_turn_deg);
    assert!((record.ee_turn_deg - number("ee_rot_change_deg")).abs() < within_deg, "{name}: {}", record.ee_turn_deg);
    let rate = number("max_rate_rad_s");
    assert!((record.largest_rate_rad_s / rate - 1.0).abs() < 0.02, "{name}: rate {}", record.largest_rate_rad_s);
    let sigma = number("sigma_min");
    assert!((record.sigma_min / sigma - 1.0).abs() < 0.02, "{name}: sigma {} {sigma}", record.sigma_min);
    assert!(record.ee_error_m < 3e-4 && !record.blocked && record.progress == 1.0);
}

#[test]
fn a_plain_line_turns_the_base_as_in_the_reference() {
    agrees(&the_line(MissionState::ARM_LINE, 0.01), "pinv2 nominal, dt=0.01", 0.01);
    agrees(&the_line(MissionState::ARM_LINE, 0.2), "pinv2 nominal, dt=0.2", 0.2);
}

#[test]
fn a_line_with_kept_orientation_turns_the_base_as_in_the_reference() {
    agrees(&the_line(MissionState::ARM_LINE_POSE, 0.01), "pinv3 nominal, dt=0.01", 0.01);
    agrees(&the_line(MissionState::ARM_LINE_POSE, 0.2), "pinv3 nominal, dt=0.2", 0.2);
}

#[test]
fn the_arm_alone_keeps_the_base_from_turning_as_in_the_reference() {
    agrees(&the_line(MissionState::ARM_ZERO_REACTION, 0.01), "zrm2 nominal, dt=0.01", 0.01);
    agrees(&the_line(MissionState::ARM_ZERO_REACTION, 0.2), "zrm2 nominal, dt=0.2", 0.05);
}

#[test]
fn the_arm_alone_keeps_base_and_end_effector_from_turning_as_in_the_reference() {
    agrees(&the_line(MissionState::ARM_ZERO_REACTION_POSE, 0.01), "zrm3 nominal, dt=0.01", 0.01);
    agrees(&the_line(MissionState::ARM_ZERO_REACTION_POSE, 0.2), "zrm3 nominal, dt=0.2", 0.05);
}

#[test]
fn zero_reaction_lines_reach_as_far_as_the_reference_in_every_direction() {
    for (mode, table) in [
        (MissionState::ARM_ZERO_REACTION, "feasible_length_zrm2"),
        (MissionState::ARM_ZERO_REACTION_POSE, "feasible_length_zrm3"),
    ] {
        for (direction, length) in reference()[table].as_object().unwrap() {
            let length_m = length.as_f64().unwrap();
            let record = fly(&START_DEG, line(mode, length_m, direction.parse().unwrap(), 200.0 * length_m), 0.05);
            let what = format!("{table}, {direction} degrees, {length_m} m: {record:?}");
            assert!(!record.blocked && record.progress == 1.0, "{what}");
            assert!(record.ee_error_m < 1e-3 && record.largest_base_turn_deg < 0.3, "{what}");
            assert!(record.largest_joint_deg <= 90.0, "{what}");
        }
    }
}
