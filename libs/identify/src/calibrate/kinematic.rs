//! Kinematic calibration: link lengths, joint offsets and the first joint's pose (the paper's equations 1 to 5).

use super::{CalibrationError, Estimate, Row, Unknown, solve};
use crate::measured::{Joints, Poses, Run};
use fss_multibody::{Coordinates, Model, Parameter};
use fss_plant::Plant;
use std::f64::consts::{PI, TAU};

/// The end-effector seen from the base, and the joint angles at that time.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Encoder angles, rad.
    pub q_rad: Vec<f64>,
    /// Their rates, rad/s; zero in a still pose.
    pub qd_rad_s: Vec<f64>,
    /// Pose `[x, y, angle]` of the end-effector in the base frame, m and rad.
    pub tip: [f64; 3],
}

impl Observation {
    fn is_still(&self) -> bool {
        self.qd_rad_s.iter().all(|rate| *rate == 0.0)
    }
}

/// What is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// A length of its own for each link; otherwise all but the last share one.
    pub each_length: bool,
}

/// Known no better than this, a length or an angle is not determined.
const PLAUSIBLE_M: f64 = 0.1;
const PLAUSIBLE_RAD: f64 = 0.5;
const PLAUSIBLE_DELAY_S: f64 = 0.5;
/// Joints slower than this stand still, rad/s.
const STILL_RAD_S: f64 = 0.01;
/// Poses that differ by less are one, rad.
const SAME_POSE_RAD: f64 = 0.01;
/// The longest gap of motion capture that is bridged, s.
const GAP_S: f64 = 0.05;
/// The longest gap of a joint's telemetry that is bridged, s.
const TELEMETRY_GAP_S: f64 = 0.5;

/// The unknowns, each with the places in the model that it stands for.
fn unknowns(model: &Model, choice: Choice) -> Vec<(Unknown, Vec<Parameter>)> {
    let n = model.link_count();
    let mut all = Vec::new();
    let mut add = |name: String, plausible: f64, places: Vec<Parameter>| {
        let value = places.first().and_then(|p| model.parameter(*p)).unwrap_or_default();
        all.push((Unknown { name, value, plausible }, places));
    };
    if choice.each_length || n < 3 {
        for i in 1..=n {
            add(format!("link[{i}].length_m"), PLAUSIBLE_M, vec![Parameter::LinkLength(i)]);
        }
    } else {
        let common = (1..n).map(Parameter::LinkLength).collect();
        add(format!("link[1..{}].length_m", n - 1), PLAUSIBLE_M, common);
        add(format!("link[{n}].length_m"), PLAUSIBLE_M, vec![Parameter::LinkLength(n)]);
    }
    add("base.joint1_x_m".into(), PLAUSIBLE_M, vec![Parameter::Joint1X]);
    add("base.joint1_y_m".into(), PLAUSIBLE_M, vec![Parameter::Joint1Y]);
    add("base.joint1_angle_rad".into(), PLAUSIBLE_RAD, vec![Parameter::Joint1Angle]);
    for i in 2..=n {
        add(format!("link[{i}].joint_offset_rad"), PLAUSIBLE_RAD, vec![Parameter::JointOffset(i)]);
    }
    all
}

/// Estimates the kinematic parameters. Moving observations bring one more unknown: how late telemetry is stamped.
///
/// `noise` is `[position m, angle rad]` of one observation before the residuals tell.
///
/// # Errors
/// [`CalibrationError`], without observations or where the iteration fails.
pub fn calibrate(
    model: &Model,
    observations: &[Observation],
    noise: [f64; 2],
    choice: Choice,
) -> Result<Estimate, CalibrationError> {
    if model.link_count() == 0 || observations.is_empty() {
        return Err(CalibrationError::NoData(
            "no instant has joint angles, the base's pose and the end-effector's: there is nothing to calibrate on"
                .into(),
        ));
    }
    let parts = unknowns(model, choice);
    let mut list: Vec<Unknown> = parts.iter().map(|(u, _)| u.clone()).collect();
    let moving = observations.iter().any(|o| !o.is_still());
    if moving {
        list.push(Unknown { name: "telemetry_delay_s".into(), value: 0.0, plausible: PLAUSIBLE_DELAY_S });
    }
    let rows: Vec<Row> = observations
        .iter()
        .enumerate()
        .flat_map(|(instant, o)| {
            let still = if o.is_still() { 0 } else { 2 };
            [still, still, still + 1].map(|kind| Row { kind, instant })
        })
        .collect();
    let kinds = [noise[0], noise[1], noise[0], noise[1]];
    solve(&list, &rows, &kinds[..if moving { 4 } else { 2 }], |values| {
        let changes = parts.iter().zip(values).flat_map(|((_, places), v)| places.iter().map(|p| (*p, *v)));
        let model = model.with_parameters(changes).ok()?;
        let delay_s = if moving { values[parts.len()] } else { 0.0 };
        let mut out = Vec::with_capacity(3 * observations.len());
        for o in observations {
            let mut q = Coordinates::zeros();
            for (i, (angle, rate)) in o.q_rad.iter().zip(&o.qd_rad_s).enumerate() {
                q[3 + i] = angle + rate * delay_s;
            }
            let tip = model.end_effector(&q);
            out.extend([o.tip[0] - tip.x, o.tip[1] - tip.y, wrapped(o.tip[2] - tip.z)]);
        }
        Some(out)
    })
}

/// The plant with what was determined written into it.
pub fn calibrated(plant: &Plant, estimate: &Estimate) -> Plant {
    let mut plant = plant.clone();
    let n = plant.links.len();
    for p in &estimate.parameters {
        match p.name.as_str() {
            "base.joint1_x_m" => plant.base.joint1_xy_m[0] = p.value,
            "base.joint1_y_m" => plant.base.joint1_xy_m[1] = p.value,
            // The paper's convention: what joint 1 is off stands in the angle of the base to it.
            "base.joint1_angle_rad" => plant.base.joint1_angle_rad = p.value,
            name => {
                for (i, link) in plant.links.iter_mut().enumerate() {
                    let number = i + 1;
                    if name == format!("link[{number}].length_m")
                        || (name == format!("link[1..{}].length_m", n - 1) && number < n)
                    {
                        link.length_m = p.value;
                    } else if name == format!("link[{number}].joint_offset_rad") {
                        link.joint_offset_rad = p.value;
                    }
                }
            }
        }
    }
    plant
}

/// The observations that a run holds: one a still pose; those in motion besides where `moving` is set.
pub fn observations(run: &Run, links: usize, clamped: bool, moving: bool) -> Vec<Observation> {
    let (Some(joints), Some(ee)) = (&run.joints, &run.ee_pose) else { return Vec::new() };
    if joints.q_rad.len() < links || (run.base_pose.is_none() && !clamped) {
        return Vec::new();
    }
    let joints = &filled(joints);
    let mut all: Vec<(Observation, usize, f64)> = Vec::new();
    let sparse = ee.t_s.windows(2).all(|pair| pair[1] - pair[0] > 0.5);
    for (k, &t_s) in joints.t_s.iter().enumerate() {
        let q_rad: Vec<f64> = (0..links).map(|i| joints.q_rad[i][k]).collect();
        let base = run.base_pose.as_ref().map_or(Some([0.0; 3]), |poses| pose_at(poses, t_s));
        let (Some(base), Some(ee)) = (base, pose_at(ee, t_s)) else { continue };
        if q_rad.iter().any(|q| !q.is_finite()) {
            continue;
        }
        let rate = |i: usize| if sparse { 0.0 } else { rate(joints, i, k) };
        let qd_rad_s: Vec<f64> = (0..links).map(rate).collect();
        let still = qd_rad_s.iter().all(|rate| rate.abs() < STILL_RAD_S);
        if !still && !moving {
            continue;
        }
        let tip = seen_from(base, ee);
        if !still {
            all.push((Observation { q_rad, qd_rad_s, tip }, 1, t_s));
            continue;
        }
        // Rows of one still pose are one observation: what is wrong with the pose is wrong with all of them.
        let same = all.iter_mut().find(|(o, _, _)| {
            !sparse && o.is_still() && o.q_rad.iter().zip(&q_rad).all(|(a, b)| (a - b).abs() < SAME_POSE_RAD)
        });
        if let Some((o, count, _)) = same {
            *count += 1;
            let share = 1.0 / *count as f64;
            for (mean, new) in o.q_rad.iter_mut().zip(&q_rad) {
                *mean += (new - *mean) * share;
            }
            for c in 0..3 {
                let step = tip[c] - o.tip[c];
                o.tip[c] += share * if c == 2 { wrapped(step) } else { step };
            }
        } else {
            all.push((Observation { q_rad, qd_rad_s: vec![0.0; links], tip }, 1, t_s));
        }
    }
    all.into_iter().map(|(o, _, _)| o).collect()
}

/// Telemetry in which a joint that did not report at a row stands between its neighbouring reports.
fn filled(joints: &Joints) -> Joints {
    let column = |values: &Vec<f64>| {
        let known: Vec<usize> = (0..values.len()).filter(|k| values[*k].is_finite()).collect();
        let at = |k: usize| {
            let after = known.partition_point(|i| *i < k);
            let (Some(&b), false) = (known.get(after), values[k].is_finite()) else { return values[k] };
            let Some(&a) = after.checked_sub(1).and_then(|i| known.get(i)) else { return f64::NAN };
            let span_s = joints.t_s[b] - joints.t_s[a];
            if span_s > TELEMETRY_GAP_S {
                return f64::NAN;
            }
            values[a] + (values[b] - values[a]) * (joints.t_s[k] - joints.t_s[a]) / span_s
        };
        (0..values.len()).map(at).collect()
    };
    Joints {
        q_rad: joints.q_rad.iter().map(column).collect(),
        qd_rad_s: joints.qd_rad_s.iter().map(column).collect(),
        ..joints.clone()
    }
}

/// Rate of a joint at a row: as telemetry says, or from the rows around.
fn rate(joints: &Joints, i: usize, k: usize) -> f64 {
    let told = joints.qd_rad_s.get(i).map(|rates| rates[k]).filter(|rate| rate.is_finite());
    told.unwrap_or_else(|| {
        let (a, b) = (k.saturating_sub(1), (k + 1).min(joints.t_s.len() - 1));
        let rate = (joints.q_rad[i][b] - joints.q_rad[i][a]) / (joints.t_s[b] - joints.t_s[a]).max(1e-9);
        if rate.is_finite() { rate } else { f64::MAX }
    })
}

/// Pose at a time, linear between samples; none where there is no sample near.
fn pose_at(poses: &Poses, t_s: f64) -> Option<[f64; 3]> {
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

fn seen_from(base: [f64; 3], ee: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = base[2].sin_cos();
    let (dx, dy) = (ee[0] - base[0], ee[1] - base[1]);
    [cos * dx + sin * dy, cos * dy - sin * dx, wrapped(ee[2] - base[2])]
}

fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}
