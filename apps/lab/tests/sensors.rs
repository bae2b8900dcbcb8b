//! What the laboratory's cameras and gyro say about the truth.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{Bench, MS, S, config, plant};
use fss_lab::{Fault, FaultKind, LabConfig, Network, Start};
use fss_plant::{Plant, Target};
use fss_wire::vicon::Frame;
use std::f64::consts::PI;

fn drifting(config: LabConfig) -> LabConfig {
    let start = Start { pose: [-0.5, 0.3, 3.0], velocity: [0.05, -0.02, 0.2], ..Start::default() };
    LabConfig { start, ..config }
}

/// The truth for every millisecond, while the laboratory runs.
fn watch(bench: &mut Bench, duration_ns: u64) -> Vec<fss_messages::TruthState> {
    let mut truths = vec![bench.laboratory.truth()];
    for _ in 0..duration_ns / MS {
        bench.wait(MS);
        truths.push(bench.laboratory.truth());
    }
    truths
}

fn with_target() -> Plant {
    let target = Target {
        mass_kg: 10.0,
        inertia_kg_m2: 0.2,
        pose: [1.2, 0.8, 0.5],
        velocity: [0.0; 3],
        radius_m: 0.15,
        restitution: 0.3,
    };
    Plant { target: Some(target), ..plant() }
}

#[test]
fn the_cameras_show_where_everything_was_one_latency_ago_within_their_noise() {
    let plant = with_target();
    let mut bench = Bench::new(&plant, drifting(config()));
    let truths = watch(&mut bench, 5 * S);
    let latency_ms = (plant.sensors.mocap_latency_s * 1e3).round() as u64;
    let mut squares = [0.0; 3];
    for (time_ns, datagram) in &bench.heard.mocap {
        let frame = Frame::decode(datagram).unwrap();
        let truth = &truths[(time_ns / MS - latency_ms) as usize];
        let base = frame.object("base").unwrap();
        assert!(base.is_tracked() && base.rotation_rad[2].abs() <= PI);
        let turn = base.rotation_rad[2] - truth.theta_rad;
        let turn = turn - 2.0 * PI * (turn / (2.0 * PI)).round();
        let errors = [base.position_m[0] - truth.x_m, base.position_m[1] - truth.y_m, turn];
        squares.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error * error);
        let tip = frame.object("end_effector").unwrap();
        assert!(
            (tip.position_m[0] - truth.ee[0]).hypot(tip.position_m[1] - truth.ee[1])
                < 6.0 * plant.sensors.mocap_position_m
        );
        let target = frame.object("target").unwrap();
        assert!((target.position_m[0] - 1.2).abs() < 6.0 * plant.sensors.mocap_position_m);
    }
    let frames = bench.heard.mocap.len();
    assert!((498..=500).contains(&frames), "{frames} frames in 5 s");
    let noise = [plant.sensors.mocap_position_m, plant.sensors.mocap_position_m, plant.sensors.mocap_angle_rad];
    for (sum, noise) in squares.iter().zip(noise) {
        let ratio = (sum / frames as f64).sqrt() / noise;
        assert!((0.85..1.15).contains(&ratio), "error is {ratio} times the noise");
    }
}

#[test]
fn the_gyro_keeps_its_own_time_and_its_mean_rates_add_up_to_the_turn() {
    let plant = plant();
    let mut bench = Bench::new(&plant, drifting(config()));
    let truths = watch(&mut bench, 10 * S);
    let readings = bench.heard.gyro_readings();
    assert!((970..=976).contains(&readings.len()), "{} lines in 10 s of a clock 2.5 % slow", readings.len());
    let turn: f64 = readings.iter().map(|(_, reading)| reading.value_rad * 0.01025).sum();
    let truth = truths.last().unwrap().theta_rad - truths[0].theta_rad;
    // White noise of 1e-3 rad/s over 975 readings, the bias, and one period at the end.
    let tolerance =
        5.0 * plant.sensors.gyro_rad_s * 0.01025 * 975_f64.sqrt() + 10.0 * plant.sensors.gyro_bias_rad_s + 0.2 * 0.02;
    assert!((turn - truth).abs() < tolerance, "turned {truth}, the gyro says {turn}");
}

#[test]
fn the_gyro_sends_what_its_mode_letter_asks_for() {
    let mut bench = Bench::new(&plant(), drifting(config()));
    bench.laboratory.request_gyro(b'P');
    bench.wait(2 * S);
    let (_, last) = *bench.heard.gyro_readings().last().unwrap();
    assert!((last.value_rad - 0.4).abs() < 0.02, "turned 0.4 rad, integrated {}", last.value_rad);
    bench.laboratory.request_gyro(b'Z');
    bench.wait(50 * MS);
    let (_, zeroed) = *bench.heard.gyro_readings().last().unwrap();
    assert!(zeroed.value_rad < 0.03, "zeroed, integrated {}", zeroed.value_rad);
}

#[test]
fn faults_on_purpose_begin_and_end_on_time() {
    let fault = |from_s, to_s, kind| Fault { from_s, to_s, kind };
    let faults = vec![
        fault(1.0, 1.1, FaultKind::MocapZeros { object: "base".into() }),
        fault(2.0, 2.1, FaultKind::MocapSilent),
        fault(3.0, 3.1, FaultKind::MocapFrozen),
        fault(4.0, 4.1, FaultKind::MocapJump { object: "base".into(), x_m: 1.0, y_m: 0.0 }),
        fault(1.0, 1.5, FaultKind::GyroInvalid),
        fault(2.0, 2.5, FaultKind::GyroSilent),
    ];
    let plant = plant();
    let mut bench = Bench::new(&plant, LabConfig { faults, ..config() });
    bench.wait(5 * S);
    let latency_ns = (plant.sensors.mocap_latency_s * 1e9) as u64;
    let within = |time_ns: u64, from_s: f64, to_s: f64| (from_s..to_s).contains(&((time_ns - latency_ns) as f64 / 1e9));
    let mut numbers = Vec::new();
    for (time_ns, datagram) in &bench.heard.mocap {
        let frame = Frame::decode(datagram).unwrap();
        let base = frame.object("base").unwrap();
        assert_eq!(base.is_tracked(), !within(*time_ns, 1.0, 1.1), "at {time_ns} ns");
        assert!(frame.object("end_effector").unwrap().is_tracked());
        assert!(!within(*time_ns, 2.0, 2.1), "silent at {time_ns} ns");
        assert_eq!((base.position_m[0] - 1.0).abs() < 0.01, within(*time_ns, 4.0, 4.1), "at {time_ns} ns");
        numbers.push(frame.number());
    }
    let repeats = numbers.windows(2).filter(|pair| pair[0] == pair[1]).count();
    assert_eq!(repeats, 10, "a frozen tracker repeats its frame");
    for (time_ns, reading) in bench.heard.gyro_readings() {
        let t_s = time_ns as f64 * 1e-9;
        if !(0.99..1.01).contains(&t_s) && !(1.49..1.51).contains(&t_s) {
            assert_eq!(reading.valid, !(1.0..1.5).contains(&t_s), "at {t_s} s");
        }
        assert!(!(2.01..2.49).contains(&t_s), "silent at {t_s} s");
    }
}

#[test]
fn a_lossy_network_loses_doubles_and_delays_what_the_cameras_send() {
    let mocap = Network { loss: 0.2, duplicate: 0.1, delay_s: 0.05, ..Network::default() };
    let mut bench = Bench::new(&plant(), LabConfig { mocap, ..config() });
    bench.wait(10 * S);
    let numbers: Vec<_> =
        bench.heard.mocap.iter().map(|(_, datagram)| Frame::decode(datagram).unwrap().number()).collect();
    let doubled = numbers.windows(2).filter(|pair| pair[0] == pair[1]).count();
    // 1000 frames, 10 % of them twice, 20 % of all copies lost.
    assert!((820..940).contains(&numbers.len()), "{} arrived", numbers.len());
    assert!((30..100).contains(&doubled), "{doubled} came twice");
    let first = numbers[0];
    assert_eq!(
        bench.heard.mocap[0].0,
        u64::from(first) * 10 * MS + 8 * MS + 50 * MS,
        "the network's delay comes on top"
    );
}
