//! The joints of a run as telemetry shows them: smoothed readings on a grid.

use crate::smoother::{Measurement, Noise, Smoothed, smooth};
use fss_experiments::measured::Run;
use fss_plant::Sensors;

/// Reading of one encoder on a grid, with its first two derivatives and what is not known of them.
#[derive(Clone, Debug)]
pub(crate) struct Reading {
    /// What the encoder would show: the command and the smoothed deviation from it (rad, rad/s, rad/s2).
    pub(crate) value: [f64; 3],
    /// Variances of the three.
    pub(crate) variance: [f64; 3],
}

/// The smoothed reading of joint `joint` at `grid_s`, its telemetry being `age_s` older than its stamps say.
pub(crate) fn readings(
    run: &Run,
    joint: usize,
    sensors: &Sensors,
    age_s: &dyn Fn(f64) -> f64,
    grid_s: &[f64],
) -> Vec<Reading> {
    // Beyond its first and last row a command goes on as it was: the arm does not stop where the record does.
    let command = |t: f64| {
        let commands = run.joint_command.as_ref()?;
        let within = t.clamp(*commands.t_s.first()?, *commands.t_s.last()?);
        let [q, qd, qdd] =
            [commands.at(joint, within)?, commands.rate_at(joint, within)?, commands.acceleration_at(joint, within)?];
        Some([q + (t - within) * qd, qd, if t == within { qdd } else { 0.0 }])
    };
    let command = |t: f64| command(t).unwrap_or([0.0; 3]);
    let noise = Noise { angle: sensors.encoder_rad.max(1e-6), rate: sensors.encoder_rate_rad_s.max(1e-5) };
    let measurements = measurements(run, joint, &command, age_s);
    let deviations = smooth(&measurements, noise, grid_s);
    let reading = |(t, d): (&f64, Smoothed)| {
        let [q, qd, qdd] = command(*t);
        Reading {
            value: [q + d.angle, qd + d.rate, qdd + d.acceleration],
            variance: [d.angle_variance, d.rate_variance, d.acceleration_variance],
        }
    };
    grid_s.iter().zip(deviations).map(reading).collect()
}

fn measurements(
    run: &Run,
    joint: usize,
    command: &dyn Fn(f64) -> [f64; 3],
    age_s: &dyn Fn(f64) -> f64,
) -> Vec<Measurement> {
    let Some(joints) = &run.joints else { return Vec::new() };
    let (angle, rate) = (joints.q_rad.get(joint), joints.qd_rad_s.get(joint));
    let at = |k: usize| {
        let t_s = joints.t_s[k] - age_s(joints.t_s[k]);
        let [q, qd, _] = command(t_s);
        Measurement { t_s, angle: angle.map(|v| v[k] - q), rate: rate.map(|v| v[k] - qd) }
    };
    (0..joints.t_s.len()).map(at).collect()
}
