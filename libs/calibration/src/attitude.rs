//! Dynamic calibration the paper's way (section 4.2, equations 6 to 10): one joint moves, and how far the base has turned
//! afterwards tells the inertia that all links share.
//!
//! Kept because it is what the laboratory published, and to show what it is worth: at the paper's 1.54 degrees of residual
//! the inertia comes out to 48 percent of itself. [`super::dynamic`] uses the same runs better.

use super::motion::{Tracks, pose_at};
use super::{CalibrationError, Estimate, Row, Unknown, first_guess, solve};
use fss_experiments::measured::Run;
use fss_multibody::{Coordinates, JointVector, Model, Parameter};

/// One joint from rest to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Maneuver {
    /// The joint that moved, from 0.
    pub joint: usize,
    /// Angles of all joints before, rad.
    pub from_rad: Vec<f64>,
    /// And after, rad.
    pub to_rad: Vec<f64>,
    /// How far the base turned, rad.
    pub turn_rad: f64,
}

/// What is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// Where the centre of mass stands in all links but the last, and in the last, too; the paper assumes their middles.
    pub centers: bool,
}

const PLAUSIBLE_INERTIA: f64 = 0.3;
const PLAUSIBLE_COM_M: f64 = 0.05;
/// Below this the turn is taken for linear in the inertia, kg m^2.
const SMALL_INERTIA: f64 = 0.002;
/// A joint slower than this stands still, rad/s.
const STILL_RAD_S: f64 = 0.02;
/// The joint that moves moves at least this far, the others less than a tenth of it, rad.
const LEAST_RAD: f64 = 0.1;
/// Rest before and after, s.
const REST_S: f64 = 0.6;
/// Steps of the path integral.
const STEPS: usize = 200;

/// The maneuvers of a run, and how many motions were left out because more than one joint moved.
pub fn maneuvers(run: &Run, links: usize) -> (Vec<Maneuver>, usize) {
    let (Some(tracks), Some(poses)) = (Tracks::of(run, links), &run.base_pose) else { return (Vec::new(), 0) };
    let known: Vec<(f64, Vec<f64>, Vec<f64>)> =
        tracks.report_times_s().iter().filter_map(|t| tracks.at(*t).map(|(q, qd)| (*t, q, qd))).collect();
    let still = |k: usize| known[k].2.iter().all(|rate| rate.abs() < STILL_RAD_S);
    // Rests: first and last report of each.
    let mut rests: Vec<(usize, usize)> = Vec::new();
    for k in (0..known.len()).filter(|k| still(*k)) {
        match rests.last_mut() {
            Some((_, end)) if *end + 1 == k => *end = k,
            _ => rests.push((k, k)),
        }
    }
    rests.retain(|(a, b)| known[*b].0 - known[*a].0 >= REST_S);
    let (mut all, mut mixed) = (Vec::new(), 0);
    for pair in rests.windows(2) {
        let (before, after) = (pair[0].1, pair[1].0);
        let (from, to) = (&known[before].1, &known[after].1);
        let moved = |i: usize| (to[i] - from[i]).abs();
        let Some(joint) = (0..links).max_by(|a, b| moved(*a).total_cmp(&moved(*b))) else { continue };
        if moved(joint) < LEAST_RAD {
            continue;
        }
        if (0..links).any(|i| i != joint && moved(i) > 0.1 * moved(joint)) {
            mixed += 1;
            continue;
        }
        let turn =
            pose_at(poses, known[before].0).zip(pose_at(poses, known[after].0)).map(|((a, _), (b, _))| b[2] - a[2]);
        if let Some(turn_rad) = turn {
            all.push(Maneuver { joint, from_rad: from.clone(), to_rad: to.clone(), turn_rad });
        }
    }
    (all, mixed)
}

/// How far the base turns by a maneuver, rad, without momentum: the path integral of the reaction vector (the function `d` of
/// equation 6).
pub fn turn(model: &Model, maneuver: &Maneuver) -> f64 {
    let step: JointVector = JointVector::from_iterator(
        (0..fss_multibody::MAX_LINKS).map(|i| at(&maneuver.to_rad, i) - at(&maneuver.from_rad, i)),
    ) / STEPS as f64;
    let rate = |s: f64| {
        let mut q = Coordinates::zeros();
        for i in 0..model.link_count() {
            q[3 + i] = at(&maneuver.from_rad, i) + s * step[i];
        }
        model.reaction_vector(&q).dot(&step)
    };
    (0..STEPS).map(|k| rate(k as f64 + 0.5)).sum()
}

fn at(values: &[f64], i: usize) -> f64 {
    values.get(i).copied().unwrap_or(0.0)
}

/// Estimates the inertia that all links share. `noise_rad` is that of an angle before the residuals tell.
///
/// # Errors
/// [`CalibrationError`]: no maneuver, or an iteration that fails.
pub fn calibrate(
    model: &Model,
    maneuvers: &[Maneuver],
    noise_rad: f64,
    choice: Choice,
) -> Result<Estimate, CalibrationError> {
    let n = model.link_count();
    if maneuvers.is_empty() {
        return Err(CalibrationError::NoData(
            "no maneuver moves one joint from rest to rest: the paper's method has nothing to calibrate on".into(),
        ));
    }
    let mut parts: Vec<(Unknown, Vec<Parameter>)> = Vec::new();
    let mut add = |name: String, plausible: f64, places: Vec<Parameter>| {
        let value = places.first().and_then(|p| model.parameter(*p)).unwrap_or_default();
        parts.push((Unknown { name, value, plausible }, places));
    };
    add(format!("link[1..{n}].inertia_kg_m2"), PLAUSIBLE_INERTIA, (1..=n).map(Parameter::LinkInertia).collect());
    if choice.centers {
        let all_but_last = (1..n).map(Parameter::ComToNextJoint).collect();
        add(format!("link[1..{}].com_to_next_joint_m", n - 1), PLAUSIBLE_COM_M, all_but_last);
        add(format!("link[{n}].com_to_next_joint_m"), PLAUSIBLE_COM_M, vec![Parameter::ComToNextJoint(n)]);
    }
    let unknowns: Vec<Unknown> = parts.iter().map(|(u, _)| u.clone()).collect();
    let rows: Vec<Row> = (0..maneuvers.len()).map(|k| Row { kind: 0, instant: k, series: k }).collect();
    solve(&unknowns, &first_guess(&unknowns), &rows, &[noise_rad * 2_f64.sqrt()], |values| {
        let at = |inertia: f64| {
            let values = std::iter::once(inertia).chain(values.iter().skip(1).copied());
            let changes = parts.iter().zip(values).flat_map(|((_, places), v)| places.iter().map(move |p| (*p, v)));
            model.with_parameters(changes).ok()
        };
        // Noise may ask for less than no inertia. The turn is nearly linear in it: go on along the tangent.
        let inside = at(values[0].max(SMALL_INERTIA))?;
        let beyond = (values[0] - SMALL_INERTIA).min(0.0);
        let ahead = at(2.0 * SMALL_INERTIA)?;
        let predicted = |m: &Maneuver| {
            let here = turn(&inside, m);
            if beyond == 0.0 { here } else { here + (turn(&ahead, m) - here) / SMALL_INERTIA * beyond }
        };
        Some(maneuvers.iter().map(|m| m.turn_rad - predicted(m)).collect())
    })
}
