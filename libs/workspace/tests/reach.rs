//! The paper's section 5 on the default plant. Reference values come from independent numpy scripts.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_multibody::Model;
use fss_plant::Plant;
use fss_workspace::reach::{fixed_area_m2, manipulability, max_manipulability, virtual_manipulator_radius_m};
use std::f64::consts::FRAC_PI_2;

const LIMITS_RAD: [f64; 4] = [FRAC_PI_2; 4];

fn model() -> Model {
    Plant::default_laboratory().unwrap().model().unwrap()
}

#[test]
fn the_virtual_manipulator_is_as_long_as_equation_13_says_with_the_papers_tables() {
    let radius_m = virtual_manipulator_radius_m(&model()).unwrap();
    assert!((radius_m - 1.1721176916130882).abs() < 1e-9, "{radius_m}");
}

#[test]
fn the_held_vehicle_reaches_the_reference_area() {
    let area_m2 = fixed_area_m2(&model(), &LIMITS_RAD);
    println!("{area_m2} m^2");
    assert!((area_m2 / 6.157629750054372 - 1.0).abs() < 0.005, "{area_m2}");
}

#[test]
fn manipulability_is_the_references_at_ten_postures() {
    // Joint angles in degrees, w2 with the base held, w2 floating.
    let reference: [([f64; 4], f64, f64); 10] = [
        ([0.0, 0.0, 0.0, 0.0], 0.03699348259800068, 0.01323091867119222),
        ([30.0, 30.0, 30.0, 30.0], 0.6702212851778658, 0.023583530875659016),
        ([45.0, -45.0, 45.0, -45.0], 0.3076319461499314, 0.051322934228850516),
        ([-60.0, 30.0, 30.0, 30.0], 0.6702212851778664, 0.03559329895556012),
        ([90.0, -45.0, -45.0, -45.0], 0.7395225927221561, 0.05239270102769653),
        ([10.0, 20.0, -70.0, 40.0], 0.4157563099774617, 0.061887612507150615),
        ([-30.0, 60.0, -60.0, 30.0], 0.328780476179978, 0.05706009425278662),
        ([60.0, -90.0, 45.0, 20.0], 0.41176209566630156, 0.05883337020219231),
        ([15.0, 75.0, 15.0, -60.0], 0.47991664278477314, 0.10651779087850054),
        ([-45.0, -45.0, 90.0, 90.0], 0.49800833536808853, 0.07121907371931611),
    ];
    for (q_deg, fixed, floating) in reference {
        let q = q_deg.map(f64::to_radians);
        assert!((manipulability(&model(), &q, false).measure_m2() - fixed).abs() < 1e-6, "{q_deg:?}");
        assert!((manipulability(&model(), &q, true).measure_m2() - floating).abs() < 1e-6, "{q_deg:?}");
    }
}

#[test]
fn no_posture_is_better_than_the_best_found() {
    let (fixed, _) = max_manipulability(&model(), &LIMITS_RAD, false);
    let (floating, _) = max_manipulability(&model(), &LIMITS_RAD, true);
    println!("{fixed} {floating}");
    assert!(fixed > 0.7577268346477728 - 1e-6 && floating > 0.19529583866631725 - 1e-6);
    assert!(fixed < 0.7577268346477728 + 1e-4 && floating < 0.19529583866631725 + 1e-4);
}
