//! Proportional thrusters: levels through lag and curve, against closed forms; valves are the levels 0 and 1.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{bare_base, close, effect, simulate};
use fss_plant::{Effect, Grid, Plant, Pulse, Rollout, ValveHistory};

const CURVE_N: [f64; 3] = [0.03, 1.05, -0.43];
const LAG_S: f64 = 0.03;

/// The bare base with thrusters that follow a curve, and its thruster 3, which pushes along +x, with a lag too.
fn propellers() -> Plant {
    let mut plant = bare_base();
    plant.base.inertia_kg_m2 = 1e6;
    for thruster in &mut plant.thrusters {
        thruster.thrust_curve = Some(CURVE_N);
    }
    plant.thrusters[2].lag_s = Some(LAG_S);
    plant
}

fn curve_n(level: f64) -> f64 {
    level * (CURVE_N[0] + level * (CURVE_N[1] + level * CURVE_N[2]))
}

/// Levels of the eight thrusters where only number 3 does anything.
fn third(level: f64) -> Vec<f64> {
    (0..8).map(|i| if i == 2 { level } else { 0.0 }).collect()
}

/// Impulse of thruster 3 through `duration_s` (N s), in steps that no command falls on.
fn impulse(plant: &Plant, effects: &[Effect], rows: Vec<(f64, Vec<f64>)>, duration_s: f64, steps: usize) -> f64 {
    let rollout = Rollout::with(plant, effects).unwrap();
    let grid = Grid { start_s: 0.0, step_s: duration_s / steps as f64, steps };
    rollout.thruster_forces(&ValveHistory::new(rows), &grid)[2].iter().sum::<f64>() * grid.step_s
}

/// Integral of the curve over a level that goes from 0 towards `goal` with a lag, to infinity less the goal's own: the
/// impulse that a step through the lag lacks (N s).
fn lacking(goal: f64, lag_s: f64) -> f64 {
    // Of u = g (1 - e): int (g - u) = g lag, int (g^2 - u^2) = 3/2 g^2 lag, int (g^3 - u^3) = 11/6 g^3 lag.
    lag_s * (CURVE_N[0] * goal + 1.5 * CURVE_N[1] * goal.powi(2) + 11.0 / 6.0 * CURVE_N[2] * goal.powi(3))
}

#[test]
fn a_step_gives_the_impulse_of_the_curve_at_the_lagged_level() {
    for goal in [0.2, 0.7, 1.0] {
        let rows = vec![(0.123_4, third(goal))];
        let expected = curve_n(goal) * (2.0 - 0.123_4) - lacking(goal, LAG_S);
        for steps in [7, 100, 1000] {
            close(impulse(&propellers(), &[], rows.clone(), 2.0, steps), expected, 1e-10);
        }
    }
}

#[test]
fn any_levels_give_what_a_fine_integration_of_the_lag_gives() {
    let level = |k: usize| 0.5 + 0.45 * (1.7 * k as f64 * k as f64).sin();
    let rows: Vec<(f64, Vec<f64>)> = (0..200).map(|k| (0.01 * k as f64 - 0.5, third(level(k)))).collect();
    let fine = 1e-5;
    let (mut u, mut expected, mut at) = (0.0, 0.0, 0);
    for k in 0..150_000 {
        let t_s = f64::from(k) * fine - 0.5;
        while rows.get(at).is_some_and(|row| row.0 <= t_s + 1e-9) {
            at += 1;
        }
        let goal = rows[at - 1].1[2];
        let middle = goal + (u - goal) * (-0.5 * fine / LAG_S).exp();
        u = goal + (u - goal) * (-fine / LAG_S).exp();
        if t_s > -1e-9 {
            expected += curve_n(middle) * fine;
        }
    }
    close(impulse(&propellers(), &[], rows, 1.0, 83), expected, 1e-7);
}

#[test]
fn the_simulation_pushes_as_the_rollout_says() {
    let mut simulation = simulate(&propellers(), &[]);
    let level = |k: usize| 0.5 + 0.5 * (0.9 * k as f64).cos();
    let rows: Vec<(f64, Vec<f64>)> = (0..50).map(|k| (0.013 * k as f64, third(level(k)))).collect();
    for (_, levels) in &rows {
        simulation.set_level(2, levels[2], simulation.t_s());
        simulation.step(0.013);
    }
    close(simulation.momentum()[0], impulse(&propellers(), &[], rows, 0.65, 50), 1e-9);
    close(simulation.openings().nth(2).unwrap(), level(49), 0.6);
}

#[test]
fn a_window_late_in_a_run_knows_the_levels_before_it() {
    let rows: Vec<(f64, Vec<f64>)> =
        (0..3000).map(|k| (0.004 * f64::from(k), third(0.5 + 0.5 * (0.3 * f64::from(k)).sin()))).collect();
    let rollout = Rollout::new(&propellers()).unwrap();
    let history = ValveHistory::new(rows);
    let all = rollout.thruster_forces(&history, &Grid { start_s: 0.0, step_s: 0.02, steps: 500 });
    let late = rollout.thruster_forces(&history, &Grid { start_s: 9.0, step_s: 0.02, steps: 50 });
    for (a, b) in all[2][450..].iter().zip(&late[2]) {
        close(*a, *b, 1e-14);
    }
    assert_eq!(late.len(), 8);
    assert!(late[0].iter().all(|force| *force == 0.0));
}

#[test]
fn valves_are_the_levels_0_and_1_of_a_straight_curve() {
    let mut valves = bare_base();
    valves.valves.rise_s = LAG_S;
    valves.valves.fall_s = LAG_S;
    let mut propellers = valves.clone();
    for thruster in &mut propellers.thrusters {
        thruster.thrust_curve = Some([0.159, 0.0, 0.0]);
        thruster.lag_s = Some(LAG_S);
    }
    let states: Vec<(f64, Vec<bool>)> =
        (0..30).map(|k| (0.07 * f64::from(k), (0..8).map(|i| (k + i) % 3 == 0).collect())).collect();
    let levels = |row: &(f64, Vec<bool>)| (row.0, row.1.iter().map(|open| f64::from(*open)).collect::<Vec<_>>());
    let as_levels = ValveHistory::new(states.iter().map(levels).collect());
    let as_states = ValveHistory::new(states);
    assert_eq!(as_levels, as_states);
    let grid = Grid { start_s: 0.0, step_s: 0.01, steps: 250 };
    let thrust = |plant: &Plant| Rollout::new(plant).unwrap().thrust(&as_states, &grid, &[]);
    assert_eq!(thrust(&valves), thrust(&propellers));
}

#[test]
fn a_level_between_opens_a_valve_that_far() {
    close(impulse(&bare_base(), &[], vec![(0.0, third(0.4))], 1.0, 10), 0.4 * 0.159, 1e-12);
    let mut plant = bare_base();
    plant.valves.min_on_s = 0.5;
    let pulse = vec![(0.0, third(0.4)), (0.1, third(0.0))];
    close(impulse(&plant, &[], pulse.clone(), 1.0, 10), 0.5 * 0.4 * 0.159, 1e-12);
    plant.thrusters[2].lag_s = Some(0.0);
    close(impulse(&plant, &[], pulse, 1.0, 10), 0.1 * 0.4 * 0.159, 1e-12);
}

#[test]
fn effects_act_on_a_proportional_thruster() {
    let plant = propellers();
    let step = |effects: &[Effect]| impulse(&plant, effects, vec![(0.0, third(0.7))], 2.0, 37);
    let expected = |lag_s: f64| 2.0 * curve_n(0.7) - lacking(0.7, lag_s);
    close(step(&[effect("thruster_gain", &[("scale", 0.8)]).at(3)]), 0.8 * expected(LAG_S), 1e-10);
    let late = effect("thruster_delay", &[("delay_s", 0.25)]).at(3);
    close(step(&[late]), expected(LAG_S) - 0.25 * curve_n(0.7), 1e-10);
    close(step(&[effect("thruster_rise_time", &[("time_s", 0.05)]).at(3)]), expected(0.05), 1e-10);
    let leak = effect("thruster_leak", &[("thrust_N", 0.01)]).at(3);
    close(step(&[leak]), expected(LAG_S) + 0.01 * (2.0 * 0.3 + 0.7 * LAG_S), 1e-10);
    let trend = effect("thruster_pressure_trend", &[("fraction_per_s", -0.1)]);
    close(step(&[trend]), 0.9 * expected(LAG_S), 0.1 * LAG_S);
    let turned = effect("thruster_misalignment", &[("angle_rad", 0.2)]).at(3);
    let grid = Grid { start_s: 1.0, step_s: 0.1, steps: 1 };
    let history = ValveHistory::new(vec![(0.0, third(0.7))]);
    let push = Rollout::with(&plant, &[turned]).unwrap().thrust(&history, &grid, &[])[0];
    close(push[0], curve_n(0.7) * 0.2_f64.cos(), 1e-12);
    close(push[1], curve_n(0.7) * 0.2_f64.sin(), 1e-12);
    let droop = effect("thruster_pressure_droop", &[("fraction_per_extra_valve", 0.1)]);
    let rollout = Rollout::with(&plant, &[droop]).unwrap();
    let forces = rollout.thruster_forces(&ValveHistory::new(vec![(0.0, vec![0.5; 8])]), &grid);
    close(forces[2][0], (1.0 - 0.1 * 3.5) * curve_n(0.5), 1e-12);
}

#[test]
fn a_slow_propeller_is_slow_down_as_up() {
    let slow = effect("thruster_rise_time", &[("time_s", 0.2)]).at(3);
    let pulse = vec![(0.0, third(1.0)), (5.0, third(0.0))];
    // Down from 1: int u = lag, int u^2 = lag / 2, int u^3 = lag / 3.
    let after = 0.2 * (CURVE_N[0] + CURVE_N[1] / 2.0 + CURVE_N[2] / 3.0);
    close(impulse(&propellers(), &[slow], pulse, 10.0, 100), 5.0 * curve_n(1.0) - lacking(1.0, 0.2) + after, 1e-9);
}

#[test]
fn a_pulse_is_what_stands_above_an_idling_level() {
    let rows = vec![(0.0, third(0.03)), (1.0, third(0.6)), (1.2, third(0.2)), (1.5, third(0.03)), (2.0, third(1.0))];
    let history = ValveHistory::new(rows.clone());
    let pulse = |from_s: f64, to_s: f64| Pulse { thruster: 2, from_s, to_s };
    assert_eq!(history.pulses(), [pulse(1.0, 1.5), pulse(2.0, f64::INFINITY)]);
    let mut shut = rows;
    (shut[1].1[2], shut[2].1[2]) = (0.0, 0.0);
    assert_eq!(history.without(&pulse(1.0, 1.5)), ValveHistory::new(shut));
}

#[test]
fn valves_that_open_together_give_a_pulse_each() {
    let both = ValveHistory::new(vec![(0.5, vec![true, true]), (0.7, vec![false, true]), (0.9, vec![false, false])]);
    let pulse = |thruster: usize, to_s: f64| Pulse { thruster, from_s: 0.5, to_s };
    assert_eq!(both.pulses(), [pulse(0, 0.7), pulse(1, 0.9)]);
}
