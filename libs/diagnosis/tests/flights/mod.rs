//! Flights of a base without an arm, seen 20 times a second, without a gyro.

use fss_experiments::measured::{Poses, Run};
use fss_plant::Plant;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;
use std::fmt::Write;

const SEED: u64 = 11;
const MASS_KG: f64 = 10.0;
const INERTIA_KG_M2: f64 = 0.25;
const THRUST_N: f64 = 0.16;
/// Where two thrusters push the base, and whereto: one forwards off its middle, one sidewards.
const THRUSTERS: [([f64; 2], [f64; 2]); 2] = [([-0.13, 0.06], [1.0, 0.0]), ([0.06, -0.13], [0.0, 1.0])];

pub(crate) fn plant() -> Plant {
    let mut text = format!("[base]\nmass_kg = {MASS_KG:?}\ninertia_kg_m2 = {INERTIA_KG_M2}\nthrust_N = {THRUST_N}\n");
    for (position, direction) in THRUSTERS {
        writeln!(text, "[[thruster]]\nposition_m = {position:?}\nforce_direction = {direction:?}").unwrap();
    }
    Plant::parse(&text).unwrap()
}

/// What really acts, beside the thrust.
#[derive(Clone, Copy, Default)]
pub(crate) struct Truth {
    pub(crate) drag_n_s_m: f64,
    pub(crate) waves_n: f64,
    /// A force along x to and fro with the clock: size (N) and frequency (Hz).
    pub(crate) shakes: [f64; 2],
    pub(crate) pressure_per_s: f64,
    /// Share of its thrust that the first thruster lacks.
    pub(crate) lacks: f64,
    /// Dry friction: a force (N) and a torque (N m).
    pub(crate) rubs: [f64; 2],
    /// Time constant in which thrust rises and falls, s.
    pub(crate) lags_s: f64,
}

/// Speed below which friction is less than its full size (m/s, rad/s).
const CREEP: f64 = 2e-4;

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
    // Thrust that lags is, but for milliseconds, thrust that comes later.
    let rate = |s: &[f64; 6], t_s: f64| {
        let open = &valves[valves.partition_point(|(t, _)| *t <= t_s - truth.lags_s).max(1) - 1].1;
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
        force[0] += truth.shakes[0] * (TAU * truth.shakes[1] * t_s).sin();
        force[1] -= truth.drag_n_s_m * s[4];
        let against = |size: f64, along: f64, speed: f64| size * along / speed.hypot(CREEP);
        (0..2).for_each(|i| force[i] -= against(truth.rubs[0], s[3 + i], s[3].hypot(s[4])));
        torque -= against(truth.rubs[1], s[5], s[5]);
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

pub(crate) fn flights(truth: Truth) -> Vec<Run> {
    println!("seed {SEED}");
    (0..3).map(|k| flight(&format!("run-{k}"), truth, SEED + k)).collect()
}

/// Flights of which the second has the commands of the third.
pub(crate) fn flights_with_borrowed_commands() -> Vec<Run> {
    let mut runs = flights(Truth::default());
    let borrowed = runs[2].thrust_levels.clone();
    runs[1].thrust_levels = borrowed;
    runs
}

/// Flights whose commands have stamps of a clock that is 1.4 s behind.
pub(crate) fn flights_with_early_commands() -> Vec<Run> {
    let mut runs = flights(Truth::default());
    for run in &mut runs {
        run.thrust_levels.iter_mut().for_each(|(t_s, _)| *t_s -= 1.4);
    }
    runs
}
