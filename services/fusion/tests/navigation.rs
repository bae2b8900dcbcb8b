//! The navigation state against a known motion, through noise, latency, dropouts and nonsense.
#![allow(clippy::unwrap_used)]

mod support;

use fss_messages::NavState;
use fss_plant::{JointCommand, Plant, Simulation};
use support::{Faults, Flight, GYRO_BIAS_RAD_S, Motion, NONE, SEED, Seen, rms, shaken, still};

fn fly(seconds: f64, motion: impl FnMut(f64) -> Motion, faults: &Faults) -> Vec<Seen> {
    Flight::new(SEED).fly(seconds, motion, faults)
}

#[test]
fn a_shaken_base_is_known_to_a_fraction_of_a_millimetre() {
    let seen = fly(20.0, shaken, &NONE);
    let e = rms(&seen, 1.0, 20.0);
    assert!(e.position_m < 3e-4 && e.heading_deg < 0.03);
    let last = seen.last().unwrap().1;
    assert_eq!(last.mode, NavState::TRACKING);
    assert!((last.gyro_bias_rad_s - GYRO_BIAS_RAD_S).abs() < 1e-3, "bias {}", last.gyro_bias_rad_s);
    assert!(last.theta_rad > 10.0, "the heading is unwrapped");
}

#[test]
fn a_still_base_has_a_still_velocity() {
    let e = rms(&fly(20.0, still, &NONE), 2.0, 20.0);
    assert!(
        e.position_m < 2e-4 && e.velocity_m_s < 1e-3 && e.rate_rad_s < 7e-4,
        "the controller would answer noise with gas"
    );
}

/// The base of a floating vehicle whose joints swing to and fro, each at up to 0.3 rad/s.
fn under_a_swinging_arm() -> impl FnMut(f64) -> Motion {
    let mut simulation = Simulation::new(&Plant::default_laboratory().unwrap(), SEED).unwrap();
    simulation.set_state([0.1, 0.2, 0.3], [0.0; 3], &[-0.5, 1.0, -1.0, 0.5], &[0.0; 4]);
    move |t| {
        while simulation.t_s() < t - 1e-6 {
            for joint in 0..4 {
                let qd_rad_s = 0.3 * (simulation.t_s() * (1.0 + 0.3 * joint as f64)).sin();
                simulation.set_joint(joint, JointCommand::Velocity { qd_rad_s });
            }
            simulation.step(1e-3);
        }
        let truth = simulation.truth();
        let ([x, y, theta], [vx, vy, omega]) = (truth.base_pose, truth.base_velocity);
        [x, y, theta, vx, vy, omega]
    }
}

#[test]
fn a_base_under_a_swinging_arm_is_known_to_a_millimetre_and_a_tenth_of_a_degree() {
    let seen = fly(20.0, under_a_swinging_arm(), &NONE);
    let fastest = seen.iter().map(|(_, _, m)| m[3].hypot(m[4])).fold(0.0, f64::max);
    println!("the base goes at up to {fastest} m/s");
    let e = rms(&seen, 1.0, 20.0);
    assert!(fastest > 0.03 && e.position_m < 5e-4 && e.heading_deg < 0.03);
    assert!(seen.last().unwrap().1.rejected < 10, "of 2000 frames the gate refuses some two that are true");
}

/// Mean squared errors of x, y, theta, vx, vy, omega over the stated variances, and of the innovations.
fn consistency(motion: fn(f64) -> Motion) -> ([f64; 6], f64) {
    let (mut nees, mut nis, mut count) = ([0.0; 6], 0.0, 0.0);
    for seed in SEED..SEED + 5 {
        for (_, n, m) in Flight::new(seed).fly(20.0, motion, &NONE).iter().filter(|(t, ..)| *t > 2.0) {
            let turn = n.theta_rad - m[2];
            let heading = turn.sin().atan2(turn.cos());
            let errors = [n.x_m - m[0], n.y_m - m[1], heading, n.vx_m_s - m[3], n.vy_m_s - m[4], n.omega_rad_s - m[5]];
            for i in 0..6 {
                nees[i] += (errors[i] / n.std[i]).powi(2);
            }
            nis += n.innovation_d2 / 3.0;
            count += 1.0;
        }
    }
    let means = (nees.map(|sum| sum / count), nis / count);
    println!("NEES {:?}, NIS {}", means.0, means.1);
    means
}

#[test]
fn the_stated_uncertainty_of_a_still_base_is_not_too_small() {
    let (nees, nis) = consistency(still);
    assert!(nees.iter().all(|&ratio| ratio < 1.2), "{nees:?}");
    assert!((0.8..1.1).contains(&nis), "{nis}");
}

#[test]
fn the_stated_uncertainty_of_a_shaken_base_is_of_the_right_size() {
    // A steady acceleration is no white noise: a filter that takes it for noise lags, by less than two standard deviations.
    let (nees, nis) = consistency(shaken);
    assert!(nees.iter().all(|&ratio| ratio < 4.0), "{nees:?}");
    assert!((0.8..1.6).contains(&nis), "{nis}");
}

#[test]
fn a_second_without_motion_capture_is_survived_on_gyro_and_model() {
    let gap = Faults { mocap: |t, _, pose| (!(5.0..6.0).contains(&t)).then_some(pose), ..NONE };
    let seen = fly(12.0, shaken, &gap);
    assert!(rms(&seen, 5.0, 6.0).heading_deg < 0.3, "the gyro carries the heading");
    for (t, n, m) in seen.iter().filter(|(t, ..)| (5.1..6.0).contains(t)) {
        assert_eq!(n.mode, NavState::COASTING);
        assert!((n.x_m - m[0]).abs() < 4.0 * n.std[0], "{t} s: x is off by more than it says");
    }
    assert!(seen.last().unwrap().1.rejected < 6, "what comes after the gap is believed");
    assert!(rms(&seen, 6.2, 12.0).position_m < 3e-4);
    assert_eq!(seen.last().unwrap().1.mode, NavState::TRACKING);
}

#[test]
fn jumps_and_zeros_of_the_tracker_do_not_move_the_estimate() {
    let nonsense = |t: f64, frame: u32, pose: [f64; 3]| match frame % 20 {
        _ if t < 1.0 => Some(pose),
        3 => Some([0.0; 3]),
        11 => Some([pose[0] + 0.3, pose[1], pose[2]]),
        15 => Some([pose[0], pose[1], pose[2] + 1.0]),
        _ => Some(pose),
    };
    let seen = fly(12.0, shaken, &Faults { mocap: nonsense, ..NONE });
    let e = rms(&seen, 2.0, 12.0);
    assert!(e.position_m < 4e-4 && e.heading_deg < 0.03);
    assert!(seen.last().unwrap().1.rejected >= 90);
}

#[test]
fn a_tracker_that_sends_only_nonsense_is_not_followed() {
    let nonsense = |t: f64, frame: u32, pose: [f64; 3]| {
        let far = 0.5 + 0.1 * f64::from(frame % 7);
        Some(if t < 3.0 { pose } else { [pose[0] + far, pose[1], pose[2]] })
    };
    let seen = fly(4.0, still, &Faults { mocap: nonsense, ..NONE });
    assert!(rms(&seen, 3.0, 4.0).position_m < 0.01);
    assert_eq!(seen.last().unwrap().1.mode, NavState::COASTING);
}

#[test]
fn a_tracker_that_was_moved_for_good_is_followed_again() {
    let moved = |t, _, p: [f64; 3]| Some(if t < 3.0 { p } else { [p[0] + 0.5, p[1], p[2]] });
    let seen = fly(8.0, shaken, &Faults { mocap: moved, ..NONE });
    let last = seen.last().unwrap();
    assert!((last.1.x_m - last.2[0] - 0.5).abs() < 1e-3);
    assert_eq!(last.1.mode, NavState::TRACKING);
}

#[test]
fn without_a_gyro_motion_capture_alone_holds_the_state() {
    let seen = fly(10.0, shaken, &Faults { gyro: |_, _| None, ..NONE });
    let e = rms(&seen, 2.0, 10.0);
    assert!(e.position_m < 3e-4 && e.heading_deg < 0.06);
    assert_eq!(seen.last().unwrap().1.mode, NavState::NO_GYRO);
}

#[test]
fn a_gyro_that_is_heard_a_little_later_than_the_cameras_is_not_missing() {
    let late = |t: f64, rate: f64| (t > 0.06).then_some(rate);
    let modes: Vec<u8> = fly(1.0, shaken, &Faults { gyro: late, ..NONE }).iter().map(|(_, n, _)| n.mode).collect();
    let (waits, tracks) = modes.split_at(modes.iter().position(|mode| *mode == NavState::TRACKING).unwrap());
    assert!(waits.len() > 10 && waits.iter().all(|mode| *mode == NavState::INITIALISING), "{waits:?}");
    assert!(tracks.iter().all(|mode| *mode == NavState::TRACKING));
    let never = fly(1.0, shaken, &Faults { gyro: |_, _| None, ..NONE });
    let missing_s = never.iter().find(|(_, n, _)| n.mode == NavState::NO_GYRO).unwrap().0;
    assert!((0.1..0.12).contains(&missing_s), "missing from {missing_s} s on");
}

#[test]
fn a_frozen_gyro_is_not_believed() {
    let seen = fly(10.0, shaken, &Faults { gyro: |t, rate| Some(if t < 3.0 { rate } else { 0.4 }), ..NONE });
    assert!(rms(&seen, 5.0, 10.0).heading_deg < 0.06);
    assert_eq!(seen.last().unwrap().1.mode, NavState::NO_GYRO);
}

#[test]
fn a_spike_of_the_gyro_turns_nothing() {
    let spikes = |t: f64, rate: f64| Some(if (t * 100.0) as u64 % 20 == 7 { rate + 3.0 } else { rate });
    let e = rms(&fly(10.0, shaken, &Faults { gyro: spikes, ..NONE }), 1.0, 10.0);
    assert!(e.heading_deg < 0.03 && e.rate_rad_s < 5e-3);
}

#[test]
fn a_state_without_motion_capture_for_long_is_called_lost() {
    let seen = fly(9.0, shaken, &Faults { mocap: |t, _, pose| (t < 5.0).then_some(pose), ..NONE });
    assert_eq!(seen.last().unwrap().1.mode, NavState::LOST);
}
