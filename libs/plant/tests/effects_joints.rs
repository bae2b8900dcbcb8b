//! Joints, drives and their sensors: each effect does what its sentence says.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{ONE_LINK_INERTIA, close, effect, one_link, quiet, simulate};
use fss_plant::{Effect, Instruments, JointCommand, Simulation};

/// One link on a clamped base that starts at this angle and rate.
fn swinging(effects: &[Effect], q_rad: f64, qd_rad_s: f64) -> Simulation {
    let mut simulation = simulate(&one_link(), effects);
    simulation.set_state([0.0; 3], [0.0; 3], &[q_rad], &[qd_rad_s]);
    simulation
}

fn rate(simulation: &Simulation) -> f64 {
    simulation.truth().qd_rad_s[0]
}

#[test]
fn coulomb_friction_stops_a_joint_in_inertia_times_rate_over_torque() {
    let friction = effect("joint_coulomb_friction", &[("torque_N_m", 0.1)]).at(1);
    let mut simulation = swinging(&[friction], 0.0, 0.8);
    let time = ONE_LINK_INERTIA * 0.8 / 0.1;
    simulation.step(time - 1e-4);
    assert!(rate(&simulation) > 0.0);
    close(rate(&simulation), 0.1 * 1e-4 / ONE_LINK_INERTIA, 1e-9);
    simulation.step(2e-4);
    assert_eq!(rate(&simulation), 0.0, "and it rests exactly");
    close(simulation.truth().q_rad[0], 0.5 * 0.8 * time, 1e-9);
    simulation.step(1.0);
    assert_eq!(rate(&simulation), 0.0);
}

#[test]
fn coulomb_friction_holds_a_joint_against_less_torque_than_itself() {
    let friction = effect("joint_coulomb_friction", &[("torque_N_m", 0.3)]);
    let mut simulation = swinging(&[friction], 0.0, 0.0);
    simulation.set_joint(0, JointCommand::Current { current_a: 0.29 / 0.6 });
    simulation.step(1.0);
    assert_eq!(simulation.truth().q_rad[0], 0.0);
    close(simulation.truth().torque_n_m[0], 0.0, 1e-12);
    simulation.set_joint(0, JointCommand::Current { current_a: 0.31 / 0.6 });
    simulation.step(1.0);
    close(rate(&simulation), 0.01 / ONE_LINK_INERTIA, 1e-9);
}

#[test]
fn viscous_friction_slows_a_joint_exponentially() {
    let friction = effect("joint_viscous_friction", &[("coefficient_N_m_s_rad", 0.1)]);
    let mut simulation = swinging(&[friction], 0.0, 0.5);
    simulation.step(2.0);
    close(rate(&simulation), 0.5 * (-0.1 * 2.0 / ONE_LINK_INERTIA).exp(), 1e-10);
}

#[test]
fn a_sticking_joint_needs_more_to_start_than_to_slide() {
    let friction = [
        effect("joint_coulomb_friction", &[("torque_N_m", 0.1)]),
        effect("joint_stribeck_friction", &[("torque_N_m", 0.15), ("velocity_rad_s", 0.02)]),
    ];
    let mut simulation = swinging(&friction, 0.0, 0.0);
    simulation.set_joint(0, JointCommand::Current { current_a: 0.24 / 0.6 });
    simulation.step(1.0);
    assert_eq!(rate(&simulation), 0.0, "0.24 N m do not start it");
    // Once it slides, 0.24 N m drive it on against 0.1 N m.
    let mut simulation = swinging(&friction, 0.0, 1.0);
    simulation.set_joint(0, JointCommand::Current { current_a: 0.24 / 0.6 });
    simulation.step(1.0);
    close(rate(&simulation), 1.0 + 0.14 / ONE_LINK_INERTIA, 1e-3);
}

#[test]
fn a_joint_spring_swings_a_link_about_its_rest() {
    let spring = effect("joint_spring", &[("stiffness_N_m_rad", 0.5), ("rest_rad", 0.3)]);
    let mut simulation = swinging(&[spring], 0.0, 0.0);
    simulation.step(std::f64::consts::PI * (ONE_LINK_INERTIA / 0.5).sqrt());
    close(simulation.truth().q_rad[0], 0.6, 1e-9);
    close(rate(&simulation), 0.0, 1e-8);
}

#[test]
fn an_elastic_drive_winds_up_by_torque_over_stiffness() {
    let mut plant = one_link();
    plant.base.clamped = true;
    plant.table.gravity_m_s2 = [0.0, -0.5];
    plant.base.joint1_angle_rad = 0.0;
    let stiff = effect("joint_flexibility", &[("stiffness_N_m_rad", 50.0)]);
    let mut simulation = simulate(&plant, &[stiff]);
    simulation.set_joint(0, JointCommand::Position { q_rad: 0.0, qd_rad_s: 0.0 });
    simulation.step(20.0);
    let truth = simulation.truth();
    // The motor holds its own angle; the link sags by its weight's torque over the stiffness.
    close(truth.motor_rad[0], 0.0, 1e-4);
    let torque = 2.88 * 0.5 * 0.1915 * truth.q_rad[0].cos();
    close(truth.q_rad[0], -torque / 50.0, 1e-4);
    close(truth.torque_n_m[0], torque, 5e-3);
}

#[test]
fn a_stiff_elastic_drive_is_a_rigid_one() {
    let mut rigid = simulate(&quiet(), &[]);
    let mut elastic = simulate(&quiet(), &[effect("joint_flexibility", &[("stiffness_N_m_rad", 1e5)])]);
    for simulation in [&mut rigid, &mut elastic] {
        for joint in 0..4 {
            simulation.set_joint(joint, JointCommand::Position { q_rad: 0.3, qd_rad_s: 0.0 });
        }
        simulation.step(3.0);
    }
    for joint in 0..4 {
        close(elastic.truth().q_rad[joint], rigid.truth().q_rad[joint], 2e-3);
    }
    let before = [0.0; 3];
    for (p, expected) in elastic.momentum().into_iter().zip(before) {
        close(p, expected, 1e-12);
    }
}

#[test]
fn within_its_play_a_link_moves_freely() {
    let play = effect("joint_backlash", &[("gap_rad", 0.02)]);
    let mut simulation = swinging(&[play], 0.0, 0.0);
    simulation.set_joint(0, JointCommand::Position { q_rad: 0.0, qd_rad_s: 0.0 });
    // A small push: the link drifts to the edge of its play while the motor stands.
    simulation.set_state([0.0; 3], [0.0; 3], &[0.0], &[0.01]);
    simulation.step(0.9);
    close(simulation.truth().q_rad[0], 0.009, 1e-4);
    let mut furthest = 0.0_f64;
    for _ in 0..300 {
        simulation.step(0.01);
        furthest = furthest.max(simulation.truth().q_rad[0]);
    }
    assert!(furthest > 0.0099 && furthest < 0.0115, "{furthest}");
}

#[test]
fn a_rippling_ratio_shows_between_link_and_motor() {
    let ripple = effect("drive_kinematic_error", &[("amplitude_rad", 0.004), ("cycles_per_rev", 10.0)]);
    let mut simulation = swinging(&[ripple], 0.0, 0.0);
    for target in [0.05, 0.157, 0.4] {
        simulation.set_joint(0, JointCommand::Position { q_rad: target, qd_rad_s: 0.0 });
        simulation.step(8.0);
        let truth = simulation.truth();
        close(truth.motor_rad[0], target, 1e-4);
        close(truth.q_rad[0] - truth.motor_rad[0], 0.004 * (10.0 * truth.q_rad[0]).sin(), 1e-12);
    }
}

#[test]
fn a_stronger_motor_gives_more_torque_for_the_same_current() {
    let stronger = effect("torque_constant", &[("scale", 1.2)]).at(1);
    let mut simulation = swinging(&[stronger], 0.0, 0.0);
    simulation.set_joint(0, JointCommand::Current { current_a: 0.5 });
    simulation.step(1.0);
    close(simulation.truth().current_a[0], 0.5, 1e-12);
    close(rate(&simulation), 1.2 * 0.3 / ONE_LINK_INERTIA, 1e-9);
}

fn read(simulation: &Simulation) -> fss_plant::LinkSample {
    Instruments::new(simulation.joint_count(), 1).link(simulation, 0)
}

#[test]
fn a_torque_sensor_reads_scale_times_torque_plus_bias() {
    let sensor = effect("torque_sensor", &[("bias_N_m", 0.05), ("scale", 0.9)]);
    let mut simulation = swinging(&[sensor], 0.0, 0.0);
    simulation.set_joint(0, JointCommand::Current { current_a: 1.0 });
    simulation.step(0.1);
    close(read(&simulation).torque_nm, 0.9 * 0.6 + 0.05, 1e-6);
}

#[test]
fn a_torque_sensor_ends_at_its_range() {
    let sensor = effect("torque_sensor", &[("bias_N_m", 3.0)]);
    let simulation = swinging(&[sensor], 0.0, 0.0);
    let sample = read(&simulation);
    assert!(sample.torque_saturated);
    close(sample.torque_nm, 2.1, 1e-12);
}

#[test]
fn an_encoder_offset_misplaces_the_joint_that_follows_it() {
    let offset = effect("encoder_offset", &[("offset_rad", 0.03)]);
    let mut simulation = swinging(&[offset], 0.0, 0.0);
    simulation.set_joint(0, JointCommand::Position { q_rad: 0.5, qd_rad_s: 0.0 });
    simulation.step(10.0);
    close(read(&simulation).q_rad, 0.5, 1e-4);
    close(simulation.truth().q_rad[0], 0.47, 1e-4);
}

#[test]
fn an_encoder_scale_stretches_angle_and_rate() {
    let scale = effect("encoder_scale", &[("scale", 1.1)]);
    let simulation = swinging(&[scale], 0.5, 0.2);
    let sample = read(&simulation);
    close(sample.q_rad, 0.55, 1e-12);
    close(sample.qd_rad_s, 0.22, 1e-12);
}

#[test]
fn an_effect_with_an_index_leaves_the_other_joints_alone() {
    let friction = effect("joint_coulomb_friction", &[("torque_N_m", 0.7)]).at(3);
    let simulation = simulate(&quiet(), &[friction]);
    let values: Vec<f64> = simulation.physics().joints.iter().map(|j| j.friction.coulomb_n_m).collect();
    assert_eq!(values, [0.1, 0.1, 0.7, 0.1]);
}

#[test]
fn an_unmodelled_joint_torque_swings_in_time() {
    let values = [("strength", 0.1), ("frequency_Hz", 0.5), ("phase_rad", 0.0)];
    let mut simulation = swinging(&[effect("unmodelled", &values).on("joint_torque_1")], 0.0, 0.0);
    simulation.step(1.0);
    // Half a period of a sine: twice the amplitude over the frequency.
    close(rate(&simulation), 2.0 * 0.1 / std::f64::consts::PI / ONE_LINK_INERTIA, 1e-9);
}

#[test]
fn an_unmodelled_joint_torque_by_rate_resists_with_its_square() {
    let mut simulation =
        swinging(&[effect("unmodelled", &[("strength", 0.3)]).on("joint_torque_1_by_rate")], 0.0, -0.8);
    simulation.step(2.0);
    // I qd' = -k |qd| qd has qd(t) = qd(0) / (1 + k |qd(0)| t / I).
    close(rate(&simulation), -0.8 / (1.0 + 0.3 * 0.8 * 2.0 / ONE_LINK_INERTIA), 1e-6);
}

#[test]
fn an_empirical_law_acts_only_between_its_bounds() {
    // It stops at 0.5 rad/s: below, nothing resists.
    let values = [("strength", 0.3), ("from", -2.0), ("to", -0.5)];
    let mut simulation = swinging(&[effect("unmodelled", &values).on("joint_torque_1_by_rate")], 0.0, -0.8);
    simulation.step(2.0);
    close(rate(&simulation), -0.5, 1e-3);
}

#[test]
fn an_elastic_link_is_two_links_with_a_sprung_joint_between() {
    let mut plant = one_link();
    let half = fss_plant::Link {
        length_m: 0.19,
        com_to_next_joint_m: 0.095,
        mass_kg: 1.44,
        inertia_kg_m2: 0.005,
        max_torque_n_m: 0.0,
        ..plant.links[0].clone()
    };
    plant.links = vec![plant.links[0].clone(), half];
    let bending = effect("joint_spring", &[("stiffness_N_m_rad", 40.0)]).at(2);
    let mut simulation = simulate(&plant, &[bending]);
    // The root gives way a little, so that it bends faster than on a fixed root, but not much.
    simulation.set_state([0.0; 3], [0.0; 3], &[0.0, 0.02], &[]);
    simulation.set_joint(0, JointCommand::Position { q_rad: 0.0, qd_rad_s: 0.0 });
    let mut crossings = 0;
    let mut before = simulation.truth().q_rad[1];
    for _ in 0..1000 {
        simulation.step(1e-3);
        let now = simulation.truth().q_rad[1];
        crossings += u32::from(before * now < 0.0);
        before = now;
    }
    let alone = (40.0 / (0.005 + 1.44 * 0.095 * 0.095_f64)).sqrt() / std::f64::consts::PI;
    let rate = f64::from(crossings);
    assert!(rate > alone * 0.95 && rate < alone * 1.6, "{rate} crossings a second, {alone} with a fixed root");
}
