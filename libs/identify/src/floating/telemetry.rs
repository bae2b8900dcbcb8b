//! The joints of a run as telemetry shows them: smoothed readings on a grid.

use fss_estimation::smoothing::{self, Smoother, likeliest_jerk};
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
    let sd = [sensors.encoder_rad.max(1e-6), sensors.encoder_rate_rad_s.max(1e-5)];
    let told = told(run, joint, sd.map(|s| s * s), &command, age_s);
    let smoother = Smoother::new(&told, likeliest_jerk(&told), grid_s);
    let (deviations, variances) = (smoother.path(&told), smoother.variances());
    let reading = |(t, (d, variance)): (&f64, ([f64; 3], [f64; 3]))| {
        let c = command(*t);
        Reading { value: std::array::from_fn(|i| c[i] + d[i]), variance }
    };
    grid_s.iter().zip(deviations.into_iter().zip(variances)).map(reading).collect()
}

fn told(
    run: &Run,
    joint: usize,
    [angle_variance, rate_variance]: [f64; 2],
    command: &dyn Fn(f64) -> [f64; 3],
    age_s: &dyn Fn(f64) -> f64,
) -> Vec<smoothing::Reading> {
    let Some(joints) = &run.joints else { return Vec::new() };
    let (angle, rate) = (joints.q_rad.get(joint), joints.qd_rad_s.get(joint));
    let at = |k: usize| {
        let t_s = joints.t_s[k] - age_s(joints.t_s[k]);
        let [q, qd, _] = command(t_s);
        let angle = angle.filter(|v| v[k].is_finite()).map(|v| (v[k] - q, angle_variance));
        let rate = rate.filter(|v| v[k].is_finite()).map(|v| (v[k] - qd, rate_variance));
        smoothing::Reading { t_s, angle, rate }
    };
    (0..joints.t_s.len()).map(at).collect()
}
