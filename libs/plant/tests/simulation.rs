//! The laboratory in motion: conservation, servos, sticking, valves, tank, grasp and contact.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{ONE_LINK_INERTIA, bare_base, close, one_link, quiet, simulate};
use fss_plant::{JointCommand, Plant, Simulation, Target};

fn position(q_rad: f64) -> JointCommand {
    JointCommand::Position { q_rad, qd_rad_s: 0.0 }
}

#[test]
fn a_swinging_arm_leaves_the_momentum_as_it_was() {
    let mut simulation = simulate(&quiet(), &[]);
    simulation.set_state([0.1, -0.2, 0.3], [0.02, -0.01, 0.05], &[-0.5, 1.0, -1.0, 0.5], &[]);
    let before = simulation.momentum();
    for (joint, target) in [0.3, -0.4, 0.5, 1.2].into_iter().enumerate() {
        simulation.set_joint(joint, position(target));
    }
    for _ in 0..60 {
        simulation.step(0.1);
    }
    let after = simulation.momentum();
    for i in 0..3 {
        close(after[i], before[i], 1e-12 * before[i].abs().max(1.0));
    }
    close(simulation.truth().q_rad[3], 1.2, 1e-3);
}

#[test]
fn swinging_joint_one_turns_the_base_most_of_the_way_back() {
    let mut simulation = simulate(&quiet(), &[]);
    simulation.set_joint(0, position(1.0));
    for joint in 1..4 {
        simulation.set_joint(joint, position(0.0));
    }
    simulation.step(8.0);
    let turned = simulation.truth().base_pose[2];
    assert!(turned < -0.7, "the base turned {turned} rad");
}

#[test]
fn a_frictionless_arm_keeps_its_energy_to_fourth_order() {
    let mut plant = quiet();
    for link in &mut plant.links {
        link.coulomb_friction_n_m = 0.0;
        link.viscous_friction_n_m_s_rad = 0.0;
        link.joint_limit_rad = 100.0;
    }
    let mut simulation = simulate(&plant, &[]);
    simulation.set_state([0.0; 3], [0.05, 0.0, 0.1], &[0.3, -0.8, 0.9, 0.2], &[0.6, -0.9, 1.2, -1.5]);
    let before = simulation.kinetic_energy_j();
    simulation.step(20.0);
    close(simulation.kinetic_energy_j(), before, 1e-9 * before);
}

#[test]
fn an_arm_at_rest_stays_exactly_at_rest() {
    let mut simulation = simulate(&quiet(), &[]);
    let q = [-0.5, 1.0, -1.0, 0.5];
    simulation.set_state([0.0; 3], [0.0; 3], &q, &[]);
    // A thruster pushes the base, too gently to move the joints.
    simulation.set_valves(&[false, false, true, false]);
    simulation.step(2.0);
    assert_eq!(simulation.truth().q_rad[..4], q);
    assert_eq!(simulation.truth().qd_rad_s[..4], [0.0; 4]);
    assert!(simulation.truth().base_velocity[0] > 0.0);
}

#[test]
fn a_servo_reaches_its_angle_and_rests_there() {
    let mut simulation = simulate(&quiet(), &[]);
    for joint in 0..4 {
        simulation.set_joint(joint, position(0.4));
    }
    simulation.step(10.0);
    let reached = simulation.truth().q_rad;
    for q in &reached[..4] {
        close(*q, 0.4, 3e-4);
    }
    simulation.step(5.0);
    assert_eq!(simulation.truth().q_rad, reached, "no hunting");
}

#[test]
fn a_servo_holds_a_rate() {
    let mut simulation = simulate(&quiet(), &[]);
    simulation.set_joint(1, JointCommand::Velocity { qd_rad_s: 0.2 });
    for joint in [0, 2, 3] {
        simulation.set_joint(joint, position(0.0));
    }
    simulation.step(3.0);
    close(simulation.truth().qd_rad_s[1], 0.2, 1e-3);
}

#[test]
fn a_current_gives_the_torque_constant_times_itself() {
    let mut simulation = simulate(&one_link(), &[]);
    simulation.set_joint(0, JointCommand::Current { current_a: 0.5 });
    simulation.step(1.0);
    close(simulation.truth().qd_rad_s[0], 0.5 * 0.6 / ONE_LINK_INERTIA, 1e-9);
    close(simulation.truth().torque_n_m[0], 0.3, 1e-12);
}

#[test]
fn a_motor_never_exceeds_its_torque() {
    let mut simulation = simulate(&one_link(), &[]);
    simulation.set_joint(0, JointCommand::Current { current_a: 50.0 });
    simulation.step(0.1);
    close(simulation.truth().torque_n_m[0], 1.8, 1e-12);
    close(simulation.truth().current_a[0], 3.0, 1e-12);
}

#[test]
fn a_stop_turns_a_joint_back() {
    let mut plant = one_link();
    plant.links[0].joint_limit_rad = 0.5;
    let mut simulation = simulate(&plant, &[]);
    simulation.set_state([0.0; 3], [0.0; 3], &[0.0], &[1.0]);
    let mut furthest = 0.0_f64;
    for _ in 0..200 {
        simulation.step(0.01);
        furthest = furthest.max(simulation.truth().q_rad[0]);
    }
    assert!(furthest > 0.5 && furthest < 0.53, "{furthest}");
    assert!(simulation.truth().qd_rad_s[0] < 0.0);
}

#[test]
fn an_open_valve_gives_its_impulse_wherever_in_the_step_it_moves() {
    let mut plant = bare_base();
    plant.valves.rise_s = 0.004;
    plant.valves.fall_s = 0.004;
    plant.valves.delay_s = 0.0031;
    let mut simulation = simulate(&plant, &[]);
    simulation.set_valve(2, true, 0.001_23);
    simulation.set_valve(2, false, 0.083_57);
    simulation.step(0.3);
    // Equal rise and fall: the impulse is thrust times commanded time.
    let open = 0.083_57 - 0.001_23;
    close(simulation.truth().base_velocity[0] * 10.0, 0.159 * open, 1e-9 * 0.159);
}

#[test]
fn a_short_command_opens_a_valve_for_its_minimum_time() {
    let mut plant = bare_base();
    plant.valves.min_on_s = 0.02;
    let mut simulation = simulate(&plant, &[]);
    simulation.set_valve(2, true, 0.0);
    simulation.set_valve(2, false, 0.001);
    simulation.step(0.1);
    close(simulation.truth().base_velocity[0] * 10.0, 0.159 * 0.02, 1e-9);
}

#[test]
fn thrust_costs_gas_and_the_base_grows_lighter() {
    let mut plant = bare_base();
    plant.tank = Plant::default_laboratory().unwrap().tank;
    let mut simulation = simulate(&plant, &[]);
    let full = simulation.tank_pressure_pa().unwrap();
    simulation.set_valves(&[true; 8]);
    simulation.step(10.0);
    let used = 8.0 * 0.159 * 10.0 / (60.0 * 9.80665);
    close(simulation.gas_used_kg(), used, 1e-9);
    close(simulation.model().total_mass_kg(), 10.0 - used, 1e-6);
    assert!(simulation.tank_pressure_pa().unwrap() < full);
}

#[test]
fn an_empty_tank_pushes_no_more() {
    let mut plant = bare_base();
    plant.tank = Plant::default_laboratory().unwrap().tank;
    plant.tank.as_mut().unwrap().volume_m3 = 2e-6;
    let mut simulation = simulate(&plant, &[]);
    simulation.set_valves(&[false, false, true, true]);
    simulation.step(30.0);
    let speed = simulation.truth().base_velocity[0];
    simulation.step(5.0);
    close(simulation.truth().base_velocity[0], speed, 0.01 * speed);
}

#[test]
fn batteries_run_down() {
    let mut simulation = Simulation::new(&Plant::default_laboratory().unwrap(), 1).unwrap();
    simulation.step(0.1);
    let fresh = (simulation.base_battery_v().unwrap(), simulation.link_battery_v(2).unwrap());
    simulation.step(20.0);
    assert!(simulation.base_battery_v().unwrap() < fresh.0);
    assert!(simulation.link_battery_v(2).unwrap() < fresh.1);
}

#[test]
fn the_same_seed_gives_the_same_truth_to_the_last_bit() {
    let plant = Plant::default_laboratory().unwrap();
    let run = |seed| {
        let mut simulation = Simulation::new(&plant, seed).unwrap();
        simulation.set_joint(1, position(0.7));
        simulation.set_valve(4, true, 0.0);
        simulation.step(2.0);
        simulation.truth()
    };
    assert_eq!(run(7), run(7));
    assert_ne!(run(7), run(8), "the room's air differs");
}

/// Two bodies' momentum about the table's origin.
fn with_target(simulation: &Simulation, target: &Target) -> [f64; 3] {
    let [px, py, l] = simulation.momentum();
    let (pose, velocity) = (simulation.truth().target_pose, simulation.truth().target_velocity);
    let (tx, ty) = (target.mass_kg * velocity[0], target.mass_kg * velocity[1]);
    [px + tx, py + ty, l + pose[0] * ty - pose[1] * tx + target.inertia_kg_m2 * velocity[2]]
}

fn approaching() -> (Simulation, Target) {
    let mut plant = quiet();
    let target = Target {
        mass_kg: 6.0,
        inertia_kg_m2: 0.1,
        pose: [1.74, 0.48, 0.2],
        velocity: [-0.05, 0.01, 0.1],
        radius_m: 0.15,
        restitution: 0.5,
    };
    plant.target = Some(target.clone());
    let mut simulation = simulate(&plant, &[]);
    simulation.set_state([0.0; 3], [0.03, 0.0, 0.01], &[0.0; 4], &[]);
    (simulation, target)
}

#[test]
fn a_grasp_keeps_the_momentum_of_both_bodies() {
    let (mut simulation, target) = approaching();
    let before = with_target(&simulation, &target);
    simulation.grasp().unwrap();
    let after = simulation.momentum();
    for i in 0..3 {
        close(after[i], before[i], 1e-12);
    }
    simulation.step(5.0);
    let later = simulation.momentum();
    for i in 0..3 {
        close(later[i], before[i], 1e-11);
    }
    // The target goes where the tip goes.
    let truth = simulation.truth();
    let apart = (truth.ee_pose[0] - truth.target_pose[0]).hypot(truth.ee_pose[1] - truth.target_pose[1]);
    assert!(apart < 0.17, "{apart}");
}

#[test]
fn a_released_target_floats_on_as_it_moved() {
    let (mut simulation, target) = approaching();
    simulation.grasp().unwrap();
    simulation.step(1.0);
    let before = (simulation.truth().target_velocity, simulation.momentum());
    simulation.release();
    assert_eq!(simulation.truth().target_velocity, before.0);
    let now = with_target(&simulation, &target);
    for i in 0..3 {
        close(now[i], before.1[i], 1e-10);
    }
}

#[test]
fn a_contact_keeps_the_momentum_of_both_bodies() {
    let (mut simulation, target) = approaching();
    let before = with_target(&simulation, &target);
    let approach = simulation.truth().target_velocity[0];
    simulation.step(3.0);
    assert!(simulation.truth().target_velocity[0] > approach + 0.01, "they met");
    let after = with_target(&simulation, &target);
    for i in 0..3 {
        close(after[i], before[i], 1e-11);
    }
}

#[test]
fn what_is_out_of_reach_is_not_grasped() {
    let (mut simulation, _) = approaching();
    simulation.set_target([-1.0, -1.0, 0.0], [0.0; 3]);
    simulation.step(0.01);
    assert!(simulation.grasp().unwrap_err().to_string().contains("out of reach"));
}
