//! A time without thrust: what was measured at the reports of the joints, and what a model makes of it.

use super::noise::{Mixing, Noise};
use super::torque::{Window, windows};
use crate::drift::{Interval, Whitener};
use crate::motion::{Tracks, pose_at, seen_from};
use fss_experiments::measured::{Poses, Run, pushes};
use fss_multibody::wrapped;
use fss_multibody::{Coordinates, JointVector, Model, State};
use nalgebra::{Matrix3, Vector3};

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
/// Rates of the end-effector come from poses this far before and after, s.
const HALF_RATE_S: f64 = 0.1;

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
    /// How it moves over the table, axes of the base: m/s and rad/s.
    tip_rate: Vec<[f64; 3]>,
    /// Variance of the poses' noise over that of one sample.
    variance: Vec<f64>,
    /// How noise enters the residuals, one an instant.
    pub(super) mixing: Vec<Mixing>,
    /// Where torques were measured.
    pub(super) torque: Vec<Window>,
}

/// What a model makes of a stretch.
pub(super) struct Series {
    /// Where the centre of mass is by model and measured pose, x and y, m, and the angle of the base as measured less as turned
    /// by the arm, rad; what the end-effector tells of their noise is taken off. Constant but for the drift.
    pub(super) drifting: Vec<Vector3<f64>>,
    /// End-effector as measured less as predicted, over its noise.
    pub(super) tip: Vec<Option<[f64; 3]>>,
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

/// Whether a thruster is commanded to push at any time from `start` to `end`.
fn thrust_between(run: &Run, start_s: f64, end_s: f64) -> bool {
    let rows = &run.thrust_levels;
    let until = |k: usize| rows.get(k + 1).map_or(f64::INFINITY, |(t, _)| *t) + AFTER_VALVE_S;
    rows.iter().enumerate().any(|(k, (t, levels))| pushes(levels) && *t < end_s && until(k) > start_s.max(rows[0].0))
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
            tip_rate: Vec::new(),
            variance: Vec::new(),
            mixing: Vec::new(),
            torque: Vec::new(),
        };
        // The first and the last instants lack neighbours for averages and differences.
        for &t_s in times {
            let (Some((base, variance)), Some(_)) = (pose_at(poses, t_s), joints(tracks, t_s + delay_s)) else {
                continue;
            };
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
            let turn =
                s.base.last().map_or(0.0, |before: &[f64; 3]| before[2] + wrapped(base[2] - before[2]) - base[2]);
            s.base.push([base[0], base[1], base[2] + turn]);
            s.variance.push(variance);
            let tip = run.ee_pose.as_ref().and_then(|poses| pose_at(poses, t_s));
            s.tip.push(tip.map(|(tip, _)| seen_from(base, tip)));
            s.tip_rate.push(rate_of(run.ee_pose.as_ref(), t_s, base[2]));
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

    /// What the model makes of it, telemetry moved by `shift_s` more, end-effector poses stamped
    /// `tip_delay_s` late, the table's acceleration `tilt`.
    pub(super) fn series(&self, model: &Model, shift_s: f64, tip_delay_s: f64, tilt: [f64; 2]) -> Series {
        let count = self.len();
        let mut out = Series { drifting: Vec::with_capacity(count), tip: Vec::with_capacity(count) };
        let mut turned = 0.0;
        for k in 0..count {
            if k > 0 {
                turned += self.turn_between(model, k - 1, shift_s);
            }
            let q = self.joints(k * SUBSTEPS, shift_s);
            let center = model.center_of_mass(&coordinates(self.base[k], &q));
            let since = self.t_s[k] - self.t_s[0];
            let tip = self.tip[k].map(|tip| {
                let predicted = model.end_effector(&coordinates([0.0; 3], &q));
                let late = self.tip_rate[k].map(|rate| rate * tip_delay_s);
                [
                    tip[0] + late[0] - predicted.x,
                    tip[1] + late[1] - predicted.y,
                    wrapped(tip[2] + late[2] - predicted.z),
                ]
            });
            let fall = tilt.map(|acceleration| 0.5 * acceleration * since * since);
            let drifting = [center.x - fall[0], center.y - fall[1], self.base[k][2] - turned];
            out.drifting.push(self.mixing[k].less_tip(drifting, tip));
            out.tip.push(tip.map(|tip| self.mixing[k].tip_apart(tip)));
        }
        out
    }

    /// The intervals between instants.
    pub(super) fn intervals(&self, model: &Model) -> Vec<Interval> {
        let pairs = self.t_s.windows(2).enumerate();
        pairs
            .map(|(k, pair)| {
                let duration_s = pair[1] - pair[0];
                let turn_per_momentum = simpson(duration_s / SUBSTEPS as f64, |j| {
                    let q = coordinates([0.0; 3], &self.q[k * SUBSTEPS + j]);
                    1.0 / model.inertia_about_com(&q)
                });
                Interval { duration_s, turn_per_momentum }
            })
            .collect()
    }

    /// A filter for the stretch, noise and model as in [`Stretch::prepare`].
    pub(super) fn whitener(&self, model: &Model, walks: [f64; 2]) -> Whitener {
        let noise: Vec<Matrix3<f64>> = self.mixing.iter().map(|mixing| mixing.rest).collect();
        Whitener::new(&noise, &self.intervals(model), walks)
    }

    /// Angles on the fine grid, telemetry moved.
    fn joints(&self, at: usize, shift_s: f64) -> JointVector {
        self.q[at] + self.qd[at] * shift_s + self.qdd[at] * (0.5 * shift_s * shift_s)
    }

    /// How far the arm turns the base from instant `k` to the next: `int w . dq` along the joints' path, by Simpson's rule on
    /// parabolas through three points of it, so that for a constant `w` only the ends count.
    fn turn_between(&self, model: &Model, k: usize, shift_s: f64) -> f64 {
        let points: [JointVector; SUBSTEPS + 1] = std::array::from_fn(|j| self.joints(k * SUBSTEPS + j, shift_s));
        let react = |q: &JointVector| model.reaction_vector(&coordinates([0.0; 3], q));
        let reaction = points.map(|q| react(&q));
        let piece = |j: usize| {
            let (a, b, c) = (&points[j], &points[j + 1], &points[j + 2]);
            let (start, middle, end) = (-3.0 * a + 4.0 * b - c, c - a, a - 4.0 * b + 3.0 * c);
            let sum = reaction[j].dot(&start) + 4.0 * reaction[j + 1].dot(&middle) + reaction[j + 2].dot(&end);
            sum / 6.0
        };
        (0..SUBSTEPS).step_by(2).map(piece).sum()
    }

    /// What the model takes for the weighted impulses of the torques, `int phi tau dt`, one a joint.
    pub(super) fn impulses(&self, model: &Model, window: &Window) -> JointVector {
        window.sum(&self.t_s, |k, phi, phi_dot| {
            let (q, qd) = (&self.q[k * SUBSTEPS], &self.qd[k * SUBSTEPS]);
            let pose = coordinates([0.0; 3], q);
            let twist = model.base_twist(&pose, qd, &Vector3::new(0.0, 0.0, window.spin));
            let v = coordinates(twist.into(), qd);
            let momentum = model.generalized_momentum(&State { q: pose, v });
            let mut impulse = JointVector::zeros();
            for i in 0..model.link_count() {
                let energy = |step: f64| {
                    let mut q = pose;
                    q[3 + i] += step;
                    model.kinetic_energy(&State { q, v })
                };
                let slope = (energy(1e-4) - energy(-1e-4)) / 2e-4;
                impulse[i] = -phi_dot * momentum[3 + i] - phi * slope;
            }
            impulse
        })
    }

    /// Finds by a model how noise enters, and the angular momentum of all windows.
    pub(super) fn prepare(&mut self, model: &Model, noise: Noise) {
        self.mixing = (0..self.len())
            .map(|k| {
                let q = coordinates(self.base[k], &self.q[k * SUBSTEPS]);
                Mixing::new(model, &q, self.tip[k], noise, self.variance[k])
            })
            .collect();
        let spins: Vec<f64> = self.torque.iter().map(|window| self.spin(model, window)).collect();
        for (window, spin) in self.torque.iter_mut().zip(spins) {
            window.spin = spin;
        }
    }

    /// Angular momentum in a window, from how far the base turned besides what the arm made it turn.
    fn spin(&self, model: &Model, window: &Window) -> f64 {
        let (first, last) = (window.first, window.last);
        let turn: f64 = (first..last).map(|k| self.turn_between(model, k, 0.0)).sum();
        let per_momentum = simpson_over(&self.t_s[first..=last], |j| {
            1.0 / model.inertia_about_com(&coordinates([0.0; 3], &self.q[first * SUBSTEPS + j]))
        });
        (self.base[last][2] - self.base[first][2] - turn) / per_momentum
    }
}

/// How a pose moves at a time, in axes turned by `angle`; zero where it is not seen.
fn rate_of(poses: Option<&Poses>, t_s: f64, angle: f64) -> [f64; 3] {
    let at = |t_s: f64| poses.and_then(|poses| pose_at(poses, t_s)).map(|(pose, _)| pose);
    let Some((a, b)) = at(t_s - HALF_RATE_S).zip(at(t_s + HALF_RATE_S)) else { return [0.0; 3] };
    let [x, y, turn] = seen_from([a[0], a[1], angle], b);
    [x, y, wrapped(turn + angle - a[2])].map(|step| step / (2.0 * HALF_RATE_S))
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
