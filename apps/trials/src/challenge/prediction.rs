//! What the sensors of a laboratory show along a path, without noise.
//!
//! The encoders show what they show on the path; what the laboratory has beyond the plant file decides where the links are
//! then, how the base answers, and what torques and currents that takes. The base starts every window from where it is on
//! the path, so that two laboratories differ by what acts within a window.

use super::path::{Path, STEP_S, coordinates, derivative, drive_torques, table_axes};
use fss_multibody::JointVector;
use fss_plant::{BaseSample, Grid, JointPhysics, JointSample, Physics, Plant, Rollout, Stream};
use miette::{IntoDiagnostic, Result};

/// Steps of a window: 5 s.
pub(super) const WINDOW_STEPS: usize = 100;
/// Steps between two reports of a link.
const TELEMETRY_STEPS: usize = 4;
/// A joint that is slower than this may rest, and then friction holds it with any torque, rad/s.
const AT_REST_RAD_S: f64 = 0.03;
/// Torque at which a joint with play leans to one side, N m.
const LEANS_N_M: f64 = 0.02;
/// Channels of the base: motion capture x, y, heading; gyro.
pub(super) const BASE_CHANNELS: usize = 4;
/// Channels of the end-effector: motion capture x, y, heading.
pub(super) const END_EFFECTOR_CHANNELS: usize = 3;

/// What the sensors show in one experiment.
pub(super) struct Shown {
    /// Base, and end-effector where there is an arm: channel by channel, a sample each step.
    pub motion: Vec<Vec<f64>>,
    /// Torque sensors, then currents: link by link, a sample each report, 0 while the joint may rest.
    pub drives: Vec<Vec<f64>>,
}

/// What `laboratory` shows along a path of its plant file.
///
/// # Errors
/// Where the laboratory is no mechanism.
pub(super) fn shown(laboratory: &Plant, path: &Path) -> Result<Shown> {
    let rollout = Rollout::new(laboratory).into_diagnostic()?;
    let joints = link_motion(&rollout, path);
    let (steps, links) = (path.steps(), laboratory.link_count());
    let whole = Grid { start_s: 0.0, step_s: STEP_S, steps };
    let thrust = rollout.thrust(&path.valves, &whole, &joints);
    let has_arm = links > 0;
    let channels = BASE_CHANNELS + if has_arm { END_EFFECTOR_CHANNELS } else { 0 };
    let mut shown = Shown { motion: vec![Vec::new(); channels], drives: vec![Vec::new(); 2 * links] };
    let mut base = vec![path.base[0]; WINDOW_STEPS + 1];
    for from in (0..steps).step_by(WINDOW_STEPS) {
        let grid = Grid { start_s: from as f64 * STEP_S, step_s: STEP_S, steps: WINDOW_STEPS.min(steps - from) };
        let base = &mut base[..=grid.steps];
        rollout.run(&path.base[from], &grid, &joints[2 * from..], &thrust[from..], base);
        shown.take_motion(&rollout, base, &joints[2 * from..], has_arm);
        for k in (0..grid.steps).filter(|k| (from + k) % TELEMETRY_STEPS == 0) {
            let push = thrust.get(from + k).copied().unwrap_or_default();
            shown.take_drives(&rollout, &base[k], path, &joints, from + k, push);
        }
    }
    Ok(shown)
}

/// Where the base of `laboratory` goes from the start of a path to its end.
///
/// # Errors
/// Where the laboratory is no mechanism.
pub(super) fn flown(laboratory: &Plant, path: &Path) -> Result<Vec<BaseSample>> {
    let rollout = Rollout::new(laboratory).into_diagnostic()?;
    let joints = link_motion(&rollout, path);
    let grid = Grid { start_s: 0.0, step_s: STEP_S, steps: path.steps() };
    let thrust = rollout.thrust(&path.valves, &grid, &joints);
    let mut base = vec![path.base[0]; grid.steps + 1];
    rollout.run(&path.base[0], &grid, &joints, &thrust, &mut base);
    Ok(base)
}

/// The value of a series of `len` steps and one at step `k`, as old as given; linear, also beyond the ends.
fn delayed(series: impl Fn(usize) -> f64, len: usize, k: usize, age_in_steps: f64) -> f64 {
    if age_in_steps == 0.0 || len == 0 {
        return series(k);
    }
    let at = k as f64 - age_in_steps;
    let first = at.floor().clamp(0.0, len as f64 - 1.0) as usize;
    let (a, b) = (series(first), series(first + 1));
    a + (b - a) * (at - first as f64)
}

/// Motion of the links where the encoders show the path, at half steps.
fn link_motion(rollout: &Rollout, path: &Path) -> Vec<JointSample> {
    let links = rollout.physics(0.0).joints.len();
    let last = path.q_rad.len() - 1;
    let mut q_rad = path.q_rad.clone();
    for (half, own) in q_rad.iter_mut().enumerate() {
        let physics = rollout.physics(half as f64 * STEP_S / 2.0);
        for i in 0..links {
            let age = -physics.sensors.link_age_s(i) / (STEP_S / 2.0);
            let encoder_rad = delayed(|at| path.q_rad[at][i], last, half, age);
            own[i] = link_angle(physics, i, encoder_rad, path.torque_n_m[half][i]);
        }
    }
    let rates = derivative(&q_rad);
    q_rad.into_iter().zip(rates).map(|(q_rad, qd_rad_s)| JointSample { q_rad, qd_rad_s }).collect()
}

/// Angle of a link whose encoder reads `encoder_rad` while its drive passes on `torque_n_m`.
fn link_angle(physics: &Physics, i: usize, encoder_rad: f64, torque_n_m: f64) -> f64 {
    let joint = &physics.joints[i];
    let motor_rad = (encoder_rad - joint.encoder_offset_rad) / joint.encoder_scale;
    let mut angle_rad = motor_rad + joint.kinematic_error_rad * (joint.kinematic_cycles * motor_rad).sin();
    if joint.is_elastic() {
        let stiffness = joint.stiffness_n_m_rad.unwrap_or(physics.servos[i].gear_stiffness_n_m_rad);
        angle_rad -= torque_n_m / stiffness + 0.5 * joint.backlash_rad * (torque_n_m / LEANS_N_M).tanh();
    }
    angle_rad
}

impl Shown {
    /// Samples of a window's poses and rates; `base` has one sample more than the window has steps.
    fn take_motion(&mut self, rollout: &Rollout, base: &[BaseSample], joints: &[JointSample], has_arm: bool) {
        let steps = base.len() - 1;
        let end_effector: Vec<[f64; 3]> = (base.iter().enumerate().filter(|_| has_arm))
            .map(|(k, at)| rollout.model(at.t_s).end_effector(&coordinates(at.pose, &joints[2 * k].q_rad)).into())
            .collect();
        for (k, at) in base[..steps].iter().enumerate() {
            let sensors = &rollout.physics(at.t_s).sensors;
            let age = |stream| sensors.age_s(stream) / STEP_S;
            let seen = |i: usize| delayed(|k| base[k].pose[i], steps, k, age(Stream::BasePose));
            let pose = sensors.base_reading([seen(0), seen(1), seen(2)]);
            let rate = sensors.gyro_reading(delayed(|k| base[k].velocity[2], steps, k, age(Stream::Gyro)));
            let mut values = pose.to_vec();
            values.push(rate);
            if has_arm {
                let seen = |i: usize| delayed(|k| end_effector[k][i], steps, k, age(Stream::EePose));
                values.extend(sensors.pose_reading([seen(0), seen(1), seen(2)]));
            }
            self.motion.iter_mut().zip(values).for_each(|(channel, value)| channel.push(value));
        }
    }

    /// Torques and currents at step `k` of the experiment.
    fn take_drives(
        &mut self,
        rollout: &Rollout,
        base: &BaseSample,
        path: &Path,
        joints: &[JointSample],
        k: usize,
        thrust: [f64; 3],
    ) {
        let links = self.drives.len() / 2;
        if links == 0 {
            return;
        }
        let (physics, own) = (rollout.physics(base.t_s), &joints[2 * k]);
        let mut push = table_axes(base, thrust);
        let motion = fss_plant::BaseMotion { t_s: base.t_s, pose: base.pose, velocity: base.velocity };
        push += nalgebra::Vector3::from(physics.base_wrench(&motion));
        let mut torques = drive_torques(rollout.model(base.t_s), base, own, &path.qdd_rad_s2[2 * k], &push);
        for law in &physics.joint_laws {
            let (q, qd) = (own.q_rad[law.joint], own.qd_rad_s[law.joint]);
            torques[law.joint] -= (law.law)(&law.values, base.t_s, q, qd);
        }
        for (i, joint) in physics.joints.iter().enumerate() {
            let rate_rad_s = path.qd_rad_s[2 * k][i];
            let moves = rate_rad_s.abs() > AT_REST_RAD_S;
            let reading = |value: f64| if moves { value } else { 0.0 };
            self.drives[i].push(reading(joint.torque_reading(torques[i])));
            self.drives[links + i].push(reading(current_a(joint, &own.q_rad, i, rate_rad_s, torques[i])));
        }
    }
}

/// Current that a drive takes to pass on a torque while its motor turns.
fn current_a(joint: &JointPhysics, q_rad: &JointVector, i: usize, rate_rad_s: f64, torque_n_m: f64) -> f64 {
    let rubs_n_m = joint.friction.sliding_n_m(rate_rad_s.signum(), rate_rad_s);
    let motor_n_m = torque_n_m / joint.gear_ratio(q_rad[i]) + rubs_n_m;
    motor_n_m / (joint.torque_constant_n_m_a * joint.torque_scale).abs().max(1e-6)
}
