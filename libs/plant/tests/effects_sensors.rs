//! Sensors and time: each effect does what its sentence says.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{bare_base, close, effect, quiet, simulate};
use fss_plant::{Effect, Instruments, JointCommand, Plant, Simulation};

/// A base that drifts and turns for `t_s`.
fn drifting(effects: &[Effect], t_s: f64) -> Simulation {
    let mut simulation = simulate(&bare_base(), effects);
    simulation.set_state([0.5, -0.3, 0.2], [0.1, 0.05, 0.3], &[], &[]);
    simulation.step(t_s);
    simulation
}

fn base_pose(simulation: &Simulation) -> [f64; 3] {
    Instruments::new(0, 1).mocap_base(simulation).unwrap()
}

#[test]
fn late_motion_capture_shows_where_the_base_was() {
    let late = effect("mocap_latency", &[("delay_s", 0.05)]);
    let pose = base_pose(&drifting(&[late], 2.0));
    close(pose[0], 0.5 + 0.1 * 1.95, 1e-12);
    close(pose[1], -0.3 + 0.05 * 1.95, 1e-12);
    close(pose[2], 0.2 + 0.3 * 1.95, 1e-12);
}

#[test]
fn a_known_latency_is_taken_off() {
    let mut plant = bare_base();
    plant.sensors.mocap_latency_s = 0.02;
    let late = effect("mocap_latency", &[("delay_s", 0.05)]);
    let mut simulation = simulate(&plant, &[late]);
    simulation.set_state([0.0; 3], [0.1, 0.0, 0.0], &[], &[]);
    simulation.step(1.0);
    close(base_pose(&simulation)[0], 0.1 * 0.97, 1e-12);
}

#[test]
fn a_turned_camera_frame_turns_all_poses_about_the_tables_origin() {
    let turned = effect("mocap_rotation", &[("angle_rad", 0.1)]);
    let simulation = drifting(&[turned], 1.0);
    let [x, y, theta] = simulation.truth().base_pose;
    let pose = base_pose(&simulation);
    let (sin, cos) = 0.1_f64.sin_cos();
    close(pose[0], cos * x - sin * y, 1e-12);
    close(pose[1], sin * x + cos * y, 1e-12);
    close(pose[2], theta + 0.1, 1e-12);
    let ee = Instruments::new(0, 1).mocap_end_effector(&simulation).unwrap();
    close(ee[2], theta + 0.1, 1e-12);
}

#[test]
fn the_tracked_point_sits_where_the_marker_offset_says_in_the_base() {
    let offset = effect("marker_offset", &[("x_m", 0.01), ("y_m", -0.02)]);
    let simulation = drifting(&[offset], 1.0);
    let [x, y, theta] = simulation.truth().base_pose;
    let pose = base_pose(&simulation);
    let (sin, cos) = theta.sin_cos();
    close(pose[0], x + 0.01 * cos + 0.02 * sin, 1e-12);
    close(pose[1], y + 0.01 * sin - 0.02 * cos, 1e-12);
    close(pose[2], theta, 1e-12);
}

#[test]
fn turned_markers_read_a_turned_heading_at_the_same_place() {
    let simulation = drifting(&[effect("marker_yaw", &[("angle_rad", 0.04)])], 1.0);
    let [x, y, theta] = simulation.truth().base_pose;
    assert_eq!(base_pose(&simulation), [x, y, theta + 0.04]);
}

#[test]
fn a_gyro_reads_scale_times_rate_plus_bias() {
    let effects = [effect("gyro_bias", &[("bias_rad_s", 0.002)]), effect("gyro_scale", &[("scale", 1.03)])];
    let simulation = drifting(&effects, 1.0);
    close(Instruments::new(0, 1).gyro(&simulation), 1.03 * 0.3 + 0.002, 1e-12);
}

/// The quiet laboratory with joint 2 moving at a steady 0.2 rad/s.
fn moving(effects: &[Effect]) -> Simulation {
    let mut plant = quiet();
    for link in &mut plant.links {
        link.coulomb_friction_n_m = 0.0;
        link.viscous_friction_n_m_s_rad = 0.0;
    }
    let mut simulation = simulate(&plant, effects);
    simulation.set_joint(1, JointCommand::Velocity { qd_rad_s: 0.2 });
    simulation.step(2.0);
    simulation
}

#[test]
fn late_link_telemetry_shows_where_the_joint_was() {
    let simulation = moving(&[effect("link_latency", &[("delay_s", 0.15)]).at(2)]);
    let mut instruments = Instruments::new(4, 1);
    let was = simulation.truth_at(simulation.t_s() - 0.15);
    close(instruments.link(&simulation, 1).q_rad, was.q_rad[1], 1e-9);
    assert!((was.q_rad[1] - simulation.truth().q_rad[1]).abs() > 0.02);
    close(instruments.link(&simulation, 0).q_rad, simulation.truth().q_rad[0], 1e-12);
}

#[test]
fn a_clock_that_is_ahead_stamps_what_was_earlier() {
    let offset = effect("clock_offset", &[("offset_s", 0.08)]).on("gyro");
    let mut simulation = simulate(&bare_base(), &[offset]);
    simulation.set_valve(2, true, 0.0);
    simulation.step(1.0);
    let was = simulation.truth_at(0.92).base_velocity[2];
    close(Instruments::new(0, 1).gyro(&simulation), was, 1e-12);
    assert!((was - simulation.truth().base_velocity[2]).abs() > 1e-3);
    // Motion capture has its own clock.
    assert_eq!(base_pose(&simulation), simulation.truth().base_pose);
}

/// Mean and standard deviation.
fn spread(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    (mean, variance.sqrt())
}

#[test]
fn every_sensor_is_as_noisy_as_the_plant_says() {
    let seed = 11;
    println!("seed {seed}");
    let mut plant = Plant::default_laboratory().unwrap();
    plant.sensors.gyro_bias_walk_rad_s_sqrt_s = 0.0;
    let simulation = simulate(&plant, &[]);
    let truth = simulation.truth();
    let mut instruments = Instruments::new(4, seed);
    let count = 4000;
    let mut columns = vec![Vec::new(); 7];
    for _ in 0..count {
        let pose = instruments.mocap_base(&simulation).unwrap();
        let link = instruments.link(&simulation, 2);
        let row = [
            pose[0] - truth.base_pose[0],
            pose[2] - truth.base_pose[2],
            instruments.gyro(&simulation),
            link.q_rad,
            link.qd_rad_s,
            link.current_a,
            link.torque_nm,
        ];
        for (column, value) in columns.iter_mut().zip(row) {
            column.push(value);
        }
    }
    let s = &plant.sensors;
    let stated = [
        s.mocap_position_m,
        s.mocap_angle_rad,
        s.gyro_rad_s,
        s.encoder_rad,
        s.encoder_rate_rad_s,
        s.current_a,
        s.torque_n_m,
    ];
    for (i, (column, stated)) in columns.iter().zip(stated).enumerate() {
        let (mean, std) = spread(column);
        let bias = if i == 2 { s.gyro_bias_rad_s } else { 0.0 };
        close(std, stated, 0.06 * stated);
        close(mean, bias, 5.0 * stated / f64::from(count).sqrt());
    }
}

#[test]
fn a_dropout_is_a_missing_pose_as_often_as_stated() {
    let mut plant = bare_base();
    plant.sensors.mocap_dropout = 0.2;
    let simulation = simulate(&plant, &[]);
    let mut instruments = Instruments::new(0, 5);
    let lost = (0..5000).filter(|_| instruments.mocap_base(&simulation).is_none()).count();
    assert!((900..1100).contains(&lost), "{lost} of 5000");
}

#[test]
fn a_gyros_bias_walks_with_the_root_of_time() {
    let mut plant = bare_base();
    plant.sensors.gyro_bias_walk_rad_s_sqrt_s = 1e-3;
    let mut ends = Vec::new();
    for seed in 0..200 {
        let mut simulation = simulate(&plant, &[]);
        let mut instruments = Instruments::new(0, seed);
        let mut last = 0.0;
        for _ in 0..10 {
            last = instruments.gyro(&simulation);
            simulation.step(0.5);
        }
        ends.push(last);
    }
    let (_, std) = spread(&ends);
    close(std, 1e-3 * 4.5_f64.sqrt(), 0.15 * 1e-3 * 4.5_f64.sqrt());
}

#[test]
fn an_encoder_reads_whole_counts() {
    let mut plant = quiet();
    plant.sensors.encoder_step_rad = 0.01;
    let mut simulation = simulate(&plant, &[]);
    simulation.set_state([0.0; 3], [0.0; 3], &[0.1234], &[]);
    close(Instruments::new(4, 1).link(&simulation, 0).q_rad, 0.12, 1e-12);
}

#[test]
fn room_air_has_the_stated_spread_and_memory() {
    let mut plant = bare_base();
    plant.disturbance = Plant::default_laboratory().unwrap().disturbance;
    plant.base.mass_kg = 1.0;
    let air = plant.disturbance.clone().unwrap();
    let mut forces = Vec::new();
    let mut simulation = Simulation::new(&plant, 3).unwrap();
    let mut before = 0.0;
    for _ in 0..4000 {
        simulation.step(0.1);
        let now = simulation.truth().base_velocity[0];
        forces.push((now - before) / 0.1);
        before = now;
    }
    let (_, std) = spread(&forces);
    close(std, air.force_std_n, 0.15 * air.force_std_n);
    let product: f64 = forces.iter().zip(&forces[20..]).map(|(a, b)| a * b).sum();
    let power: f64 = forces.iter().map(|f| f * f).sum();
    // After one correlation time the memory has faded to 1/e.
    close(product / power, (-1.0_f64).exp(), 0.15);
}
