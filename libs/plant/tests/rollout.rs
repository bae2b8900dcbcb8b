//! The fast path agrees with the full simulation.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{close, effect, quiet, simulate};
use fss_multibody::JointVector;
use fss_plant::{BaseSample, Effect, Grid, JointCommand, JointSample, Rollout, ValveHistory};

const START: [f64; 3] = [0.2, -0.1, 0.4];
const VELOCITY: [f64; 3] = [0.02, 0.01, -0.03];

/// Flies the full simulation with moving joints and valves, then the base alone with what the joints did, and returns
/// the largest difference in position [m] and angle [rad].
fn difference(effects: &[Effect]) -> (f64, f64) {
    let plant = quiet();
    let mut simulation = simulate(&plant, effects);
    simulation.set_state(START, VELOCITY, &[-0.5, 0.8, -0.6, 0.3], &[]);
    let grid = Grid { start_s: 0.0, step_s: 0.002, steps: 2000 };
    let mut joints = Vec::new();
    let mut poses = Vec::new();
    let mut rows = vec![(0.0, vec![false; 8])];
    for half in 0..=2 * grid.steps {
        let truth = simulation.truth();
        joints.push(JointSample { q_rad: JointVector::from(truth.q_rad), qd_rad_s: JointVector::from(truth.qd_rad_s) });
        if half % 2 == 0 {
            poses.push(truth.base_pose);
        }
        for joint in 0..4 {
            let phase = 0.7 * simulation.t_s() + joint as f64;
            let command = JointCommand::Position { q_rad: 0.6 * phase.sin(), qd_rad_s: 0.42 * phase.cos() };
            simulation.set_joint(joint, command);
        }
        if half % 505 == 250 {
            let open: Vec<bool> = (0..8).map(|i| (half / 505 + i) % 3 == 0).collect();
            simulation.set_valves(&open);
            rows.push((simulation.t_s(), open));
        }
        simulation.step(0.5 * grid.step_s);
    }
    let rollout = Rollout::with(&plant, effects).unwrap();
    let start = BaseSample { t_s: 0.0, pose: START, velocity: VELOCITY };
    let thrust = rollout.thrust(&ValveHistory::new(rows), &grid, &joints);
    let mut out = vec![start; grid.steps + 1];
    rollout.run(&start, &grid, &joints, &thrust, &mut out);
    let mut worst = (0.0_f64, 0.0_f64);
    for (sample, pose) in out.iter().zip(&poses) {
        let apart = (sample.pose[0] - pose[0]).hypot(sample.pose[1] - pose[1]);
        worst = (worst.0.max(apart), worst.1.max((sample.pose[2] - pose[2]).abs()));
    }
    worst
}

#[test]
fn the_base_alone_goes_as_in_the_full_simulation() {
    // Joint friction has corners in the joint rates, which the steps do not resolve.
    let (position, angle) = difference(&[]);
    assert!(position < 3e-6 && angle < 1e-5, "{position} m, {angle} rad");
}

#[test]
fn effects_act_alike_in_both() {
    let effects = [
        effect("table_tilt", &[("accel_x_m_s2", 0.003), ("accel_y_m_s2", -0.002)]),
        effect("base_linear_drag", &[("coefficient_N_s_m", 0.3)]),
        effect("thruster_delay", &[("delay_s", 0.037)]).at(2),
        effect("thruster_rise_time", &[("time_s", 0.02)]).at(3),
        effect("thruster_gain", &[("scale", 0.5)]).at(1),
        effect("plume_impingement", &[("fraction", 0.4)]),
        effect("payload", &[("mass_kg", 0.7)]).from_onset(2.0),
        effect("base_com", &[("x_m", 0.02), ("y_m", -0.01)]),
    ];
    let (position, angle) = difference(&effects);
    assert!(position < 3e-6 && angle < 1e-5, "{position} m, {angle} rad");
}

#[test]
fn a_window_in_the_middle_of_a_run_knows_the_valves_before_it() {
    let rollout = Rollout::new(&quiet()).unwrap();
    let rows = vec![(0.5, vec![false, false, true, false, false, false, false, false]), (1.005, vec![false; 8])];
    let grid = Grid { start_s: 1.0, step_s: 0.01, steps: 3 };
    let thrust = rollout.thrust(&ValveHistory::new(rows), &grid, &[]);
    close(thrust[0][0], 0.5 * 0.159, 1e-12);
    close(thrust[1][0], 0.0, 1e-12);
}
