//! A pulse that was commanded and not delivered is told by its time and thruster; nothing is told where all were delivered.

#![allow(clippy::unwrap_used)]

use fss_diagnosis::diagnose;
use fss_experiments::measured::{Poses, Run};
use fss_plant::Plant;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fmt::Write;

const SEED: u64 = 23;
const MASS_KG: f64 = 10.0;
const INERTIA_KG_M2: f64 = 0.25;
/// Where two thrusters push the base, and whereto: one forwards off its middle, one sidewards.
const THRUSTERS: [([f64; 2], [f64; 2]); 2] = [([-0.13, 0.06], [1.0, 0.0]), ([0.06, -0.13], [0.0, 1.0])];

/// What the thrusters are.
#[derive(Clone, Copy)]
struct Kind {
    /// Thrust (N) at a level u: c1 u + c2 u^2 + c3 u^3.
    curve_n: [f64; 3],
    lag_s: f64,
    /// Level between pulses.
    idle: f64,
    /// Standard deviation of what a pulse delivers, as a share of what it should.
    scatter: f64,
}

const VALVES: Kind = Kind { curve_n: [0.16, 0.0, 0.0], lag_s: 0.0, idle: 0.0, scatter: 0.0 };
const PROPELLERS: Kind = Kind { curve_n: [0.0067, 0.2625, -0.1075], lag_s: 0.03, idle: 0.03, scatter: 0.0 };

impl Kind {
    fn plant(self) -> Plant {
        let mut text = format!("[base]\nmass_kg = {MASS_KG:?}\ninertia_kg_m2 = {INERTIA_KG_M2}\nthrust_N = 0.16\n");
        for (position, direction) in THRUSTERS {
            writeln!(text, "[[thruster]]\nposition_m = {position:?}\nforce_direction = {direction:?}").unwrap();
            if self.lag_s > 0.0 {
                writeln!(text, "thrust_curve = {:?}\nlag_s = {:?}", self.curve_n, self.lag_s).unwrap();
            }
        }
        Plant::parse(&text).unwrap()
    }

    /// Flies for 30 s with random pulses, but for thruster 2 in the pulses of the number `missing`, from 0; integrated by the
    /// midpoint rule at 1 ms. The run, and when the missing pulse begins and ends.
    fn flight(self, name: &str, missing: Option<usize>, seed: u64) -> (Run, [f64; 2]) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut rows = vec![(0.0, vec![self.idle; 2])];
        let (mut count, mut gone) = (0, [0.0; 2]);
        let mut t_s = 1.0;
        while t_s < 27.0 {
            let full = if self.lag_s > 0.0 { random.random_range(0.5..1.0) } else { 1.0 };
            let level = |pushes: bool| if pushes { full } else { self.idle };
            let is_missing = missing == Some(count);
            let pushes = [random.random::<bool>(), random.random::<bool>() || is_missing];
            let until_s = t_s + random.random_range(0.3..1.5);
            rows.push((t_s, pushes.map(level).to_vec()));
            rows.push((until_s, vec![self.idle; 2]));
            if is_missing {
                gone = [t_s, until_s];
            }
            count += 1;
            t_s = until_s + random.random_range(0.5..2.0);
        }
        let base_pose = Some(self.flown(&rows, gone, &mut random));
        (Run { name: name.into(), base_pose, thrust_levels: rows, ..Run::default() }, gone)
    }

    /// What motion capture sees, 20 times a second. Thruster 2 gives nothing in the time `gone`.
    fn flown(self, rows: &[(f64, Vec<f64>)], gone: [f64; 2], random: &mut ChaCha8Rng) -> Poses {
        let sensors = self.plant().sensors;
        let dt = 1e-3;
        let mut levels = [self.idle; 2];
        let mut state = [-0.3, 0.2, 0.4, 0.04, -0.03, 0.02];
        let mut poses = Poses::default();
        let mut scatter = ChaCha8Rng::seed_from_u64(random.random());
        let mut delivered = || 1.0 + self.scatter * Distribution::<f64>::sample(&StandardNormal, &mut scatter);
        let delivered: Vec<[f64; 2]> = rows.iter().map(|_| [delivered(), delivered()]).collect();
        for k in 0..30_000_u32 {
            let t_s = f64::from(k) * dt;
            if k % 50 == 0 {
                let mut noise = |sd: f64| sd * Distribution::<f64>::sample(&StandardNormal, random);
                let (p, a) = (sensors.mocap_position_m, sensors.mocap_angle_rad);
                poses.t_s.push(t_s);
                poses.values.push([state[0] + noise(p), state[1] + noise(p), state[2] + noise(a)]);
            }
            let middle_s = t_s + 0.5 * dt;
            let row = rows.partition_point(|(stamp_s, _)| *stamp_s <= middle_s) - 1;
            for i in 0..2 {
                let is_gone = i == 1 && (gone[0]..gone[1]).contains(&middle_s);
                let goal = if is_gone { 0.0 } else { delivered[row][i] * rows[row].1[i] };
                let share = if self.lag_s > 0.0 { 1.0 - (-dt / self.lag_s).exp() } else { 1.0 };
                levels[i] += share * (goal - levels[i]);
            }
            let slope = self.rate(&state, levels);
            let middle: [f64; 6] = std::array::from_fn(|i| state[i] + 0.5 * dt * slope[i]);
            let slope = self.rate(&middle, levels);
            state = std::array::from_fn(|i| state[i] + dt * slope[i]);
        }
        poses
    }

    fn rate(self, s: &[f64; 6], levels: [f64; 2]) -> [f64; 6] {
        let (sin, cos) = s[2].sin_cos();
        let (mut force, mut torque) = ([0.0; 2], 0.0);
        for ((position, direction), u) in THRUSTERS.iter().zip(levels) {
            let thrust_n = u * (self.curve_n[0] + u * (self.curve_n[1] + u * self.curve_n[2]));
            force[0] += thrust_n * (cos * direction[0] - sin * direction[1]);
            force[1] += thrust_n * (sin * direction[0] + cos * direction[1]);
            torque += thrust_n * (position[0] * direction[1] - position[1] * direction[0]);
        }
        [s[3], s[4], s[5], force[0] / MASS_KG, force[1] / MASS_KG, torque / INERTIA_KG_M2]
    }

    /// A fitted and a validation run, in each of which one pulse is missing, are told of these pulses alone.
    fn assert_told(self) {
        println!("seed {SEED}");
        let (whole, _) = self.flight("whole", None, SEED);
        let (fitted, gone) = self.flight("fitted", Some(3), SEED + 1);
        let (judged, gone_too) = self.flight("judged", Some(2), SEED + 2);
        let found = diagnose(&self.plant(), &[whole, fitted], &[judged], &|_| ()).unwrap();
        let told: Vec<_> =
            found.missing_pulses.iter().map(|p| (p.run.as_str(), p.thruster, [p.from_s, p.to_s])).collect();
        assert_eq!(told, [("fitted", 2, gone), ("judged", 2, gone_too)], "{:?}", found.causes);
    }

    fn assert_told_of_nothing(self) {
        println!("seed {SEED}");
        let runs: Vec<Run> = (0..2).map(|k| self.flight(&format!("run-{k}"), None, SEED + k).0).collect();
        let found = diagnose(&self.plant(), &runs[..1], &runs[1..], &|_| ()).unwrap();
        assert!(found.missing_pulses.is_empty(), "{:?}", found.missing_pulses);
    }
}

#[test]
fn a_valve_that_stayed_shut_once_assert_told() {
    VALVES.assert_told();
}

#[test]
fn a_propeller_that_stood_still_once_assert_told() {
    PROPELLERS.assert_told();
}

#[test]
fn valves_that_opened_each_time_are_told_of_nothing() {
    VALVES.assert_told_of_nothing();
}

#[test]
fn propellers_that_turned_each_time_are_told_of_nothing() {
    PROPELLERS.assert_told_of_nothing();
}

#[test]
fn pulses_that_differ_are_told_as_errors_of_the_thrust_and_as_nothing_else() {
    println!("seed {SEED}");
    let uneven = Kind { scatter: 0.2, ..VALVES };
    let runs: Vec<Run> = (0..4).map(|k| uneven.flight(&format!("run-{k}"), None, SEED + k).0).collect();
    let found = diagnose(&uneven.plant(), &runs[..3], &runs[3..], &|_| ()).unwrap();
    assert!(found.causes.is_empty(), "{:?}", found.causes);
    let (errors, others): (Vec<_>, Vec<_>) = found.discrepancy.iter().partition(|d| d.name.contains("thruster"));
    assert!((0.1..0.4).contains(&errors[0].inferred), "{errors:?}");
    assert!(others.iter().all(|d| d.inferred < 3.0 * d.expected), "{others:?}");
}
