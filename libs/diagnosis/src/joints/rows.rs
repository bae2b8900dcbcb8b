//! Which numbers a run measured of its joints, in order of time.

use super::path::MeasuredPath;
use super::telemetry::{groups, interval_s, is_driven, mean, unwrapped};
use crate::servo_response::datagrams;
use fss_experiments::measured::{Drive, Poses, Run};
use fss_plant::Plant;
use std::ops::Range;

/// What a row measured. Joints count from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Encoder angle, rad.
    Angle(usize),
    /// Encoder rate, rad/s.
    Rate(usize),
    /// Motor current, A.
    Current(usize),
    /// Torque sensor, N m.
    Torque(usize),
    /// Motor torque that is known to be 0, N m: nothing drives the joint.
    Undriven(usize),
    /// End-effector in the measured base's frame: x m, y m, angle rad.
    Tip(usize),
}

/// One row.
#[derive(Clone, Debug)]
pub(super) struct Row {
    pub(super) kind: Kind,
    /// Mean stamp of the samples, s.
    pub(super) t_s: f64,
    /// Mean of the samples.
    pub(super) value: f64,
    /// Standard deviation of the mean's noise.
    pub(super) noise: f64,
    /// Stamps of the samples.
    pub(super) stamps_s: Vec<f64>,
}

/// What a row depends on, linearized about the path.
#[derive(Clone, Debug, Default)]
pub(super) struct Slopes {
    /// By the states of the motion: index 3 joint + (angle, rate, acceleration).
    pub(super) motion: Vec<(usize, f64)>,
    /// Of a rate's row: by the time by which rates lag, in standard deviations.
    pub(super) rate_lag: f64,
    /// Of a row of a swinging arm: by encoders' errors once a turn, index 2 joint + (sine, cosine).
    pub(super) eccentricity: Vec<(usize, f64)>,
    /// Of a current's row where torques move the arm: by the inertia of the drive's rotor, in standard deviations.
    pub(super) rotor: f64,
    /// By the torque in the row's joint: N m of the torque scale in units of the row.
    pub(super) torque: f64,
    /// Variance that a dry friction of 1 N m, of an unknown direction, gives the row.
    pub(super) unit_friction_variance: f64,
    /// By how much less than a row of its own the row says of the friction of a joint at rest.
    pub(super) repeats_rest: f64,
    /// And thrust of which it is not known whether it had begun, or a datagram whether it had arrived.
    pub(super) timing_variance: f64,
    /// Of an end-effector's row: shares of x, y and angle in it that make its noise independent of the rows before it, and
    /// the standard deviation of what is left.
    pub(super) mix: Option<([f64; 3], f64)>,
}

/// Longest time over which telemetry of arms in servo drives is averaged, s: commands come no faster, and drives are slower.
const SERVO_BIN_S: f64 = 0.04;
/// The same of arms that swing as their torques have them, s: a hundredth of a turn of a fast pendulum.
const SWING_BIN_S: f64 = 0.01;
/// The same of end-effector poses where telemetry is slow, s.
const LONGEST_TIP_BIN_S: f64 = 0.1;
/// All rows of a run, in order of time.
pub(super) fn rows(plant: &Plant, run: &Run, path: &MeasuredPath) -> Vec<Row> {
    let Some(joints) = &run.joints else { return Vec::new() };
    let width = match datagrams(plant, run) {
        // Servos answer each datagram within some hundredths of a second.
        Some(_) => 0.0,
        None if is_driven(run) => SWING_BIN_S,
        None => SERVO_BIN_S,
    };
    let bins = groups(&joints.t_s, width);
    let sensors = &plant.sensors;
    let mut out = Vec::new();
    let mut times = Vec::new();
    let angles: Vec<Vec<f64>> = joints.q_rad.iter().map(|q| unwrapped(q)).collect();
    for rows in &bins {
        let t_s = joints.t_s[rows.clone()].iter().sum::<f64>() / rows.len() as f64;
        times.push(t_s);
        if run.drive == Drive::Free {
            let stamps_s: Vec<f64> = joints.t_s[rows.clone()].to_vec();
            let still = |i| Row { kind: Kind::Undriven(i), t_s, value: 0.0, noise: 0.0, stamps_s: stamps_s.clone() };
            out.extend((0..plant.link_count()).map(still));
        }
        let mut add = |kind: Kind, values: Option<&Vec<f64>>, noise: f64| {
            let Some((value, count)) = values.and_then(|v| mean(v, rows)) else { return };
            let known = |k: &usize| values.is_some_and(|v| v.get(*k).is_some_and(|v| v.is_finite()));
            let stamps_s = rows.clone().filter(known).map(|k| joints.t_s[k]).collect();
            out.push(Row { kind, t_s, value, noise: noise / count.sqrt(), stamps_s });
        };
        // Torques first: where they tell the motion, what is left shows in the encoders.
        for i in 0..plant.link_count() {
            if run.drive != Drive::Free {
                add(Kind::Current(i), joints.current_a.get(i), sensors.current_a);
            }
            add(Kind::Torque(i), joints.torque_nm.get(i), sensors.torque_n_m);
        }
        for i in 0..plant.link_count() {
            add(Kind::Angle(i), angles.get(i), sensors.encoder_rad);
            add(Kind::Rate(i), joints.qd_rad_s.get(i), sensors.encoder_rate_rad_s);
        }
    }
    out.extend(tip_rows(plant, run, path, &times));
    out.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    out
}

/// The end-effector relative to the measured base.
fn tip_rows(plant: &Plant, run: &Run, path: &MeasuredPath, telemetry_s: &[f64]) -> Vec<Row> {
    let Some(tip) = run.ee_pose.as_ref().filter(|p| p.t_s.len() > 1) else { return Vec::new() };
    let (Some(from_s), Some(to_s)) = (telemetry_s.first(), telemetry_s.last()) else { return Vec::new() };
    if !plant.base.clamped && path.base.is_none() {
        return Vec::new();
    }
    let base = run.base_pose.as_ref().filter(|_| !plant.base.clamped);
    let width = interval_s(telemetry_s).clamp(SERVO_BIN_S, LONGEST_TIP_BIN_S);
    let headings = unwrapped(&tip.values.iter().map(|pose| pose[2]).collect::<Vec<_>>());
    let base = base.map(|base| {
        let headings = unwrapped(&base.values.iter().map(|pose| pose[2]).collect::<Vec<_>>());
        let values = base.values.iter().zip(headings).map(|(pose, heading)| [pose[0], pose[1], heading]).collect();
        Poses { t_s: base.t_s.clone(), values }
    });
    let mut out = Vec::new();
    for rows in groups(&tip.t_s, width) {
        let known = |k: &usize| {
            let stamp_s = tip.t_s[*k];
            let frame = base.as_ref().map_or(Some([0.0; 3]), |base| interpolated(base, stamp_s))?;
            let [x, y, _] = tip.values[*k];
            let pose = super::mechanics::relative([x, y, headings[*k]], frame);
            (pose.iter().all(|v| v.is_finite()) && (*from_s..=*to_s).contains(&stamp_s)).then_some((stamp_s, pose))
        };
        let samples: Vec<(f64, [f64; 3])> = rows.clone().filter_map(|k| known(&k)).collect();
        if samples.is_empty() {
            continue;
        }
        let count = samples.len() as f64;
        let middle_s = samples.iter().map(|s| s.0).sum::<f64>() / count;
        let stamps_s: Vec<f64> = samples.iter().map(|s| s.0).collect();
        for axis in 0..3 {
            let value = samples.iter().map(|s| s.1[axis]).sum::<f64>() / count;
            let sd = if axis < 2 { plant.sensors.mocap_position_m } else { plant.sensors.mocap_angle_rad };
            let bodies: f64 = if base.is_some() { 2.0 } else { 1.0 };
            let t_s = nearest(telemetry_s, middle_s).filter(|t| (t - middle_s).abs() <= 0.5 * SERVO_BIN_S);
            let noise = sd * (bodies / count).sqrt();
            out.push(Row {
                kind: Kind::Tip(axis),
                t_s: t_s.unwrap_or(middle_s),
                value,
                noise,
                stamps_s: stamps_s.clone(),
            });
        }
    }
    out
}

fn nearest(t_s: &[f64], to_s: f64) -> Option<f64> {
    let after = t_s.partition_point(|t| *t < to_s);
    let near = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|k| t_s.get(k).copied());
    near.min_by(|a, b| (a - to_s).abs().total_cmp(&(b - to_s).abs()))
}

/// A pose between its two neighbours; `None` outside or in a pause of more than a tenth of a second.
fn interpolated(poses: &Poses, t_s: f64) -> Option<[f64; 3]> {
    let after = poses.t_s.partition_point(|t| *t < t_s);
    let (t1, b) = (*poses.t_s.get(after)?, poses.values.get(after)?);
    if t1 == t_s {
        return Some(*b);
    }
    let (t0, a) = (*poses.t_s.get(after.checked_sub(1)?)?, poses.values.get(after - 1)?);
    let share = (t_s - t0) / (t1 - t0);
    (t1 - t0 < LONGEST_TIP_BIN_S).then(|| std::array::from_fn(|i| a[i] + share * (b[i] - a[i])))
}

impl Kind {
    /// Name of the channel.
    pub(super) fn channel(self) -> String {
        match self {
            Self::Angle(i) => format!("joint_{}_angle", i + 1),
            Self::Rate(i) => format!("joint_{}_rate", i + 1),
            Self::Current(i) => format!("joint_{}_current", i + 1),
            Self::Torque(i) => format!("joint_{}_torque", i + 1),
            Self::Undriven(i) => format!("joint_{}_no_drive", i + 1),
            Self::Tip(axis) => ["ee_x", "ee_y", "ee_theta"][axis.min(2)].to_owned(),
        }
    }
}

/// Ranges of rows of one time.
pub(super) fn moments(rows: &[Row]) -> Vec<Range<usize>> {
    let mut out: Vec<Range<usize>> = Vec::new();
    for (k, row) in rows.iter().enumerate() {
        match out.last_mut() {
            Some(last) if rows[last.start].t_s == row.t_s => last.end = k + 1,
            _ => out.push(k..k + 1),
        }
    }
    out
}
