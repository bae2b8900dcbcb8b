//! Dynamic calibration: what whole trajectories determine, that intervals hold the truth, and what it refuses to say.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{Lab, Noise};
use fss_calibrate::dynamic::{Choice, calibrate};
use fss_multibody::{Model, Parameter};
use fss_plant::Plant;

/// 1 mm and 0.1 degree.
const NOISE: Noise = Noise {
    position_m: 1e-3,
    angle_rad: 0.1 * std::f64::consts::PI / 180.0,
    encoder_rad: 2e-4,
    rate_rad_s: 2e-3,
    torque_n_m: 0.01,
};

/// Draws of the coverage test.
const COVERAGE_DRAWS: u64 = 12;

fn model() -> Model {
    Plant::default_laboratory().unwrap().model().unwrap()
}

/// A parameter's true value by its name in an estimate.
fn truth(model: &Model, name: &str) -> Option<f64> {
    let number = || name.split(['[', ']', '.']).nth(1)?.parse::<usize>().ok();
    let parameter = match name.rsplit_once('.').map_or(name, |(_, field)| field) {
        "com_to_next_joint_m" => Parameter::ComToNextJoint(number()?),
        "inertia_kg_m2" if name.starts_with("link") => Parameter::LinkInertia(number()?),
        "inertia_kg_m2" => Parameter::BaseInertia,
        "joint_offset_rad" => Parameter::JointOffset(number()?),
        "length_m" => Parameter::LinkLength(number()?),
        "joint1_x_m" => Parameter::Joint1X,
        "joint1_y_m" => Parameter::Joint1Y,
        "joint1_angle_rad" => Parameter::Joint1Angle,
        "mass_kg" if name.starts_with("link") => Parameter::LinkMass(number()?),
        "telemetry_delay_s" => return Some(0.0),
        _ => return None,
    };
    model.parameter(parameter)
}

/// The plant file's values, off by what nobody knows yet: joint offsets by degrees, the rest by what a drawing is off.
fn guess(truth: &Model) -> Model {
    let n = truth.link_count();
    let off = |p: Parameter, by: f64| (p, truth.parameter(p).unwrap() + by);
    let mut changes = vec![off(Parameter::Joint1Angle, 0.05), off(Parameter::BaseInertia, 0.02)];
    for i in 1..=n {
        changes.push(off(Parameter::ComToNextJoint(i), 0.006));
        changes.push(off(Parameter::LinkInertia(i), -0.006));
        changes.push(off(Parameter::JointOffset(i), if i > 1 { 0.06 } else { 0.0 }));
    }
    truth.with_parameters(changes).unwrap()
}

#[test]
fn six_runs_tell_centres_of_mass_to_half_a_millimetre_and_inertias_to_a_thousandth() {
    let seed = 1;
    println!("seed {seed}");
    let mut lab = Lab::new(model(), NOISE, seed);
    let runs = lab.six_runs();
    let start = std::time::Instant::now();
    let found = calibrate(&guess(&lab.model), &runs, [1e-3, 2e-3, 2e-4], Choice::default()).unwrap();
    println!("{:?}", start.elapsed());
    let e = &found.estimate;
    println!("noise {:?} residual {:?}", e.noise, e.residual_std);
    for p in &e.parameters {
        let Some(truth) = truth(&lab.model, &p.name) else { continue };
        println!("{:<28} {:>10.6} std {:.6} error {:>6.2} std", p.name, p.value, p.std, (p.value - truth) / p.std);
        if p.name.ends_with("com_to_next_joint_m") {
            assert!(p.std < 0.5e-3 && (p.value - truth).abs() < 1e-3, "{p:?}");
        }
        if p.name.ends_with("inertia_kg_m2") && p.name.starts_with("link") {
            assert!(p.std < 1e-3 && (p.value - truth).abs() < 3e-3, "{p:?}");
        }
    }
    assert_eq!((e.rank, e.parameters.len()), (e.unknowns, e.unknowns));
}

/// 95 percent intervals over draws of runs and noise, joint offsets and first joint's angle unknown.
#[test]
fn intervals_of_whole_trajectories_hold_the_truth() {
    let (mut inside, mut all, mut squares) = (0, 0, 0.0);
    for seed in 0..COVERAGE_DRAWS {
        let mut lab = Lab::new(model(), NOISE, 100 + seed);
        let runs = lab.six_runs();
        let e = calibrate(&guess(&lab.model), &runs[..2], [1e-3, 2e-3, 2e-4], Choice::default()).unwrap().estimate;
        for p in &e.parameters {
            let Some(truth) = truth(&lab.model, &p.name) else { continue };
            let error = p.value - truth;
            squares += (error / p.std).powi(2);
            inside += usize::from(error.abs() < e.half_width(p.std, 1.96));
            all += 1;
            println!("{seed} {:<28} {:>6.2}", p.name, error / p.std);
        }
    }
    let coverage = f64::from(inside as u32) / f64::from(all as u32);
    println!("coverage {coverage:.3} of {all}, rms {:.3}", (squares / f64::from(all as u32)).sqrt());
    assert!((0.91..0.985).contains(&coverage), "coverage {coverage}");
}

/// A joint that never moves makes two links one body: what they are together is seen, and that is said.
#[test]
fn a_dead_joint_leaves_only_totals_and_they_are_named() {
    let mut lab = Lab::new(model(), NOISE, 3);
    let runs: Vec<_> = (0..2)
        .map(|_| {
            let mut sines = lab.sines();
            sines[2].clear();
            let mut run = lab.run(&[0.2, -0.3, 0.4, 0.1], &sines, 40.0, [0.0; 3]);
            run.joints.as_mut().unwrap().torque_nm.clear();
            run
        })
        .collect();
    let choice = Choice { each_length: true, ..Choice::default() };
    let found = calibrate(&guess(&lab.model), &runs, [1e-3, 2e-3, 2e-4], choice).unwrap();
    let e = &found.estimate;
    println!("{:#?} {:#?} {:?}", found.remarks, e.undetermined, e.undetermined_parameters);
    assert!(e.rank < e.unknowns);
    assert!(found.remarks.iter().any(|r| r.contains("joint 3 does not move")), "{:?}", found.remarks);
    assert!(e.undetermined.iter().any(|words| words.contains("only the total")), "{:?}", e.undetermined);
    let seen = |name: &str| e.parameters.iter().any(|p| p.name == name);
    assert!(!seen("link[3].inertia_kg_m2") && !seen("link[2].inertia_kg_m2"), "{:?}", e.parameters);
    assert!(seen("link[4].inertia_kg_m2"));
}

/// What a dead joint leaves unseen moves along a curve: which offset fits depends on where a centre of mass is taken to be.
/// The intervals of what is still told say so.
#[test]
fn what_a_dead_joint_leaves_to_be_told_is_true() {
    let (mut worst, mut inside, mut all): (f64, usize, usize) = (0.0, 0, 0);
    for seed in 0..6 {
        let mut lab = Lab::new(model(), NOISE, 40 + seed);
        let mut sines = lab.sines();
        sines[2].clear();
        let mut run = lab.run(&[0.2, -0.3, 0.0, 0.1], &sines, 60.0, [0.0; 3]);
        run.joints.as_mut().unwrap().torque_nm.clear();
        let e = calibrate(&guess(&lab.model), &[run], [1e-3, 2e-3, 2e-4], Choice::default()).unwrap().estimate;
        for p in &e.parameters {
            let Some(truth) = truth(&lab.model, &p.name) else { continue };
            let error = (p.value - truth).abs();
            println!("{seed} {:<28} {:>10.5} std {:.5} {:>6.2}", p.name, p.value, p.std, error / p.std);
            worst = worst.max(error / p.std);
            inside += usize::from(error < e.half_width(p.std, 1.96));
            all += 1;
        }
    }
    println!("coverage {inside} of {all}, worst {worst:.2} deviations");
    assert!(worst < 4.5 && 10 * inside >= 9 * all, "{inside} of {all}, worst {worst}");
}

#[test]
fn an_arm_that_rests_is_refused_in_words() {
    let mut lab = Lab::new(model(), NOISE, 4);
    let run = lab.run(&[0.2, -0.3, 0.4, 0.1], &vec![Vec::new(); 4], 20.0, [0.1, 0.0, 0.01]);
    let error = calibrate(&lab.model, std::slice::from_ref(&run), [1e-3, 2e-3, 2e-4], Choice::default()).unwrap_err();
    assert!(error.to_string().contains("no joint moves"), "{error}");
    let blind = fss_experiments::measured::Run { base_pose: None, ..run };
    let error = calibrate(&lab.model, &[blind], [1e-3, 2e-3, 2e-4], Choice::default()).unwrap_err();
    assert!(error.to_string().contains("no run has poses of the base"), "{error}");
}

/// Without a scale motion shows ratios of masses only; torque sensors bring the scale.
#[test]
fn unweighed_masses_are_seen_as_ratios_until_torque_is_measured() {
    let mut lab = Lab::new(model(), NOISE, 5);
    let mut runs = lab.six_runs();
    runs.truncate(2);
    let choice = Choice { masses: true, torque: true, ..Choice::default() };
    let names = |e: &fss_calibrate::Estimate| -> usize { e.unknowns - e.rank };
    let with = calibrate(&lab.model, &runs, [1e-3, 2e-3, 2e-4], choice).unwrap();
    // A sensor of one joint that shows twice what moves it would double the masses beyond it.
    let mut doubled = runs.clone();
    for run in &mut doubled {
        run.joints.as_mut().unwrap().torque_nm[1].iter_mut().for_each(|torque| *torque *= 2.0);
    }
    let disturbed = calibrate(&lab.model, &doubled, [1e-3, 2e-3, 2e-4], choice).unwrap();
    assert!(disturbed.remarks.iter().any(|r| r.contains("torque sensors are left out")), "{:?}", disturbed.remarks);
    assert!(
        disturbed.estimate.parameters.iter().all(|p| p.name != "base.mass_kg"),
        "{:?}",
        disturbed.estimate.parameters
    );
    for run in &mut runs {
        run.joints.as_mut().unwrap().torque_nm.clear();
    }
    let without = calibrate(&lab.model, &runs, [1e-3, 2e-3, 2e-4], choice).unwrap();
    println!("{:#?} {:#?}", with.estimate.undetermined, without.estimate.undetermined);
    assert_eq!(names(&without.estimate), names(&with.estimate) + 1);
    assert!(without.remarks.iter().any(|r| r.contains("ratios only")), "{:?}", without.remarks);
}
