//! The straight-path workspace on the default plant. Reference areas come from independent numpy scripts: a planner that
//! follows one posture by a pseudoinverse away from the joint limits, in 36 directions.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_multibody::{Base, Coordinates, Model, coordinates};
use fss_plant::Plant;
use fss_workspace::straight_path::{straight_path, straight_path_area_m2};
use rayon::prelude::*;
use std::f64::consts::FRAC_PI_2;

const LIMITS_RAD: [f64; 4] = [FRAC_PI_2; 4];

fn model(clamped: bool) -> Model {
    let model = Plant::default_laboratory().unwrap().model().unwrap();
    Model::new(Base { clamped, ..*model.base() }, model.links(), [0.0, 0.0]).unwrap()
}

fn posture(q_deg: [f64; 4]) -> Coordinates {
    coordinates([0.0; 3], &q_deg.map(f64::to_radians))
}

#[test]
fn straight_paths_reach_at_least_the_references_areas() {
    // Start in degrees, area with the base held, area floating, m^2.
    let reference = [
        ([45.0, -45.0, -45.0, 45.0], 4.020905168521219, 0.3320809547103294),
        ([-30.0, 60.0, -60.0, 30.0], 1.319731012417647, 0.5611604090593869),
        ([0.0, 45.0, -90.0, 45.0], 2.7415338128533295, 0.43649352016332266),
    ];
    for (start, held_m2, floating_m2) in reference {
        for (clamped, least_m2) in [(true, held_m2), (false, floating_m2)] {
            let model = model(clamped);
            let path = |k: i32| straight_path(&model, &LIMITS_RAD, &posture(start), (10.0 * f64::from(k)).to_radians());
            let lengths_m: Vec<f64> = (0..36).into_par_iter().map(|k| path(k).length_m).collect();
            let area_m2 = straight_path_area_m2(&lengths_m);
            println!("{start:?}, held {clamped}: {area_m2:.4} m^2, reference {least_m2:.4}");
            assert!(area_m2 > least_m2, "{start:?}, held {clamped}: {area_m2} m^2, reference {least_m2}");
        }
    }
}

#[test]
fn a_planned_path_is_straight_and_within_limits_and_moves_no_momentum() {
    let (model, start) = (model(false), posture([45.0, -45.0, -45.0, 45.0]));
    let path = straight_path(&model, &LIMITS_RAD, &start, 230_f64.to_radians());
    assert!(path.length_m > 0.5, "{}", path.length_m);
    let (from, center) = (model.end_effector(&start).xy(), model.center_of_mass(&start));
    let normal = nalgebra::Vector2::new(-230_f64.to_radians().sin(), 230_f64.to_radians().cos());
    for q in &path.postures {
        assert!((model.end_effector(q).xy() - from).dot(&normal).abs() < 1e-5);
        assert!((model.center_of_mass(q) - center).norm() < 1e-9);
        assert!((3..7).all(|i| q[i].abs() < FRAC_PI_2 + 1e-9));
    }
    let last = path.postures.last().unwrap();
    assert!(((model.end_effector(last).xy() - from).norm() - path.length_m).abs() < 1e-5);
    // The joints' motion again, in a hundred times finer steps: the base must turn as planned.
    let mut theta_rad = start[2];
    for pair in path.postures.windows(2) {
        let move_by = (pair[1] - pair[0]) / 100.0;
        for k in 0..100 {
            let mut q = pair[0] + move_by * (f64::from(k) + 0.5);
            q[2] = theta_rad;
            theta_rad += model.reaction_vector(&q).dot(&move_by.fixed_rows::<8>(3));
        }
    }
    println!("{} rad, planned {} rad", theta_rad, last[2]);
    assert!((theta_rad - last[2]).abs() < 2e-3, "{theta_rad} rad, planned {} rad", last[2]);
}

#[test]
fn an_arm_that_must_move_out_of_its_stretch_has_no_straight_path() {
    let model = model(true);
    let mut stretched = Coordinates::zeros();
    for (i, link) in model.links().iter().enumerate() {
        stretched[3 + i] = -link.joint_offset_rad;
    }
    let outwards_rad = model.base().joint1_angle_rad;
    assert_eq!(straight_path(&model, &LIMITS_RAD, &stretched, outwards_rad).length_m, 0.0);
}
