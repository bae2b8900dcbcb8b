//! What a window of a floating base's run holds: rows, their noise, and how they are made white.
//!
//! Samples of one sensor within a bin are averaged: what there is to find is slow, and a tenth of the rows says as much.
//! Rows that share an error are whitened together: the three of an end-effector pose, which the joints' uncertainty moves
//! alike, and the two of a torque sensor.

use super::arm::ArmMotion;
use super::drive::{direction, free_inertia, measured};
use super::{MARGIN_S, STEP_S};
use crate::trial::{RowInfo, Span, Whitened};
use fss_experiments::measured::{Poses, Run};
use fss_multibody::{JointVector, MAX_LINKS, coordinates};
use fss_plant::{Grid, Plant, Rollout};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3};
use std::ops::Range;

/// Length of a window, about, s.
const WINDOW_S: f64 = 5.0;
/// A window with fewer poses cannot hold an initial state of six numbers and say anything.
pub(super) const FEWEST_POSES: usize = 12;
/// Poses within this of a window's start tell its first guess, s.
const GUESS_S: f64 = 0.25;
/// Length of a bin of base and gyro, s.
const BIN_S: f64 = 0.05;
/// Between the knots of the room's force, s.
const KNOT_S: f64 = 1.0;
/// A joint at rest holds one friction, whatever it is, over as many rows: they say as little together as one.
const REST_ROWS: f64 = 50.0;
/// When a drive takes up its command is known to about this, s.
const JUMP_S: f64 = 0.08;
/// And how strongly, to this share.
const ACCELERATION_SHARE: f64 = 0.1;
/// Friction is not known better than this near rest, N m.
const REST_FRICTION_N_M: f64 = 0.05;

/// Steps of the derivatives by a window's initial pose, m and rad, and by its rates, m/s and rad/s: of these so much as sets a
/// base in motion that dry friction holds.
const POSE_STEP: f64 = 1e-5;
const RATE_STEP: f64 = 1e-3;

/// One window.
pub(super) struct Window {
    pub(super) first_step: usize,
    steps: usize,
    pub(super) poses: Range<usize>,
    pub(super) gyro: Range<usize>,
    pub(super) ee: Range<usize>,
    pub(super) joints: Range<usize>,
    pub(super) row_count: usize,
    from_s: f64,
    to_s: f64,
    /// Knots of the room's force, in units of independent standard normals: force x, y, torque.
    room: Option<[DMatrix<f64>; 3]>,
    /// Heading at each step, rad.
    heading: Vec<f64>,
}

/// Names of all channels that a run can have.
pub(super) fn channels(links: usize) -> Vec<String> {
    let fixed = ["base_x", "base_y", "base_theta", "gyro", "ee_x", "ee_y", "ee_theta"];
    let mut names: Vec<String> = fixed.iter().map(|s| (*s).to_owned()).collect();
    names.extend((1..=links).map(|i| format!("torque{i}")));
    names.extend((1..=links).map(|i| format!("current{i}")));
    names
}

/// Cuts a run into windows.
pub(super) fn windows(plant: &Plant, run: &Run, start_s: f64) -> Vec<Window> {
    let Some(poses) = &run.base_pose else { return Vec::new() };
    let within = |t: Option<&Vec<f64>>, from: f64, to: f64| {
        t.map_or(0..0, |t| t.partition_point(|t| *t < from)..t.partition_point(|t| *t < to))
    };
    let (first_s, last_s) = (poses.t_s[0], poses.t_s[poses.t_s.len() - 1]);
    let count = ((last_s - first_s) / WINDOW_S).round().max(1.0);
    let length_s = (last_s - first_s) / count;
    let mut out = Vec::new();
    for i in 0..count as usize {
        let from_s = first_s + i as f64 * length_s;
        let to_s = if i + 1 == count as usize { last_s + 1e-6 } else { from_s + length_s };
        let range = within(Some(&poses.t_s), from_s, to_s);
        if range.len() < FEWEST_POSES || (plant.link_count() > 0 && !run.arm_is_known(from_s, to_s)) {
            continue;
        }
        let first_step = ((from_s - MARGIN_S - start_s) / STEP_S + 1e-6).floor() as usize;
        let grid_s = start_s + first_step as f64 * STEP_S;
        let steps = ((to_s + MARGIN_S - grid_s) / STEP_S).ceil() as usize;
        let heading = (0..steps).map(|k| heading(poses, grid_s + k as f64 * STEP_S)).collect();
        out.push(Window {
            first_step,
            steps,
            poses: range,
            gyro: within(run.gyro.as_ref().map(|g| &g.t_s), from_s, to_s),
            ee: within(run.ee_pose.as_ref().filter(|_| plant.link_count() > 0).map(|g| &g.t_s), from_s, to_s),
            joints: within(run.joints.as_ref().map(|g| &g.t_s), from_s, to_s),
            row_count: 0,
            from_s,
            to_s,
            room: room(plant, steps as f64 * STEP_S),
            heading,
        });
    }
    out
}

fn heading(poses: &Poses, t_s: f64) -> f64 {
    poses.values[poses.t_s.partition_point(|t| *t < t_s).min(poses.values.len() - 1)][2]
}

/// Square roots of the covariances of the room's force at the knots: an Ornstein-Uhlenbeck process each.
fn room(plant: &Plant, length_s: f64) -> Option<[DMatrix<f64>; 3]> {
    let air = plant.disturbance.as_ref()?;
    let knots = (length_s / KNOT_S).ceil() as usize + 1;
    let root = |sd: f64| {
        let covariance = DMatrix::from_fn(knots, knots, |i, j| {
            let apart = KNOT_S * (i as f64 - j as f64).abs();
            sd * sd * ((-apart / air.correlation_s.max(1e-3)).exp() + if i == j { 1e-9 } else { 0.0 })
        });
        covariance.cholesky().map(|c| c.l())
    };
    Some([root(air.force_std_n.max(1e-9))?, root(air.force_std_n.max(1e-9))?, root(air.torque_std_n_m.max(1e-12))?])
}

impl Window {
    pub(super) fn grid(&self, start_s: f64) -> Grid {
        Grid { start_s: start_s + self.first_step as f64 * STEP_S, step_s: STEP_S, steps: self.steps }
    }

    /// Adds the room's force, as its unknowns say, to the thrust on each step (base axes).
    pub(super) fn disturb(&self, unknowns: &[f64], thrust: &mut [[f64; 3]]) {
        let Some(room) = &self.room else { return };
        let knots = room[0].nrows();
        if unknowns.len() < 3 * knots || unknowns.iter().all(|u| *u == 0.0) {
            return;
        }
        let force = |i: usize| &room[i] * DVector::from_column_slice(&unknowns[i * knots..(i + 1) * knots]);
        let forces = [force(0), force(1), force(2)];
        for (k, push) in thrust.iter_mut().enumerate() {
            let at = (k as f64 + 0.5) * STEP_S / KNOT_S;
            let before = (at as usize).min(knots - 2);
            let share = at - before as f64;
            let [fx, fy, torque] = forces.each_ref().map(|f| (1.0 - share) * f[before] + share * f[before + 1]);
            let (sin, cos) = self.heading[k.min(self.heading.len() - 1)].sin_cos();
            push[0] += cos * fx + sin * fy;
            push[1] += cos * fy - sin * fx;
            push[2] += torque;
        }
    }

    /// Rows, noise, whitening, first guess.
    pub(super) fn span(&self, plant: &Plant, rollout: &Rollout, run: &Run, motion: &ArmMotion, start_s: f64) -> Span {
        let mut layout = Layout { plant, rollout, run, motion, start_s, rows: Vec::new(), whitening: Vec::new() };
        layout.poses(self);
        layout.gyro(self);
        layout.end_effector(self);
        layout.torques(self);
        let knots = self.room.as_ref().map_or(0, |r| 3 * r[0].nrows());
        let mut guess = Self::first_guess(run, self.grid(start_s).start_s);
        guess.resize(6 + knots, 0.0);
        let mut steps = vec![POSE_STEP; 3];
        steps.resize(6, RATE_STEP);
        steps.resize(6 + knots, 1.0);
        let Layout { rows, whitening, .. } = layout;
        Span { from_s: self.from_s, to_s: self.to_s, guess, steps, prior_count: knots, rows, whitening }
    }

    /// A first guess of the state at the start of the grid: a straight line through the poses around it, or, where the run
    /// begins later, through the first ones.
    fn first_guess(run: &Run, grid_s: f64) -> Vec<f64> {
        let Some(poses) = &run.base_pose else { return vec![0.0; 6] };
        let until = |t_s: f64| poses.t_s.partition_point(|t| *t < t_s);
        let last = poses.t_s.len();
        let from = until(grid_s - GUESS_S).min(last.saturating_sub(6));
        let near = from..until(grid_s.max(poses.t_s[0]) + GUESS_S).max(from + 6).min(last);
        let count = near.len() as f64;
        let mean_s = poses.t_s[near.clone()].iter().sum::<f64>() / count;
        let spread: f64 = poses.t_s[near.clone()].iter().map(|t| (t - mean_s).powi(2)).sum();
        let line = |i: usize| {
            let mean = near.clone().map(|k| poses.values[k][i]).sum::<f64>() / count;
            let slope =
                near.clone().map(|k| (poses.t_s[k] - mean_s) * poses.values[k][i]).sum::<f64>() / spread.max(1e-9);
            (mean + slope * (grid_s - mean_s), slope)
        };
        let [x, y, angle] = [line(0), line(1), line(2)];
        vec![x.0, y.0, angle.0, x.1, y.1, angle.1]
    }
}

struct Layout<'a> {
    plant: &'a Plant,
    rollout: &'a Rollout,
    run: &'a Run,
    motion: &'a ArmMotion,
    start_s: f64,
    rows: Vec<RowInfo>,
    whitening: Vec<Whitened>,
}

impl Layout<'_> {
    fn row(&mut self, channel: usize, t_s: f64, variance: f64) -> u32 {
        self.rows.push(RowInfo { channel, t_s, variance });
        (self.rows.len() - 1) as u32
    }

    fn half(&self, t_s: f64) -> usize {
        let half = ((t_s - self.start_s) / (0.5 * STEP_S)).round().max(0.0) as usize;
        half.min(self.motion.samples.len() - 1)
    }

    /// Bins of about `width_s` among `stamps`.
    fn bins(stamps: &[f64], range: Range<usize>, width_s: f64) -> Vec<Range<usize>> {
        let mut out = Vec::new();
        let mut from = range.start;
        while from < range.end {
            let end = stamps.partition_point(|t| *t < stamps[from] + width_s - 1e-6).clamp(from + 1, range.end);
            out.push(from..end);
            from = end;
        }
        out
    }

    fn mean(&mut self, channel: usize, rows: Vec<u32>, sd: f64) {
        let weight = 1.0 / (sd * (rows.len() as f64).sqrt());
        self.whitening.push(Whitened { channel, sum: rows.into_iter().map(|r| (r, weight)).collect() });
    }

    fn poses(&mut self, window: &Window) {
        let Some(poses) = &self.run.base_pose else { return };
        let sd = pose_noise(self.plant);
        let first = self.rows.len() as u32;
        for k in window.poses.clone() {
            for (i, sd) in sd.iter().enumerate() {
                self.row(i, poses.t_s[k], sd * sd);
            }
        }
        for bin in Self::bins(&poses.t_s, window.poses.clone(), BIN_S) {
            for (i, sd) in sd.iter().enumerate() {
                let rows = bin.clone().map(|k| first + 3 * (k - window.poses.start) as u32 + i as u32).collect();
                self.mean(i, rows, *sd);
            }
        }
    }

    fn gyro(&mut self, window: &Window) {
        let Some(gyro) = &self.run.gyro else { return };
        let sd = self.plant.sensors.gyro_rad_s.max(1e-6);
        let model = self.rollout.model(0.0);
        let first = self.rows.len() as u32;
        for k in window.gyro.clone() {
            self.row(3, gyro.t_s[k], sd * sd);
        }
        for bin in Self::bins(&gyro.t_s, window.gyro.clone(), BIN_S) {
            let half = self.half(gyro.t_s[bin.start]);
            let reaction = model.reaction_vector(&coordinates([0.0; 3], self.motion.samples[half].q_rad.as_slice()));
            let arm = reaction.component_mul(&reaction).dot(&self.motion.variance[half][1]);
            let sd = (sd * sd + arm * bin.len() as f64).sqrt();
            for k in bin.clone() {
                self.rows[first as usize + k - window.gyro.start].variance += arm;
            }
            self.mean(3, bin.map(|k| first + (k - window.gyro.start) as u32).collect(), sd);
        }
    }

    fn end_effector(&mut self, window: &Window) {
        let Some(ee) = &self.run.ee_pose else { return };
        let sd = pose_noise(self.plant);
        let model = self.rollout.model(0.0);
        let first = self.rows.len() as u32;
        let width_s = telemetry_interval_s(self.run).clamp(BIN_S, 0.5);
        for bin in Self::bins(&ee.t_s, window.ee.clone(), width_s) {
            let half = self.half(ee.t_s[bin.start + bin.len() / 2]);
            let base = [0.0, 0.0, self.run.base_pose.as_ref().map_or(0.0, |p| heading(p, ee.t_s[bin.start]))];
            let jacobian = model.jacobian(&coordinates(base, self.motion.samples[half].q_rad.as_slice()));
            let jacobian = jacobian.fixed_columns::<MAX_LINKS>(3);
            let arm =
                jacobian * nalgebra::SMatrix::from_diagonal(&self.motion.variance[half][0]) * jacobian.transpose();
            for k in bin.clone() {
                for (i, sd) in sd.iter().enumerate() {
                    self.row(4 + i, ee.t_s[k], sd * sd + arm[(i, i)]);
                }
            }
            let n = bin.len() as f64;
            let covariance = Matrix3::from_fn(|i, j| arm[(i, j)] + if i == j { sd[i] * sd[i] / n } else { 0.0 });
            let Some(white) = covariance.cholesky().and_then(|c| c.l().try_inverse()) else { continue };
            for i in 0..3 {
                let rows = bin.clone().flat_map(|k| (0..=i).map(move |j| (k, j)));
                let at =
                    |(k, j): (usize, usize)| (first + 3 * (k - window.ee.start) as u32 + j as u32, white[(i, j)] / n);
                self.whitening.push(Whitened { channel: 4 + i, sum: rows.map(at).collect() });
            }
        }
    }

    fn torques(&mut self, window: &Window) {
        let Some(joints) = &self.run.joints else { return };
        let n = self.plant.link_count();
        let sensors = &self.plant.sensors;
        let (sensor, ampere) = (sensors.torque_n_m.max(1e-6), sensors.current_a.max(1e-9));
        for k in window.joints.clone() {
            let t_s = joints.t_s[k];
            let half = self.half(t_s);
            let physics = self.rollout.physics(t_s);
            let mass =
                self.rollout.model(t_s).mass_matrix(&coordinates([0.0; 3], self.motion.samples[half].q_rad.as_slice()));
            let inertia = free_inertia(&mass);
            let rates = &self.motion.variance[half][1];
            let accelerations = self.acceleration_variance(half);
            for joint in 0..n {
                let row: JointVector = inertia.column(joint).into_owned();
                let motion = row.component_mul(&row).dot(&accelerations);
                let (rate, rate_variance) = (self.motion.samples[half].qd_rad_s[joint], rates[joint]);
                let friction = &physics.joints[joint].friction;
                let unsure = 1.0 - direction(rate, rate_variance.sqrt()).powi(2);
                let dry = friction.coulomb_n_m.hypot(REST_FRICTION_N_M);
                let kt = physics.joints[joint].torque_constant_n_m_a;
                let current = (kt * ampere).powi(2)
                    + REST_ROWS * dry * dry * unsure
                    + friction.viscous_n_m_s_rad.powi(2) * rate_variance;
                let sensed = measured(&joints.torque_nm, joint, k).is_some();
                let driven = measured(&joints.current_a, joint, k).is_some();
                self.torque_rows(joint, n, t_s, [sensor * sensor, motion, current], [sensed, driven]);
            }
        }
    }

    /// What is not known of the joints' accelerations: what the smoother leaves, a share of their size, and where they change
    /// at once, all of the change, since nobody knows to the sample when a drive takes up its command.
    fn acceleration_variance(&self, half: usize) -> JointVector {
        let reach = (JUMP_S / (0.5 * STEP_S)).round() as usize;
        let near =
            &self.motion.acceleration[half.saturating_sub(reach)..(half + reach + 1).min(self.motion.samples.len())];
        JointVector::from_fn(|joint, _| {
            let values = near.iter().map(|a| a[joint]);
            let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            let own = self.motion.acceleration[half][joint];
            self.motion.variance[half][2][joint] + (high - low).powi(2) + (ACCELERATION_SHARE * own).powi(2)
        })
    }

    /// The rows of one joint at one time, from the variances of sensor, motion and current.
    fn torque_rows(&mut self, joint: usize, links: usize, t_s: f64, variances: [f64; 3], known: [bool; 2]) {
        let [sensor, motion, current] = variances;
        let (torque, driven) = (7 + joint, 7 + links + joint);
        match known {
            [true, true] => {
                let a = self.row(torque, t_s, sensor + motion);
                let b = self.row(driven, t_s, sensor + current);
                let covariance = Matrix2::new(sensor + motion, sensor, sensor, sensor + current);
                let Some(white) = covariance.cholesky().and_then(|c| c.l().try_inverse()) else { return };
                self.whitening.push(Whitened { channel: torque, sum: vec![(a, white[(0, 0)])] });
                self.whitening.push(Whitened { channel: driven, sum: vec![(a, white[(1, 0)]), (b, white[(1, 1)])] });
            }
            [true, false] => {
                let row = self.row(torque, t_s, sensor + motion);
                self.mean(torque, vec![row], (sensor + motion).sqrt());
            }
            [false, true] => {
                let row = self.row(driven, t_s, motion + current);
                self.mean(driven, vec![row], (motion + current).sqrt());
            }
            [false, false] => {}
        }
    }
}

fn pose_noise(plant: &Plant) -> [f64; 3] {
    let s = &plant.sensors;
    [s.mocap_position_m, s.mocap_position_m, s.mocap_angle_rad].map(|sd| sd.max(1e-6))
}

/// Median interval of the joints' telemetry, s.
fn telemetry_interval_s(run: &Run) -> f64 {
    let mut intervals: Vec<f64> =
        run.joints.as_ref().map_or_else(Vec::new, |j| j.t_s.windows(2).map(|w| w[1] - w[0]).collect());
    intervals.sort_by(f64::total_cmp);
    intervals.get(intervals.len() / 2).copied().unwrap_or(0.0)
}
