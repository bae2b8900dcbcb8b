//! The paper's dynamic calibration: what it knows, and how well.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use fss_calibrate::attitude::{Choice, Maneuver, calibrate, maneuvers, turn};
use fss_multibody::Model;
use fss_plant::Plant;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::FRAC_PI_2;

/// The paper's residual.
const NOISE_RAD: f64 = 1.54 * std::f64::consts::PI / 180.0;

fn model() -> Model {
    Plant::default_laboratory().unwrap().model().unwrap()
}

/// Eight maneuvers from stop to stop, two a joint, the other joints anywhere.
fn eight(model: &Model, rng: &mut ChaCha8Rng) -> Vec<Maneuver> {
    (0..8)
        .map(|k| {
            let mut from_rad: Vec<f64> = (0..4).map(|_| rng.random_range(-FRAC_PI_2..FRAC_PI_2)).collect();
            let mut to_rad = from_rad.clone();
            let side = if rng.random::<bool>() { FRAC_PI_2 } else { -FRAC_PI_2 };
            (from_rad[k % 4], to_rad[k % 4]) = (-side, side);
            let mut maneuver = Maneuver { joint: k % 4, from_rad, to_rad, turn_rad: 0.0 };
            let z: f64 = StandardNormal.sample(rng);
            maneuver.turn_rad = turn(model, &maneuver) + NOISE_RAD * z;
            maneuver
        })
        .collect()
}

#[test]
fn eight_final_attitudes_know_the_links_inertia_to_half_of_itself() {
    let seed = 8;
    println!("seed {seed}");
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let model = model();
    let (mut stds, mut inside) = (Vec::new(), 0);
    for _ in 0..400 {
        let all = eight(&model, &mut rng);
        let estimate = calibrate(&model, &all, NOISE_RAD, Choice::default()).unwrap();
        let p = estimate.parameters.first().unwrap_or_else(|| panic!("{estimate:?} {all:?}"));
        inside += usize::from((p.value - 0.034).abs() < estimate.half_width(p.std, 1.96));
        stds.push(p.std);
    }
    stds.sort_by(f64::total_cmp);
    let (median, coverage) = (stds[200], inside as f64 / 400.0);
    println!("median {median:.4} kg m2, {:.0} %, coverage {coverage:.3}", 100.0 * median / 0.034);
    // "paper_I_sd" of an independent numpy script: median 0.0162, 5 % 0.0123, 95 % 0.0196: 48 % of 0.034.
    assert!((0.0123..0.0196).contains(&median), "{median}");
    assert!((0.91..0.98).contains(&coverage), "{coverage}");
}

#[test]
fn maneuvers_of_one_joint_are_found_in_a_run_and_others_left_out() {
    let mut lab = common::Lab::new(
        model(),
        common::Noise { position_m: 1e-4, angle_rad: 1e-4, encoder_rad: 1e-5, rate_rad_s: 1e-4, torque_n_m: 1e-3 },
        1,
    );
    let run = lab.steps(&[(1, 0.6), (0, -0.5)], &[0.1, 0.2, -0.3, 0.4]);
    let (found, mixed) = maneuvers(&run, 4);
    assert_eq!((found.len(), mixed), (2, 0), "{found:?}");
    assert_eq!([found[0].joint, found[1].joint], [1, 0]);
    for maneuver in &found {
        assert!((turn(&lab.model, maneuver) - maneuver.turn_rad).abs() < 2e-3, "{maneuver:?}");
    }
    let error = calibrate(&lab.model, &[], 1e-3, Choice::default()).unwrap_err();
    assert!(error.to_string().contains("no maneuver moves one joint"), "{error}");
}
