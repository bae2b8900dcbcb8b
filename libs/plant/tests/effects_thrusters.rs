//! Thrusters: each effect does what its sentence says.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{bare_base, close, effect, quiet, simulate};
use fss_plant::Effect;

const THRUST_N: f64 = 0.159;

/// Impulse that the bare base gets when these valves (from 1) are open for `open_s` and `after_s` more pass
/// `[N s, N s, N m s]`.
fn impulse(effects: &[Effect], valves: &[usize], open_s: f64, after_s: f64) -> [f64; 3] {
    let mut plant = bare_base();
    // Heavy, so that it hardly turns meanwhile.
    plant.base.inertia_kg_m2 = 1e6;
    let mut simulation = simulate(&plant, effects);
    for valve in valves {
        simulation.set_valve(valve - 1, true, 0.0);
    }
    simulation.step(open_s);
    for valve in valves {
        simulation.set_valve(valve - 1, false, open_s);
    }
    if after_s > 0.0 {
        simulation.step(after_s);
    }
    let v = simulation.truth().base_velocity;
    [10.0 * v[0], 10.0 * v[1], 1e6 * v[2]]
}

#[test]
fn a_weak_thruster_gives_that_share_of_its_thrust() {
    let weak = effect("thruster_gain", &[("scale", 0.72)]).at(3);
    close(impulse(std::slice::from_ref(&weak), &[3], 1.0, 0.0)[0], 0.72 * THRUST_N, 1e-9);
    close(impulse(&[weak], &[4], 1.0, 0.0)[0], THRUST_N, 1e-9);
}

#[test]
fn a_stuck_shut_thruster_gives_nothing() {
    let stuck = effect("thruster_gain", &[("scale", 0.0)]).at(3);
    assert_eq!(impulse(&[stuck], &[3], 1.0, 0.0), [0.0; 3]);
}

#[test]
fn a_leak_turns_the_base() {
    let leak = effect("thruster_leak", &[("thrust_N", 0.01)]).at(3);
    let push = impulse(&[leak], &[], 2.0, 0.0);
    close(push[0], 0.02, 1e-9);
    close(push[2], -0.065 * 0.02, 1e-9);
}

#[test]
fn a_valve_stuck_open_gives_its_whole_thrust_whatever_is_commanded() {
    let stuck = effect("thruster_leak", &[("thrust_N", THRUST_N)]).at(3);
    close(impulse(&[stuck], &[3], 1.0, 1.0)[0], 2.0 * THRUST_N, 1e-9);
}

#[test]
fn a_misaligned_nozzle_pushes_sideways_too() {
    let turned = effect("thruster_misalignment", &[("angle_rad", 0.2)]).at(3);
    let push = impulse(&[turned], &[3], 1.0, 0.0);
    close(push[0], THRUST_N * 0.2_f64.cos(), 1e-9);
    close(push[1], THRUST_N * 0.2_f64.sin(), 1e-9);
}

#[test]
fn a_late_valve_gives_the_same_impulse_later() {
    let late = effect("thruster_delay", &[("delay_s", 0.25)]).at(3);
    close(impulse(std::slice::from_ref(&late), &[3], 0.25, 0.0)[0], 0.0, 1e-12);
    close(impulse(std::slice::from_ref(&late), &[3], 1.0, 0.0)[0], 0.75 * THRUST_N, 1e-9);
    close(impulse(&[late], &[3], 1.0, 0.5)[0], THRUST_N, 1e-9);
}

#[test]
fn a_slow_valve_loses_its_rise_time_of_impulse() {
    let slow = effect("thruster_rise_time", &[("time_s", 0.05)]).at(3);
    let expected = THRUST_N * (1.0 - 0.05 * (1.0 - (-1.0 / 0.05_f64).exp()));
    close(impulse(&[slow], &[3], 1.0, 0.5)[0], expected, 1e-9);
}

#[test]
fn open_valves_starve_each_other() {
    let droop = effect("thruster_pressure_droop", &[("fraction_per_extra_valve", 0.08)]);
    close(impulse(std::slice::from_ref(&droop), &[3], 1.0, 0.0)[0], THRUST_N, 1e-9);
    close(impulse(std::slice::from_ref(&droop), &[3, 4], 1.0, 0.0)[0], 2.0 * 0.92 * THRUST_N, 1e-9);
    close(impulse(&[droop], &[3, 4, 7], 1.0, 0.0)[0], 2.0 * 0.84 * THRUST_N, 1e-9);
}

#[test]
fn a_falling_pressure_takes_thrust_with_time() {
    let trend = effect("thruster_pressure_trend", &[("fraction_per_s", -0.02)]);
    // Mean of 1 at the start and 0.8 after 10 s.
    close(impulse(&[trend], &[3], 10.0, 0.0)[0], 0.9 * THRUST_N * 10.0, 1e-9);
}

#[test]
fn swapped_valves_answer_to_each_others_commands() {
    let swap = effect("valve_swap", &[("other_index", 7.0)]).at(3);
    let push = impulse(std::slice::from_ref(&swap), &[3], 1.0, 0.0);
    close(push[0], 0.0, 1e-9);
    close(push[1], THRUST_N, 1e-9);
    close(impulse(std::slice::from_ref(&swap), &[7], 1.0, 0.0)[0], THRUST_N, 1e-9);
    close(impulse(&[swap], &[4], 1.0, 0.0)[0], THRUST_N, 1e-9);
}

#[test]
fn a_plume_that_hits_the_arm_gives_back_a_share_of_the_thrust() {
    let mut plant = quiet();
    // Joint 1 straight ahead: link 1 lies in the plumes of thrusters 1 and 2, which blow along x.
    plant.base.joint1_xy_m = [0.2058, 0.0];
    plant.base.joint1_angle_rad = 0.0;
    plant.thrusters[0].position_m = [0.135, 0.0];
    let push = |effects: &[Effect], q1: f64| {
        let mut simulation = simulate(&plant, effects);
        simulation.set_state([0.0; 3], [0.0; 3], &[q1, 0.0, 0.0, 0.0], &[]);
        simulation.set_valve(0, true, 0.0);
        simulation.step(0.5);
        simulation.momentum()[0] / 0.5
    };
    let plume = effect("plume_impingement", &[("fraction", 0.3)]).at(1);
    close(push(&[], 0.0), -THRUST_N, 1e-6);
    close(push(std::slice::from_ref(&plume), 0.0), -0.7 * THRUST_N, 1e-4);
    // An arm turned aside is out of the plume.
    close(push(&[plume], 1.5), -THRUST_N, 1e-4);
}

#[test]
fn a_valve_clock_that_is_ahead_makes_valves_act_before_their_stamps() {
    use fss_plant::{Grid, Rollout, ValveHistory};
    let offset = effect("clock_offset", &[("offset_s", 0.04)]).on("valves");
    let rollout = Rollout::with(&bare_base(), &[offset]).unwrap();
    let mut open = vec![false; 8];
    open[2] = true;
    let rows = ValveHistory::new(vec![(0.0, vec![false; 8]), (0.5, open), (0.7, vec![false; 8])]);
    let thrust = rollout.thrust(&rows, &Grid { start_s: 0.0, step_s: 0.01, steps: 100 }, &[]);
    let on: Vec<usize> = (0..100).filter(|i| thrust[*i][0] > 0.0).collect();
    assert_eq!((on[0], on.len()), (46, 20), "from 0.46 s to 0.66 s");
}
