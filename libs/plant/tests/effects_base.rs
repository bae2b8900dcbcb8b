//! The table, the air and the masses: each effect does what its sentence says.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{bare_base, close, effect, quiet, simulate};
use fss_plant::{JointCommand, Simulation};

const MASS_KG: f64 = 10.0;
const INERTIA_KG_M2: f64 = 0.25;

/// A base without arm that starts with this velocity.
fn coasting(effects: &[fss_plant::Effect], velocity: [f64; 3]) -> Simulation {
    let mut simulation = simulate(&bare_base(), effects);
    simulation.set_state([0.0; 3], velocity, &[], &[]);
    simulation
}

#[test]
fn a_tilted_table_accelerates_the_centre_of_mass_by_exactly_that() {
    let tilt = effect("table_tilt", &[("accel_x_m_s2", 0.002), ("accel_y_m_s2", -0.001)]);
    let mut simulation = simulate(&quiet(), &[tilt]);
    simulation.set_state([0.0; 3], [0.0; 3], &[-0.5, 1.0, -1.0, 0.5], &[]);
    // Whatever the arm does meanwhile.
    simulation.set_joint(1, JointCommand::Position { q_rad: -1.0, qd_rad_s: 0.0 });
    let start = simulation.centre_of_mass_m();
    simulation.step(5.0);
    let end = simulation.centre_of_mass_m();
    close(end[0] - start[0], 0.5 * 0.002 * 25.0, 1e-9);
    close(end[1] - start[1], -0.5 * 0.001 * 25.0, 1e-9);
}

#[test]
fn linear_drag_slows_a_base_exponentially() {
    let mut simulation = coasting(&[effect("base_linear_drag", &[("coefficient_N_s_m", 0.5)])], [0.1, 0.05, 0.3]);
    simulation.step(8.0);
    let left = (-0.5 * 8.0 / MASS_KG).exp();
    let velocity = simulation.truth().base_velocity;
    close(velocity[0], 0.1 * left, 1e-10);
    close(velocity[1], 0.05 * left, 1e-10);
    close(velocity[2], 0.3, 1e-12);
}

#[test]
fn angular_drag_slows_a_turn_exponentially() {
    let drag = effect("base_angular_drag", &[("coefficient_N_m_s_rad", 0.02)]);
    let mut simulation = coasting(&[drag], [0.1, 0.0, 0.3]);
    simulation.step(8.0);
    let velocity = simulation.truth().base_velocity;
    close(velocity[2], 0.3 * (-0.02 * 8.0 / INERTIA_KG_M2).exp(), 1e-10);
    close(velocity[0], 0.1, 1e-12);
}

#[test]
fn quadratic_drag_slows_a_base_as_one_over_time() {
    let drag = effect("base_quadratic_drag", &[("coefficient_N_s2_m2", 20.0)]);
    let mut simulation = coasting(&[drag], [0.08, 0.06, 0.0]);
    simulation.step(10.0);
    // 1/v grows by c/m a second; the speed is 0.1 m/s at first.
    let expected = 1.0 / (1.0 / 0.1 + 20.0 / MASS_KG * 10.0);
    let velocity = simulation.truth().base_velocity;
    close(velocity[0].hypot(velocity[1]), expected, 1e-9);
}

#[test]
fn rubbing_stops_a_base_in_mass_times_speed_over_force() {
    let drag = effect("base_coulomb_drag", &[("force_N", 0.02), ("torque_N_m", 0.001)]);
    let mut simulation = coasting(&[drag], [0.03, 0.04, 0.02]);
    simulation.step(12.5);
    let velocity = simulation.truth().base_velocity;
    close(velocity[0].hypot(velocity[1]), 0.05 - 0.02 * 12.5 / MASS_KG, 1e-5);
    // The turn stopped after 0.25 * 0.02 / 0.001 = 5 s.
    close(velocity[2], 0.0, 1e-6);
    simulation.step(30.0);
    let velocity = simulation.truth().base_velocity;
    close(velocity[0].hypot(velocity[1]), 0.0, 1e-6);
}

#[test]
fn a_leaning_pad_pushes_along_the_base_wherever_it_heads() {
    let pad = effect("body_force", &[("force_x_N", 0.01), ("force_y_N", 0.02), ("torque_N_m", 0.0)]);
    for heading in [0.0, 1.3, -2.5_f64] {
        let mut simulation = simulate(&bare_base(), std::slice::from_ref(&pad));
        simulation.set_state([0.0, 0.0, heading], [0.0; 3], &[], &[]);
        simulation.step(2.0);
        let velocity = simulation.truth().base_velocity;
        let (sin, cos) = heading.sin_cos();
        close(velocity[0], (0.01 * cos - 0.02 * sin) / MASS_KG * 2.0, 1e-12);
        close(velocity[1], (0.01 * sin + 0.02 * cos) / MASS_KG * 2.0, 1e-12);
    }
    let torque = effect("body_force", &[("torque_N_m", 0.001)]);
    let mut simulation = coasting(&[torque], [0.0; 3]);
    simulation.step(2.0);
    close(simulation.truth().base_velocity[2], 0.001 / INERTIA_KG_M2 * 2.0, 1e-12);
}

#[test]
fn a_twisted_hose_swings_the_base_about_its_rest() {
    let hose = effect("tether_torsion", &[("stiffness_N_m_rad", 0.04), ("rest_rad", 0.2)]);
    let mut simulation = coasting(&[hose], [0.0; 3]);
    // Half a period after a start at zero it is as far on the other side.
    let half_period = std::f64::consts::PI * (INERTIA_KG_M2 / 0.04_f64).sqrt();
    simulation.step(half_period);
    close(simulation.truth().base_pose[2], 0.4, 1e-9);
    close(simulation.truth().base_velocity[2], 0.0, 1e-9);
}

#[test]
fn a_pulling_hose_swings_the_base_about_its_anchor() {
    let values = [("stiffness_N_m", 0.1), ("anchor_x_m", 0.3), ("anchor_y_m", -0.1)];
    let mut simulation = coasting(&[effect("tether_linear", &values)], [0.0; 3]);
    simulation.step(std::f64::consts::PI * (MASS_KG / 0.1_f64).sqrt());
    let pose = simulation.truth().base_pose;
    close(pose[0], 0.6, 1e-8);
    close(pose[1], -0.2, 1e-8);
}

/// Velocity of a bare base after thrusters 3 and 4 pushed it along x for 2 s.
fn pushed(effects: &[fss_plant::Effect]) -> [f64; 3] {
    let mut simulation = coasting(effects, [0.0; 3]);
    simulation.set_valves(&[false, false, true, true]);
    simulation.step(2.0);
    simulation.truth().base_velocity
}

#[test]
fn a_heavier_base_accelerates_less() {
    close(pushed(&[])[0], 2.0 * 0.159 * 2.0 / 10.0, 1e-12);
    close(pushed(&[effect("base_mass", &[("mass_kg", 12.0)])])[0], 2.0 * 0.159 * 2.0 / 12.0, 1e-12);
}

#[test]
fn a_base_with_more_inertia_turns_less() {
    let turned = |effects: &[fss_plant::Effect]| {
        let mut simulation = coasting(effects, [0.0; 3]);
        simulation.set_valve(2, true, 0.0);
        simulation.step(1.0);
        simulation.truth().base_velocity[2]
    };
    let torque = -0.065 * 0.159;
    close(turned(&[]), torque / 0.25, 1e-12);
    close(turned(&[effect("base_inertia", &[("inertia_kg_m2", 0.3)])]), torque / 0.3, 1e-12);
}

#[test]
fn a_shifted_centre_of_mass_makes_balanced_thrust_turn_the_base() {
    let velocity = pushed(&[effect("base_com", &[("x_m", 0.0), ("y_m", 0.01)])]);
    // Force along x below the centre of mass turns it counter-clockwise; its lever stays while the turn is small.
    close(velocity[2], 0.01 * 2.0 * 0.159 * 2.0 / INERTIA_KG_M2, 2e-4);
    assert_eq!(pushed(&[])[2], 0.0);
}

/// Base angle after joint 1 has swung to 1 rad, the others held.
fn turned_back(effects: &[fss_plant::Effect]) -> f64 {
    let mut simulation = simulate(&quiet(), effects);
    for joint in 0..4 {
        let q_rad = if joint == 0 { 1.0 } else { 0.0 };
        simulation.set_joint(joint, JointCommand::Position { q_rad, qd_rad_s: 0.0 });
    }
    simulation.step(8.0);
    simulation.truth().base_pose[2]
}

#[test]
fn heavier_links_turn_the_base_further_back() {
    let nominal = turned_back(&[]);
    let heavier = turned_back(&[effect("link_mass", &[("mass_kg", 3.5)])]);
    assert!(heavier < nominal - 0.005, "{heavier} against {nominal}");
    let one = turned_back(&[effect("link_mass", &[("mass_kg", 3.5)]).at(4)]);
    assert!(one < nominal - 0.001 && one > heavier, "one link of four does less: {one}");
}

#[test]
fn a_centre_of_mass_further_out_turns_the_base_further_back() {
    let nominal = turned_back(&[]);
    // Nearer to the next joint is further out.
    let out = turned_back(&[effect("link_com", &[("b_m", 0.05)]).at(4)]);
    assert!(out < nominal - 0.001, "{out} against {nominal}");
}

#[test]
fn a_link_with_more_inertia_turns_the_base_further_back() {
    let nominal = turned_back(&[]);
    let more = turned_back(&[effect("link_inertia", &[("inertia_kg_m2", 0.3)]).at(1)]);
    assert!(more < nominal - 0.001, "{more} against {nominal}");
}

#[test]
fn a_payload_weighs_at_the_tip() {
    let simulation = simulate(&quiet(), &[effect("payload", &[("mass_kg", 2.0)])]);
    let nominal = simulate(&quiet(), &[]);
    let (with, without) = (simulation.centre_of_mass_m(), nominal.centre_of_mass_m());
    let tip = nominal.truth().ee_pose;
    let total = 10.0 + 4.0 * 2.88;
    for i in 0..2 {
        close(with[i], (without[i] * total + 2.0 * tip[i]) / (total + 2.0), 1e-12);
    }
}

#[test]
fn a_payload_is_there_from_its_onset_only() {
    let payload = effect("payload", &[("mass_kg", 2.0)]).from_onset(1.5);
    let mut simulation = simulate(&quiet(), &[payload]);
    simulation.set_state([0.0; 3], [0.1, 0.0, 0.0], &[0.0; 4], &[]);
    simulation.step(1.4);
    close(simulation.model().total_mass_kg(), 10.0 + 4.0 * 2.88, 1e-12);
    simulation.step(0.2);
    close(simulation.model().total_mass_kg(), 12.0 + 4.0 * 2.88, 1e-12);
    close(simulation.truth().base_velocity[0], 0.1, 1e-9);
}

#[test]
fn an_effect_begins_at_its_onset_to_the_instant() {
    let tilt = effect("table_tilt", &[("accel_x_m_s2", 0.01)]).from_onset(1.000_37);
    let mut simulation = coasting(&[tilt], [0.0; 3]);
    simulation.step(3.0);
    close(simulation.truth().base_velocity[0], 0.01 * (3.0 - 1.000_37), 1e-12);
}

#[test]
fn an_unmodelled_force_swings_in_time_along_its_direction() {
    let values = [("strength", 0.05), ("frequency_Hz", 0.23), ("direction_rad", 0.7), ("phase_rad", 0.0)];
    let unknown = effect("unmodelled", &values).on("base_force");
    let mut simulation = coasting(&[unknown], [0.0; 3]);
    let t = 3.0;
    simulation.step(t);
    let w = std::f64::consts::TAU * 0.23;
    let speed = 0.05 / MASS_KG / w * (1.0 - (w * t).cos());
    close(simulation.truth().base_velocity[0], speed * 0.7_f64.cos(), 1e-10);
    close(simulation.truth().base_velocity[1], speed * 0.7_f64.sin(), 1e-10);
}

#[test]
fn an_unmodelled_force_by_velocity_may_point_across_it() {
    // Across the velocity along x, and nothing for that along y: x does not change, y grows by it.
    let values = [("strength", 0.4), ("direction_rad", 0.0), ("phase_rad", std::f64::consts::FRAC_PI_2)];
    let across = effect("unmodelled", &values).on("base_force_by_velocity");
    let mut simulation = coasting(&[across], [0.1, 0.05, 0.0]);
    simulation.step(2.0);
    close(simulation.truth().base_velocity[0], 0.1, 1e-10);
    close(simulation.truth().base_velocity[1], 0.05 + 0.4 * 0.1 * 2.0 / MASS_KG, 1e-10);
}

#[test]
fn an_unmodelled_torque_by_rate_grows_with_it_up_to_its_bound() {
    let values = [("strength", 0.05), ("from", -1.0), ("to", 0.2)];
    let driving = effect("unmodelled", &values).on("base_torque_by_rate");
    let mut simulation = coasting(&[driving], [0.0, 0.0, 0.1]);
    simulation.step(1.0);
    close(simulation.truth().base_velocity[2], 0.1 * (0.05 / INERTIA_KG_M2).exp(), 1e-9);
    simulation.step(20.0);
    close(simulation.truth().base_velocity[2], 0.2, 1e-3);
}

#[test]
fn an_unmodelled_effect_elsewhere_only_describes() {
    let described = effect("unmodelled", &[("strength", 0.4)]).on("joint_2").described("knocks at 0.3 rad");
    let mut with = simulate(&quiet(), &[described]);
    let mut without = simulate(&quiet(), &[]);
    for simulation in [&mut with, &mut without] {
        simulation.set_joint(1, JointCommand::Position { q_rad: 0.5, qd_rad_s: 0.0 });
        simulation.step(2.0);
    }
    assert_eq!(with.truth(), without.truth());
}
