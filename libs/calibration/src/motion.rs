//! Measured motion at common times: joints between slow telemetry, poses from fast motion capture.

use fss_experiments::measured::{Joints, Many, Poses, Run};
use fss_multibody::wrapped;
use nalgebra::{Matrix3, Vector3};

/// The longest gap of a joint's telemetry that is bridged, s.
const TELEMETRY_GAP_S: f64 = 0.5;
/// A report this near is taken as it is, s.
const AT_A_REPORT_S: f64 = 1e-6;
/// The longest gap of motion capture that is bridged, s: ten samples a second still count.
const GAP_S: f64 = 0.11;
/// Motion capture this long before and after a time tells the pose at that time, s. Joints that are commanded five times a
/// second ripple as often: over a whole period the pose would be that of the mean motion, and the angle that of the instant.
const HALF_WINDOW_S: f64 = 0.045;

/// Angles and rates of all joints, rad and rad/s.
pub(super) type JointMotion = (Vec<f64>, Vec<f64>);

/// The joints of a run at any time: cubics through the reports (angle and rate) of what a joint is off its command, so that
/// corners of the command stay corners.
pub(super) struct Tracks<'a> {
    tracks: Vec<Track>,
    command: Option<&'a Many>,
}

/// One joint's reports, its command taken off.
struct Track {
    t_s: Vec<f64>,
    angle: Vec<f64>,
    rate: Vec<f64>,
}

impl<'a> Tracks<'a> {
    /// Of the first `links` joints of a run; `None` where it has not as many.
    pub(super) fn of(run: &'a Run, links: usize) -> Option<Self> {
        let joints = run.joints.as_ref().filter(|joints| joints.q_rad.len() >= links)?;
        let command = run.joint_command.as_ref().filter(|command| command.values.len() >= links);
        let tracks = (0..links).map(|i| Track::of(joints, command, i)).collect::<Option<_>>()?;
        Some(Self { tracks, command })
    }

    /// Angles and rates at a time; `None` where a joint has no reports near.
    pub(super) fn at(&self, t_s: f64) -> Option<JointMotion> {
        let mut motion = (Vec::with_capacity(self.tracks.len()), Vec::with_capacity(self.tracks.len()));
        for (i, track) in self.tracks.iter().enumerate() {
            let (angle, rate) = track.at(t_s)?;
            let of_command = |value: Option<f64>| value.unwrap_or(0.0);
            motion.0.push(angle + of_command(self.command.and_then(|c| c.at(i, t_s))));
            motion.1.push(rate + of_command(self.command.and_then(|c| c.rate_at(i, t_s))));
        }
        Some(motion)
    }

    /// Number of joints.
    pub(super) fn len(&self) -> usize {
        self.tracks.len()
    }

    /// Times of the reports of the first joint, s: where the angles are measured, or nearly so.
    pub(super) fn report_times_s(&self) -> &[f64] {
        self.tracks.first().map_or(&[], |track| &track.t_s)
    }
}

impl Track {
    fn of(joints: &Joints, command: Option<&Many>, i: usize) -> Option<Self> {
        let known: Vec<usize> = (0..joints.t_s.len()).filter(|k| joints.q_rad[i][*k].is_finite()).collect();
        let t_s: Vec<f64> = known.iter().map(|k| joints.t_s[*k]).collect();
        let commanded = |t_s: f64| command.and_then(|c| c.at(i, t_s)).unwrap_or(0.0);
        let angle: Vec<f64> = known.iter().map(|k| joints.q_rad[i][*k] - commanded(joints.t_s[*k])).collect();
        let told = |n: usize| {
            let rate = joints.qd_rad_s.get(i).map(|rates| rates[known[n]]).filter(|rate| rate.is_finite())?;
            Some(rate - command.and_then(|c| c.rate_at(i, t_s[n])).unwrap_or(0.0))
        };
        let between = |n: usize| {
            let (a, b) = (n.saturating_sub(1), (n + 1).min(t_s.len() - 1));
            (angle[b] - angle[a]) / (t_s[b] - t_s[a]).max(1e-9)
        };
        let rate = (0..t_s.len()).map(|n| told(n).unwrap_or_else(|| between(n))).collect();
        (!t_s.is_empty()).then_some(Self { t_s, angle, rate })
    }

    fn at(&self, t_s: f64) -> Option<(f64, f64)> {
        let b = self.t_s.partition_point(|t| *t < t_s - AT_A_REPORT_S).min(self.t_s.len() - 1);
        if (self.t_s[b] - t_s).abs() <= AT_A_REPORT_S {
            return Some((self.angle[b], self.rate[b]));
        }
        let a = b.checked_sub(1)?;
        let h = self.t_s[b] - self.t_s[a];
        let s = (t_s - self.t_s[a]) / h;
        if h > TELEMETRY_GAP_S || s > 1.0 {
            return None;
        }
        let (p0, p1, m0, m1) = (self.angle[a], self.angle[b], self.rate[a] * h, self.rate[b] * h);
        let (c, d) = (3.0 * (p1 - p0) - 2.0 * m0 - m1, 2.0 * (p0 - p1) + m0 + m1);
        Some((p0 + s * (m0 + s * (c + s * d)), (m0 + s * (2.0 * c + s * 3.0 * d)) / h))
    }
}

/// A pose and the variance of its noise over that of one sample.
pub(super) type PoseAt = ([f64; 3], f64);

/// The pose at a time from the samples around it, by a parabola; where samples are rare, between two or from one.
pub(super) fn pose_at(poses: &Poses, t_s: f64) -> Option<PoseAt> {
    let first = poses.t_s.partition_point(|t| *t < t_s - HALF_WINDOW_S);
    let end = poses.t_s.partition_point(|t| *t <= t_s + HALF_WINDOW_S);
    let times = &poses.t_s[first..end];
    let around = times.first().is_some_and(|t| t_s - t > 0.5 * HALF_WINDOW_S)
        && times.last().is_some_and(|t| t - t_s > 0.5 * HALF_WINDOW_S);
    if times.len() < 8 || !around {
        return between(poses, t_s).map(|pose| (pose, 1.0));
    }
    // Least squares on 1, u, u^2: the value at u = 0 is a weighted sum of the samples.
    let basis = |t: &f64| {
        let u = (t - t_s) / HALF_WINDOW_S;
        Vector3::new(1.0, u, u * u)
    };
    let normal: Matrix3<f64> = times.iter().map(|t| basis(t) * basis(t).transpose()).sum();
    let solve = normal.try_inverse()?;
    let reference = poses.values[first];
    let mut pose = [0.0; 3];
    for (t, value) in times.iter().zip(&poses.values[first..end]) {
        let weight = (solve * basis(t))[0];
        for c in 0..3 {
            let step = value[c] - reference[c];
            pose[c] += weight * if c == 2 { wrapped(step) } else { step };
        }
    }
    Some(([0, 1, 2].map(|c| reference[c] + pose[c]), solve[(0, 0)]))
}

/// Linear between samples; none where there is no sample near.
pub(super) fn between(poses: &Poses, t_s: f64) -> Option<[f64; 3]> {
    let after = poses.t_s.partition_point(|t| *t < t_s - 1e-6);
    let (t1, p1) = (*poses.t_s.get(after)?, poses.values[after]);
    if (t1 - t_s).abs() <= 1e-6 {
        return Some(p1);
    }
    let before = after.checked_sub(1)?;
    let (t0, p0) = (poses.t_s[before], poses.values[before]);
    if t1 - t0 > GAP_S {
        return None;
    }
    let share = (t_s - t0) / (t1 - t0);
    Some([0, 1, 2].map(|c| {
        let step = p1[c] - p0[c];
        p0[c] + share * if c == 2 { wrapped(step) } else { step }
    }))
}

/// A pose seen from another.
pub(super) fn seen_from(base: [f64; 3], pose: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = base[2].sin_cos();
    let (dx, dy) = (pose[0] - base[0], pose[1] - base[1]);
    [cos * dx + sin * dy, cos * dy - sin * dx, wrapped(pose[2] - base[2])]
}
