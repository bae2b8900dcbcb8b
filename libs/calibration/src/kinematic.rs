//! Kinematic calibration: link lengths, joint offsets and the first joint's pose (the paper's equations 1 to 5).

use super::motion::{Tracks, pose_at, seen_from};
use super::{CalibrationError, Estimate, Row, Unknown, first_guess, solve};
use fss_experiments::measured::{Posture, Run};
use fss_multibody::wrapped;
use fss_multibody::{Coordinates, Model, Parameter};

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
    /// Whether the arm stood still.
    pub fn is_still(&self) -> bool {
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
/// A joint that moves by less stands, rad.
const AT_REST_RAD: f64 = 0.02;
pub(super) const PLAUSIBLE_DELAY_S: f64 = 0.5;
/// Joints slower than this stand still, rad/s.
const STILL_RAD_S: f64 = 0.01;
/// Poses that differ by less are one, rad.
const SAME_POSE_RAD: f64 = 0.01;

/// The unknowns, each with the places in the model that it stands for.
pub(super) fn unknowns(model: &Model, choice: Choice) -> Vec<(Unknown, Vec<Parameter>)> {
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

/// How many parameters a choice asks for.
pub fn count_unknowns(model: &Model, choice: Choice) -> usize {
    unknowns(model, choice).len()
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
            let series = if still == 0 { 4 + instant } else { 0 };
            [(still, series), (still, series + 1), (still + 1, series)].map(|(kind, series)| Row {
                kind,
                instant,
                series,
            })
        })
        .collect();
    let kinds = [noise[0], noise[1], noise[0], noise[1]];
    solve(&list, &first_guess(&list), &rows, &kinds[..if moving { 4 } else { 2 }], |values| {
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

/// Joints, from 1, that stand at one angle in all observations.
pub fn standing(observations: &[Observation]) -> Vec<usize> {
    let links = observations.first().map_or(0, |first| first.q_rad.len());
    let stands = |i: usize| observations.iter().all(|o| (o.q_rad[i] - observations[0].q_rad[i]).abs() < AT_REST_RAD);
    (0..links).filter(|i| stands(*i)).map(|i| i + 1).collect()
}

/// The observations that a run holds: one a still pose; those in motion besides where `moving` is set. Postures that a
/// service collected in flight stand for the still poses.
pub fn observations(run: &Run, links: usize, clamped: bool, moving: bool) -> Vec<Observation> {
    if !moving && !run.postures.is_empty() {
        let of = |p: &Posture| Observation { q_rad: p.q_rad.clone(), qd_rad_s: vec![0.0; links], tip: p.tip };
        return run.postures.iter().filter(|p| p.q_rad.len() == links).map(of).collect();
    }
    let (Some(tracks), Some(ee)) = (Tracks::of(run, links), &run.ee_pose) else { return Vec::new() };
    if run.base_pose.is_none() && !clamped {
        return Vec::new();
    }
    let mut all: Vec<(Observation, usize)> = Vec::new();
    let sparse = ee.t_s.windows(2).all(|pair| pair[1] - pair[0] > 0.5);
    for &t_s in tracks.report_times_s() {
        let base = run.base_pose.as_ref().map_or(Some(([0.0; 3], 0.0)), |poses| pose_at(poses, t_s));
        let (Some((q_rad, rates)), Some((base, _)), Some((ee, _))) = (tracks.at(t_s), base, pose_at(ee, t_s)) else {
            continue;
        };
        let qd_rad_s = if sparse { vec![0.0; links] } else { rates };
        let still = qd_rad_s.iter().all(|rate| rate.abs() < STILL_RAD_S);
        if !still && !moving {
            continue;
        }
        let tip = seen_from(base, ee);
        if !still {
            all.push((Observation { q_rad, qd_rad_s, tip }, 1));
            continue;
        }
        // Rows of one still pose are one observation: what is wrong with the pose is wrong with all of them.
        let same = all.iter_mut().find(|(o, _)| {
            !sparse && o.is_still() && o.q_rad.iter().zip(&q_rad).all(|(a, b)| (a - b).abs() < SAME_POSE_RAD)
        });
        if let Some((o, count)) = same {
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
            all.push((Observation { q_rad, qd_rad_s: vec![0.0; links], tip }, 1));
        }
    }
    all.into_iter().map(|(o, _)| o).collect()
}
