//! Vehicles that are not the paper's: a base without an arm, seen 20 times a second, without a gyro.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_diagnosis::diagnose;
use fss_diagnosis::diagnosis::Verdict;
use fss_experiments::measured::{Poses, Run};
use fss_plant::{Plant, Uncertainty};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fmt::Write;

const SEED: u64 = 11;
const MASS_KG: f64 = 10.0;
const INERTIA_KG_M2: f64 = 0.25;
const THRUST_N: f64 = 0.16;
/// Where two thrusters push the base, and whereto: one forwards off its middle, one sidewards.
const THRUSTERS: [([f64; 2], [f64; 2]); 2] = [([-0.13, 0.06], [1.0, 0.0]), ([0.06, -0.13], [0.0, 1.0])];

fn plant() -> Plant {
    let mut text = format!("[base]\nmass_kg = {MASS_KG:?}\ninertia_kg_m2 = {INERTIA_KG_M2}\nthrust_N = {THRUST_N}\n");
    for (position, direction) in THRUSTERS {
        writeln!(text, "[[thruster]]\nposition_m = {position:?}\nforce_direction = {direction:?}").unwrap();
    }
    Plant::parse(&text).unwrap()
}

/// What really acts, beside the thrust.
#[derive(Clone, Copy, Default)]
struct Truth {
    drag_n_s_m: f64,
    waves_n: f64,
    pressure_per_s: f64,
    /// Share of its thrust that the first thruster lacks.
    lacks: f64,
}

/// Flies for 30 s with random pulses; integrated here by the midpoint rule at 1 ms, so that nothing is found by symmetry.
fn flight(name: &str, truth: Truth, seed: u64) -> Run {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let sensors = plant().sensors;
    let mut valves = vec![(0.0, vec![false; 2])];
    let mut t_s = 1.0;
    while t_s < 27.0 {
        valves.push((t_s, (0..2).map(|_| random.random::<bool>()).collect()));
        t_s += random.random_range(0.3..1.5);
        valves.push((t_s, vec![false; 2]));
        t_s += random.random_range(0.5..2.0);
    }
    let mut state = [-0.3, 0.2, 0.4, 0.04, -0.03, 0.02];
    let rate = |s: &[f64; 6], t_s: f64| {
        let open = &valves[valves.partition_point(|(t, _)| *t <= t_s) - 1].1;
        let (sin, cos) = s[2].sin_cos();
        let (mut force, mut torque) = ([0.0; 2], 0.0);
        for (i, ((position, direction), _)) in THRUSTERS.iter().zip(open).enumerate().filter(|(_, (_, open))| **open) {
            let own = if i == 0 { 1.0 - truth.lacks } else { 1.0 };
            let thrust_n = THRUST_N * own * (1.0 + truth.pressure_per_s * t_s);
            force[0] += thrust_n * (cos * direction[0] - sin * direction[1]);
            force[1] += thrust_n * (sin * direction[0] + cos * direction[1]);
            torque += thrust_n * (position[0] * direction[1] - position[1] * direction[0]);
        }
        force[0] += truth.waves_n * (8.0 * s[0]).sin() - truth.drag_n_s_m * s[3];
        force[1] -= truth.drag_n_s_m * s[4];
        [s[3], s[4], s[5], force[0] / MASS_KG, force[1] / MASS_KG, torque / INERTIA_KG_M2]
    };
    let dt = 1e-3;
    let mut poses = Poses::default();
    for k in 0..30_000_u32 {
        let t_s = f64::from(k) * dt;
        if k % 50 == 0 {
            let mut noise = |sd: f64| sd * Distribution::<f64>::sample(&StandardNormal, &mut random);
            let (p, a) = (sensors.mocap_position_m, sensors.mocap_angle_rad);
            poses.t_s.push(t_s);
            poses.values.push([state[0] + noise(p), state[1] + noise(p), state[2] + noise(a)]);
        }
        let slope = rate(&state, t_s);
        let middle: [f64; 6] = std::array::from_fn(|i| state[i] + 0.5 * dt * slope[i]);
        let slope = rate(&middle, t_s + 0.5 * dt);
        state = std::array::from_fn(|i| state[i] + dt * slope[i]);
    }
    let levels = |open: &Vec<bool>| open.iter().map(|open| f64::from(*open)).collect();
    let thrust_levels = valves.iter().map(|(t_s, open)| (*t_s, levels(open))).collect();
    Run { name: name.into(), base_pose: Some(poses), thrust_levels, ..Run::default() }
}

fn flights(truth: Truth) -> Vec<Run> {
    println!("seed {SEED}");
    (0..3).map(|k| flight(&format!("run-{k}"), truth, SEED + k)).collect()
}

#[test]
fn a_base_without_arm_or_gyro_is_simulated_to_its_noise() {
    let found = diagnose(&plant(), &flights(Truth::default()), &[], &|_| ()).unwrap();
    assert_eq!(found.verdict, Verdict::Consistent, "{:?} {:?}", found.causes, found.remarks);
    assert!((found.gain.after - 1.0).abs() < 0.1, "{}", found.gain.after);
}

#[test]
fn its_air_drag_is_named() {
    let found = diagnose(&plant(), &flights(Truth { drag_n_s_m: 0.5, ..Truth::default() }), &[], &|_| ()).unwrap();
    let named: Vec<&str> = found.causes.iter().map(|c| c.effect.id()).collect();
    assert_eq!(named, ["base_linear_drag"]);
    let value = found.causes[0].effect.values()[0];
    assert!((value - 0.5).abs() < 3.0 * found.causes[0].std[0], "{value} +- {}", found.causes[0].std[0]);
    assert!(found.causes[0].std[0] < 0.05, "{}", found.causes[0].std[0]);
}

#[test]
fn a_supply_that_loses_half_its_pressure_is_named_and_measured() {
    let runs = flights(Truth { pressure_per_s: -0.016, ..Truth::default() });
    let found = diagnose(&plant(), &runs[..2], &runs[2..], &|_| {}).unwrap();
    assert_eq!(found.verdict, Verdict::Explained, "{:?}", found.causes);
    assert_eq!(found.causes.len(), 1, "{:?}", found.causes);
    let effect = &found.causes[0].effect;
    assert_eq!(effect.id(), "thruster_pressure_trend");
    assert!((effect.values()[0] / -0.016 - 1.0).abs() < 0.05, "{effect:?}");
}

/// An uncertain value takes up what it may, and no more: far beyond its deviation it is a weak thruster.
#[test]
fn a_thruster_weaker_than_its_thrust_is_uncertain_is_named_and_one_within_is_not() {
    let mut plant = plant();
    plant.uncertainty = Some(Uncertainty { thrust_n: 0.004, ..Uncertainty::default() });
    let with = |lacks| {
        let runs = flights(Truth { lacks, ..Truth::default() });
        diagnose(&plant, &runs[..2], &runs[2..], &|_| ()).unwrap()
    };
    let found = with(0.25);
    let named: Vec<_> = found.causes.iter().map(|c| (c.effect.id(), c.effect.index())).collect();
    assert_eq!(named, [("thruster_gain", Some(1))], "{:?}", found.suspects);
    let value = found.causes[0].effect.values()[0];
    assert!((value - 0.75).abs() < 3.0 * found.causes[0].std[0], "{value} +- {}", found.causes[0].std[0]);
    let found = with(0.04);
    assert_eq!((found.verdict, found.causes.len()), (Verdict::Consistent, 0), "{:?}", found.causes);
}

#[test]
fn waves_of_the_table_that_no_effect_describes_are_called_unexplained() {
    let found = diagnose(&plant(), &flights(Truth { waves_n: 0.02, ..Truth::default() }), &[], &|_| ()).unwrap();
    assert!(matches!(found.verdict, Verdict::Unexplained | Verdict::PartlyExplained), "{:?}", found.causes);
}

#[test]
fn commands_of_another_run_are_told_from_weak_thrusters() {
    let mut runs = flights(Truth::default());
    let borrowed = runs[2].thrust_levels.clone();
    runs[1].thrust_levels = borrowed;
    let found = diagnose(&plant(), &runs, &[], &|_| ()).unwrap();
    assert!(found.causes.is_empty(), "{:?}", found.causes);
    assert_eq!(found.verdict, Verdict::Unexplained);
}

#[test]
fn commands_by_a_clock_that_is_off_are_told() {
    let mut runs = flights(Truth::default());
    for run in &mut runs {
        run.thrust_levels.iter_mut().for_each(|(t_s, _)| *t_s -= 1.4);
    }
    let found = diagnose(&plant(), &runs, &[], &|_| ()).unwrap();
    assert!(found.causes.iter().all(|c| c.effect.id() == "clock_offset"), "{:?}", found.causes);
    assert!(found.verdict != Verdict::Consistent, "{:?}", found.remarks);
}
