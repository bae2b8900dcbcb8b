//! A time without thrust: what was measured at the reports of the joints, and what a model makes of it.

use super::torque::{Window, windows};
use crate::calibrate::drift::Interval;
use crate::calibrate::motion::{Tracks, pose_at, seen_from, wrapped};
use crate::measured::Run;
use fss_multibody::{Coordinates, JointVector, Model, State};
use nalgebra::Vector3;

/// Steps of the integral between two instants; even, for Simpson's rule.
const SUBSTEPS: usize = 4;
/// Instants stand at least this far apart, s: reports that come faster say little more.
const SPACING_S: f64 = 0.15;
/// A longer time between two instants ends a stretch, s.
const LONGEST_GAP_S: f64 = 0.5;
/// A shorter stretch is left out, s.
const SHORTEST_S: f64 = 3.0;
/// Thrust lasts this much longer than its valve is told, s.
const AFTER_VALVE_S: f64 = 0.1;
/// Accelerations come from rates this far apart, s.
const DIFFERENCE_S: f64 = 0.02;

/// What was measured. Series `q`, `qd`, `qdd` stand on the fine grid of the integral, the others at the instants.
pub(super) struct Stretch {
    /// Times of the instants, s.
    t_s: Vec<f64>,
    /// Angles, rates and accelerations of the joints: [`SUBSTEPS`] an instant.
    pub(super) q: Vec<JointVector>,
    qd: Vec<JointVector>,
    qdd: Vec<JointVector>,
    base: Vec<[f64; 3]>,
    /// End-effector seen from the base.
    pub(super) tip: Vec<Option<[f64; 3]>>,
    /// Variance of the poses' noise over that of one sample.
    pub(super) variance: Vec<f64>,
    /// Where torques were measured.
    pub(super) torque: Vec<Window>,
}

/// What a model makes of a stretch.
pub(super) struct Series {
    /// Where the centre of mass is by model and measured pose, x and y, m: a line but for the drift.
    pub(super) center: [Vec<f64>; 2],
    /// Angle of the base as measured less as turned by the arm, rad: constant but for the drift.
    pub(super) angle: Vec<f64>,
    /// End-effector as measured less as predicted, m and rad.
    pub(super) tip: Vec<[f64; 3]>,
}

/// The stretches of all runs, telemetry moved by `delay_s`.
pub(super) fn all(runs: &[Run], links: usize, delay_s: f64) -> Vec<Stretch> {
    runs.iter().flat_map(|run| of_run(run, links, delay_s)).collect()
}

fn of_run(run: &Run, links: usize, delay_s: f64) -> Vec<Stretch> {
    let (Some(tracks), Some(_)) = (Tracks::of(run, links), &run.base_pose) else { return Vec::new() };
    let mut pieces: Vec<Vec<f64>> = vec![Vec::new()];
    let mut last = f64::NEG_INFINITY;
    for report_s in tracks.report_times_s() {
        let t_s = report_s - delay_s;
        if t_s - last < SPACING_S {
            continue;
        }
        if t_s - last > LONGEST_GAP_S || thrust_between(run, last, t_s) {
            pieces.push(Vec::new());
        }
        last = t_s;
        if let Some(piece) = pieces.last_mut() {
            piece.push(t_s);
        }
    }
    let long = |piece: &Vec<f64>| piece.last().zip(piece.first()).is_some_and(|(end, start)| end - start >= SHORTEST_S);
    pieces.iter().filter(|piece| long(piece)).filter_map(|piece| Stretch::new(run, &tracks, piece, delay_s)).collect()
}

/// Whether a valve is open at any time from `start` to `end`.
fn thrust_between(run: &Run, start_s: f64, end_s: f64) -> bool {
    let until = |k: usize| run.valves.get(k + 1).map_or(f64::INFINITY, |(t, _)| *t) + AFTER_VALVE_S;
    run.valves
        .iter()
        .enumerate()
        .any(|(k, (t, open))| open.contains(&true) && *t < end_s && until(k) > start_s.max(run.valves[0].0))
}

impl Stretch {
    fn new(run: &Run, tracks: &Tracks, times: &[f64], delay_s: f64) -> Option<Self> {
        let poses = run.base_pose.as_ref()?;
        let mut s = Self {
            t_s: Vec::new(),
            q: Vec::new(),
            qd: Vec::new(),
            qdd: Vec::new(),
            base: Vec::new(),
            tip: Vec::new(),
            variance: Vec::new(),
            torque: Vec::new(),
        };
        // The first and the last instants lack neighbours for averages and differences.
        for &t_s in times {
            let (Some((base, variance)), Some(_)) = (pose_at(poses, t_s), joints(tracks, t_s + delay_s)) else { continue };
            if s.t_s.last().is_some_and(|last| t_s - last > LONGEST_GAP_S) {
                break;
            }
            if let Some(&last) = s.t_s.last() {
                for k in 1..SUBSTEPS {
                    let between = last + (t_s - last) * k as f64 / SUBSTEPS as f64;
                    s.push(joints(tracks, between + delay_s)?);
                }
            }
            s.push(joints(tracks, t_s + delay_s)?);
            s.t_s.push(t_s);
            let turn = s.base.last().map_or(0.0, |before: &[f64; 3]| before[2] + wrapped(base[2] - before[2]) - base[2]);
            s.base.push([base[0], base[1], base[2] + turn]);
            s.variance.push(variance);
            let tip = run.ee_pose.as_ref().and_then(|poses| pose_at(poses, t_s));
            s.tip.push(tip.map(|(tip, _)| seen_from(base, tip)));
        }
        if s.duration_s() < SHORTEST_S {
            return None;
        }
        s.torque = run.joints.as_ref().map_or_else(Vec::new, |joints| windows(joints, &s.t_s, delay_s, tracks.len()));
        Some(s)
    }

    fn push(&mut self, (q, qd, qdd): (JointVector, JointVector, JointVector)) {
        self.q.push(q);
        self.qd.push(qd);
        self.qdd.push(qdd);
    }

    /// Number of instants.
    pub(super) fn len(&self) -> usize {
        self.t_s.len()
    }

    /// From first to last instant, s.
    pub(super) fn duration_s(&self) -> f64 {
        self.t_s.last().zip(self.t_s.first()).map_or(0.0, |(end, start)| end - start)
    }

    /// What the model makes of it, telemetry moved by `shift_s` more, the table's acceleration `tilt`.
    pub(super) fn series(&self, model: &Model, shift_s: f64, tilt: [f64; 2]) -> Series {
        let count = self.len();
        let mut out = Series {
            center: [Vec::with_capacity(count), Vec::with_capacity(count)],
            angle: Vec::with_capacity(count),
            tip: Vec::with_capacity(count),
        };
        let mut turned = 0.0;
        for k in 0..count {
            if k > 0 {
                let step = (self.t_s[k] - self.t_s[k - 1]) / SUBSTEPS as f64;
                turned += simpson(step, |j| {
                    let (q, qd) = self.joints((k - 1) * SUBSTEPS + j, shift_s);
                    model.reaction_vector(&coordinates([0.0; 3], &q)).dot(&qd)
                });
            }
            let (q, _) = self.joints(k * SUBSTEPS, shift_s);
            let center = model.center_of_mass(&coordinates(self.base[k], &q));
            let since = self.t_s[k] - self.t_s[0];
            for axis in 0..2 {
                out.center[axis].push(center[axis] - 0.5 * tilt[axis] * since * since);
            }
            out.angle.push(self.base[k][2] - turned);
            if let Some(tip) = self.tip[k] {
                let predicted = model.end_effector(&coordinates([0.0; 3], &q));
                out.tip.push([tip[0] - predicted.x, tip[1] - predicted.y, wrapped(tip[2] - predicted.z)]);
            }
        }
        out
    }

    /// The intervals between instants, for the centre of mass and for the angle.
    pub(super) fn intervals(&self, model: &Model) -> (Vec<Interval>, Vec<Interval>) {
        let pairs = self.t_s.windows(2).enumerate();
        pairs
            .map(|(k, pair)| {
                let duration_s = pair[1] - pair[0];
                let per_momentum = simpson(duration_s / SUBSTEPS as f64, |j| {
                    let q = coordinates([0.0; 3], &self.q[k * SUBSTEPS + j]);
                    1.0 / model.inertia_about_com(&q)
                });
                (Interval { duration_s, gain: duration_s }, Interval { duration_s, gain: per_momentum })
            })
            .unzip()
    }

    fn joints(&self, at: usize, shift_s: f64) -> (JointVector, JointVector) {
        let (q, qd, qdd) = (&self.q[at], &self.qd[at], &self.qdd[at]);
        (q + qd * shift_s + qdd * (0.5 * shift_s * shift_s), qd + qdd * shift_s)
    }

    /// What the model takes for the weighted impulse of a torque: `int phi tau dt`, freed of accelerations by parts.
    pub(super) fn impulse(&self, model: &Model, window: &Window) -> f64 {
        let spin = self.spin(model, window);
        window.sum(&self.t_s, |k, phi, phi_dot| {
            let (q, qd) = (&self.q[k * SUBSTEPS], &self.qd[k * SUBSTEPS]);
            let pose = coordinates([0.0; 3], q);
            let twist = model.base_twist(&pose, qd, &Vector3::new(0.0, 0.0, spin));
            let state = State { q: pose, v: coordinates(twist.into(), qd) };
            let momentum = model.generalized_momentum(&state)[3 + window.joint];
            let energy = |step: f64| {
                let mut q = pose;
                q[3 + window.joint] += step;
                model.kinetic_energy(&State { q, v: state.v })
            };
            let slope = (energy(1e-4) - energy(-1e-4)) / 2e-4;
            -phi_dot * momentum - phi * slope
        })
    }

    /// Angular momentum in a window, from how far the base turned besides what the arm made it turn.
    fn spin(&self, model: &Model, window: &Window) -> f64 {
        let (first, last) = (window.first, window.last);
        let turn = simpson_over(&self.t_s[first..=last], |j| {
            let at = first * SUBSTEPS + j;
            model.reaction_vector(&coordinates([0.0; 3], &self.q[at])).dot(&self.qd[at])
        });
        let per_momentum = simpson_over(&self.t_s[first..=last], |j| {
            1.0 / model.inertia_about_com(&coordinates([0.0; 3], &self.q[first * SUBSTEPS + j]))
        });
        (self.base[last][2] - self.base[first][2] - turn) / per_momentum
    }
}

/// Angles, rates and accelerations at a time.
fn joints(tracks: &Tracks, t_s: f64) -> Option<(JointVector, JointVector, JointVector)> {
    let (q, qd) = tracks.at(t_s)?;
    let rates = |t_s: f64| tracks.at(t_s).map_or_else(|| qd.clone(), |(_, rates)| rates);
    let (before, after) = (rates(t_s - DIFFERENCE_S), rates(t_s + DIFFERENCE_S));
    let mut out = (JointVector::zeros(), JointVector::zeros(), JointVector::zeros());
    for i in 0..q.len() {
        out.0[i] = q[i];
        out.1[i] = qd[i];
        out.2[i] = (after[i] - before[i]) / (2.0 * DIFFERENCE_S);
    }
    Some(out)
}

fn coordinates(base: [f64; 3], joints: &JointVector) -> Coordinates {
    let mut q = Coordinates::zeros();
    q.as_mut_slice()[..3].copy_from_slice(&base);
    q.as_mut_slice()[3..].copy_from_slice(joints.as_slice());
    q
}

/// Simpson's rule over [`SUBSTEPS`] steps.
fn simpson(step: f64, value: impl Fn(usize) -> f64) -> f64 {
    let weight = |j: usize| match j {
        0 | SUBSTEPS => 1.0,
        j if j % 2 == 1 => 4.0,
        _ => 2.0,
    };
    (0..=SUBSTEPS).map(|j| weight(j) * value(j)).sum::<f64>() * step / 3.0
}

fn simpson_over(t_s: &[f64], value: impl Fn(usize) -> f64) -> f64 {
    let pairs = t_s.windows(2).enumerate();
    pairs.map(|(k, pair)| simpson((pair[1] - pair[0]) / SUBSTEPS as f64, |j| value(k * SUBSTEPS + j))).sum()
}
