//! Two laboratories, one table: vehicles that see, push and hold each other.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{Bench, MS, config, velocity};
use fss_lab::Start;
use fss_messages::TruthState;
use fss_plant::{Plant, Target};
use fss_wire::link::{Command, Mode};

/// A vehicle without an arm, whose mass is about its base's origin.
fn disc() -> (Plant, Target) {
    let mut plant = common::plant();
    plant.links.clear();
    plant.disturbance = None;
    let (mass_kg, inertia_kg_m2) = (plant.base.mass_kg, plant.base.inertia_kg_m2);
    let target =
        Target { mass_kg, inertia_kg_m2, radius_m: 0.15, restitution: 0.5, pose: [0.0; 3], velocity: [0.0; 3] };
    (plant, target)
}

/// The tip of the default vehicle's arm at rest: x, y (m), direction (rad).
fn tip() -> [f64; 3] {
    Bench::new(&common::plant(), config()).laboratory.truth().ee
}

/// So far ahead of the tip and beside it, facing it.
fn before_the_tip(ahead_m: f64, beside_m: f64) -> [f64; 3] {
    let [x, y, theta] = tip();
    let (sin, cos) = theta.sin_cos();
    [x + cos * ahead_m - sin * beside_m, y + sin * ahead_m + cos * beside_m, theta + std::f64::consts::PI]
}

/// A chaser and, before its stretched arm, a vehicle without one.
struct Table {
    chaser: Bench,
    other: Bench,
}

impl Table {
    fn new(other_pose: [f64; 3], other_velocity: [f64; 3]) -> Self {
        let (disc, target) = disc();
        let mut plant = common::plant();
        plant.disturbance = None;
        plant.target = Some(target);
        let chaser = Bench::new(&plant, config());
        let mut config = config();
        config.start = Start { pose: other_pose, velocity: other_velocity, ..Start::default() };
        Self { chaser, other: Bench::new(&disc, config) }
    }

    /// Lets time pass; each laboratory hears every millisecond what the other one said, but for each `lost`th word.
    fn wait(&mut self, duration_ns: u64, lost: u64) {
        for step in 1..=duration_ns / MS {
            let (chaser, other) = (self.chaser.laboratory.tell(), self.other.laboratory.tell());
            if step % lost != 0 {
                self.chaser.laboratory.hear(&other);
                self.other.laboratory.hear(&chaser);
            }
            self.chaser.wait(MS);
            self.other.wait(MS);
        }
    }

    fn truth(&self) -> [TruthState; 2] {
        [self.chaser.laboratory.truth(), self.other.laboratory.truth()]
    }

    /// Of both vehicles: kg m/s, kg m/s, kg m2/s about the table's middle.
    fn momentum(&self) -> [f64; 3] {
        let of = |bench: &Bench| bench.laboratory.simulation().momentum();
        // What is held is on board of the chaser.
        let other = if self.truth()[0].target_held == 0 { of(&self.other) } else { [0.0; 3] };
        std::array::from_fn(|i| of(&self.chaser)[i] + other[i])
    }
}

#[track_caller]
fn close(a: [f64; 3], b: [f64; 3], tolerance: f64) {
    assert!((0..3).all(|i| (a[i] - b[i]).abs() <= tolerance), "{a:?} and {b:?}");
}

fn base(truth: &TruthState) -> [f64; 3] {
    [truth.x_m, truth.y_m, truth.theta_rad]
}

#[test]
fn a_vehicle_is_seen_where_its_own_laboratory_has_it() {
    let mut table = Table::new([1.5, 0.4, 0.3], [-0.02, 0.01, 0.05]);
    table.other.set_valves(0b1100);
    table.wait(2000 * MS, 3);
    let [chaser, other] = table.truth();
    assert!(other.x_m - 1.5 + 0.04 > 0.05, "its thrusters moved it");
    close(chaser.target, base(&other), 1e-4);
    close(chaser.target_rate, [other.vx_m_s, other.vy_m_s, other.omega_rad_s], 1e-4);
}

#[test]
fn an_arm_that_meets_the_other_vehicle_pushes_it_and_both_keep_their_momentum() {
    let (sin, cos) = tip()[2].sin_cos();
    let mut table = Table::new(before_the_tip(0.17, 0.0), [-0.03 * cos, -0.03 * sin, 0.0]);
    let before = table.momentum();
    table.wait(3000 * MS, 5);
    let [chaser, other] = table.truth();
    let along = |truth: &TruthState| cos * truth.vx_m_s + sin * truth.vy_m_s;
    assert!(along(&other) > -0.02 && along(&chaser) != 0.0, "they met: {} and {}", along(&other), along(&chaser));
    close(table.momentum(), before, 1e-9);
    close(chaser.target, base(&other), 1e-4);
}

#[test]
fn a_vehicle_that_is_held_goes_where_the_gripper_takes_it_and_floats_on_when_it_is_let_go() {
    // Its handle, on the rim, is in the gripper.
    let mut table = Table::new(before_the_tip(0.151, 0.001), [0.004, 0.002, 0.0]);
    let gripper = |table: &mut Table, closed: bool| {
        table.chaser.command(3, Command { gripper: closed, mode: Mode::Disabled, ..velocity(0.0) });
    };
    table.wait(20 * MS, 7);
    let before = table.momentum();
    gripper(&mut table, true);
    table.wait(100 * MS, 7);
    let [chaser, _] = table.truth();
    assert_eq!(chaser.target_held, 1, "it took hold");
    close(table.momentum(), before, 1e-9);
    // The thrusters of the one that holds move both.
    table.chaser.set_valves(0b1100);
    for _ in 0..10 {
        gripper(&mut table, true);
        table.wait(100 * MS, 7);
    }
    table.chaser.set_valves(0);
    let [chaser, other] = table.truth();
    close(chaser.target, base(&other), 1e-4);
    close(chaser.target_rate, [other.vx_m_s, other.vy_m_s, other.omega_rad_s], 1e-3);
    assert!(other.vx_m_s > 0.005, "it is pulled along: {} m/s", other.vx_m_s);
    gripper(&mut table, false);
    table.wait(100 * MS, 7);
    let [chaser, other] = table.truth();
    assert_eq!(chaser.target_held, 0, "it let go");
    let there = base(&other);
    table.wait(1000 * MS, 7);
    let [chaser, later] = table.truth();
    close(base(&later), std::array::from_fn(|i| there[i] + [other.vx_m_s, other.vy_m_s, other.omega_rad_s][i]), 1e-3);
    close(chaser.target, base(&later), 1e-4);
}

#[test]
fn where_the_other_laboratory_falls_silent_its_vehicle_floats_on_as_it_moved() {
    let mut table = Table::new([1.5, 0.4, 0.3], [-0.02, 0.01, 0.05]);
    table.wait(100 * MS, 1000);
    table.wait(3000 * MS, 1);
    let [chaser, other] = table.truth();
    close(chaser.target, base(&other), 1e-3);
}
