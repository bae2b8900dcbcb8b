//! The measured path of a run: smooth motion of base and joints, from the sensors alone. No plant plays a part in it, so that
//! deviations from it stay small however large a fault is.

use crate::joint_telemetry::JointTelemetry;
use crate::servo_response::{Answers, Nodes, Response, datagrams};
use fss_estimation::smoothing::{Reading, Smoother};
use fss_experiments::measured::{Many, Run};
use fss_multibody::{JointVector, MAX_LINKS};
use fss_plant::{Physics, Plant, Sensors, Stream};

/// Times at equal distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TimeGrid {
    pub(crate) start_s: f64,
    pub(crate) step_s: f64,
    /// Number of cells; there is one edge more.
    pub(crate) cells: usize,
}

impl TimeGrid {
    pub(crate) fn over(from_s: f64, to_s: f64, step_s: f64) -> Self {
        Self { start_s: from_s, step_s, cells: ((to_s - from_s) / step_s).ceil().max(1.0) as usize }
    }

    pub(crate) fn edge_s(&self, k: usize) -> f64 {
        self.start_s + k as f64 * self.step_s
    }

    pub(crate) fn edges_s(&self) -> Vec<f64> {
        (0..=self.cells).map(|k| self.edge_s(k)).collect()
    }

    /// The edge next to a time.
    pub(crate) fn nearest(&self, t_s: f64) -> usize {
        ((t_s - self.start_s) / self.step_s).round().clamp(0.0, self.cells as f64) as usize
    }

    /// Cell that holds a time, and how far into it, s; outside, the first or last cell goes on.
    pub(crate) fn locate(&self, t_s: f64) -> (usize, f64) {
        let cell = ((t_s - self.start_s) / self.step_s).floor().clamp(0.0, self.cells as f64 - 1.0) as usize;
        (cell, t_s - self.edge_s(cell))
    }

    /// Angle and rate at a time between edges, linear.
    pub(crate) fn between(&self, nodes: &[[f64; 3]], t_s: f64) -> [f64; 2] {
        let (k, into_s) = self.locate(t_s);
        let (from, to, share) = (nodes[k], nodes[k + 1], into_s / self.step_s);
        std::array::from_fn(|i| from[i] + share * (to[i] - from[i]))
    }
}

/// Pose and velocity as motion capture showed them, at the edges of a grid: m, m, rad, and per second.
#[derive(Clone, Debug)]
pub(crate) struct PosePath {
    pub(crate) grid: TimeGrid,
    pub(crate) pose: Vec<[f64; 3]>,
    pub(crate) velocity: Vec<[f64; 3]>,
    /// Standard deviations of each axis' pose and velocity.
    pub(crate) sd: Vec<[[f64; 2]; 3]>,
}

impl PosePath {
    /// Smooths blocks of samples: their times, means, and the standard deviations of these.
    pub(crate) fn smoothed(t_s: &[f64], values: &[[f64; 3]], sd: [f64; 3], grid: TimeGrid) -> Self {
        let edges = grid.edges_s();
        let middle: [f64; 3] = std::array::from_fn(|i| values.iter().map(|v| v[i]).sum::<f64>() / values.len() as f64);
        let axes: [(Nodes, Nodes); 3] = std::array::from_fn(|i| {
            let row = |(t, v): (&f64, &[f64; 3])| Reading {
                t_s: *t,
                angle: Some((v[i] - middle[i], sd[i] * sd[i])),
                rate: None,
            };
            let rows: Vec<Reading> = t_s.iter().zip(values).map(row).collect();
            let smoother = Smoother::new(&rows, &edges);
            (smoother.path(&rows), smoother.variances())
        });
        let at = |derivative: usize, offset: [f64; 3]| {
            (0..edges.len()).map(|k| std::array::from_fn(|i| axes[i].0[k][derivative] + offset[i])).collect()
        };
        let sd = |k: usize| std::array::from_fn(|i| [0, 1].map(|derivative| axes[i].1[k][derivative].sqrt()));
        let sd = (0..edges.len()).map(sd).collect();
        Self { grid, pose: at(0, middle), velocity: at(1, [0.0; 3]), sd }
    }

    /// Pose and velocity at a time; beyond the ends the motion goes on evenly.
    pub(crate) fn at(&self, t_s: f64) -> ([f64; 3], [f64; 3]) {
        let (k, into_s) = self.grid.locate(t_s);
        let share = (into_s / self.grid.step_s).clamp(0.0, 1.0);
        let velocity: [f64; 3] =
            std::array::from_fn(|i| self.velocity[k][i] + share * (self.velocity[k + 1][i] - self.velocity[k][i]));
        let beyond_s = into_s - share * self.grid.step_s;
        let pose = std::array::from_fn(|i| {
            self.pose[k][i] + share * (self.pose[k + 1][i] - self.pose[k][i]) + beyond_s * velocity[i]
        });
        (pose, velocity)
    }

    /// The motion of the base that these sensors show in this way: the inverse of their reading.
    pub(crate) fn unread(&self, physics: &Physics) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
        let sensors = &physics.sensors;
        let age_s = sensors.age_s(Stream::BasePose);
        let (sin, cos) = sensors.mocap_rotation_rad.sin_cos();
        let [mx, my] = sensors.marker_offset_m;
        (0..self.pose.len())
            .map(|k| {
                let (read, rate) =
                    if age_s == 0.0 { (self.pose[k], self.velocity[k]) } else { self.at(self.grid.edge_s(k) + age_s) };
                let theta = read[2] - sensors.mocap_rotation_rad - sensors.marker_yaw_rad;
                let (s, c) = theta.sin_cos();
                let marker = [c * mx - s * my, s * mx + c * my];
                let back = |v: [f64; 3]| [cos * v[0] + sin * v[1], -sin * v[0] + cos * v[1]];
                let (place, speed) = (back(read), back(rate));
                let pose = [place[0] - marker[0], place[1] - marker[1], theta];
                let velocity = [speed[0] + rate[2] * marker[1], speed[1] - rate[2] * marker[0], rate[2]];
                (pose, velocity)
            })
            .unzip()
    }
}

/// Encoder angles and rates as telemetry and commands tell them, at the edges of a grid: rad, rad/s.
#[derive(Clone, Debug)]
pub(crate) struct EncoderPath {
    pub(crate) grid: TimeGrid,
    pub(crate) angle: Vec<JointVector>,
    pub(crate) rate: Vec<JointVector>,
    /// Standard deviations of both, as the smoother gives them.
    pub(crate) angle_sd: Vec<JointVector>,
    pub(crate) rate_sd: Vec<JointVector>,
    /// What the plant's servos make of the datagrams; `None` without any.
    pub(crate) response: Option<Response>,
    /// What telemetry told of each joint beside that; `None` without telemetry.
    telemetry: Vec<Option<JointTelemetry>>,
    /// Whether a joint was told to move that nobody measured.
    pub(crate) moves_unseen: bool,
}

impl EncoderPath {
    /// Between two reports a joint deviates smoothly from what it follows; without reports it follows that.
    /// What it follows is what the plant's servos make of the datagrams that they got, or where there are none the command, the
    /// servo's mean lag taken off.
    /// Telemetry shows it late by each link's age, s, which smoothing a motion that it does not show would mistake for another motion.
    pub(crate) fn smoothed(run: &Run, (plant, ages_s): (&Plant, &[f64]), grid: TimeGrid, answers: &Answers) -> Self {
        let edges = grid.edges_s();
        let response = datagrams(plant, run).and_then(|c| answers.response(plant, c, &edges).ok());
        let (sensors, joints) = (&plant.sensors, plant.link_count());
        let zeros = vec![JointVector::zeros(); edges.len()];
        let mut path = Self {
            grid,
            angle: zeros.clone(),
            rate: zeros.clone(),
            angle_sd: zeros.clone(),
            rate_sd: zeros,
            response,
            telemetry: Vec::new(),
            moves_unseen: false,
        };
        for joint in 0..joints.min(MAX_LINKS) {
            let told = |t: f64| run.joint_command.as_ref().and_then(|c| command_at(c, joint, t)).unwrap_or([0.0; 2]);
            let simulated = path.response.as_ref().map(|response| &response.nominal[joint]);
            let lag_s = if simulated.is_some() { 0.0 } else { servo_lag_s(run, joint, &told) };
            let age_s = ages_s[joint];
            let command = |t: f64| simulated.map_or_else(|| told(t - lag_s), |nodes| grid.between(nodes, t - age_s));
            let telemetry = JointTelemetry::new(reports(run, joint, sensors, &command), &edges);
            let beside = telemetry.as_ref().map(|t| (t.path(), t.variances()));
            for (k, t) in edges.iter().enumerate() {
                let told = command(*t);
                let (deviation, variance) = beside.as_ref().map_or(([0.0; 3], [0.0; 3]), |(d, v)| (d[k], v[k]));
                path.angle[k][joint] = told[0] + deviation[0];
                path.rate[k][joint] = told[1] + deviation[1];
                let swings = path.response.as_ref().and_then(|r| r.swings.as_ref());
                let swing_sd = swings.map_or([0.0; 2], |swings| swings[joint].sd[k]);
                path.angle_sd[k][joint] = variance[0].sqrt().hypot(swing_sd[0]);
                path.rate_sd[k][joint] = variance[1].sqrt().hypot(swing_sd[1]);
            }
            if telemetry.is_none() {
                let told = edges.iter().map(|t| command(*t)[0]);
                let (lower, upper) = told.fold((f64::MAX, f64::MIN), |(l, u), q| (l.min(q), u.max(q)));
                path.moves_unseen |= upper - lower > RESTS_RAD;
            }
            path.telemetry.push(telemetry);
        }
        path
    }

    /// What of a change of a joint's motion, at the edges, telemetry does not show between its rows.
    pub(crate) fn unseen(&self, joint: usize, change: &Nodes) -> Nodes {
        match &self.telemetry[joint] {
            Some(telemetry) => telemetry.unseen(change, |t_s| self.grid.between(change, t_s)),
            None => change.clone(),
        }
    }

    /// Angles and rates of the links that these encoders and drives show in this way.
    pub(crate) fn unread(&self, physics: &Physics) -> (Vec<JointVector>, Vec<JointVector>) {
        let (mut angle, mut rate) = (self.angle.clone(), self.rate.clone());
        for (i, joint) in physics.joints.iter().enumerate().take(MAX_LINKS) {
            let shift = physics.sensors.link_age_s(i) / self.grid.step_s;
            for k in 0..angle.len() {
                let read = |series: &[JointVector]| interpolated(series, k as f64 + shift, i);
                let motor = (read(&self.angle) - joint.encoder_offset_rad) / joint.encoder_scale;
                let motor_rate = read(&self.rate) / joint.encoder_scale;
                let link = motor + joint.kinematic_error_rad * (joint.kinematic_cycles * motor).sin();
                angle[k][i] = link;
                rate[k][i] = motor_rate / joint.gear_ratio(link);
            }
        }
        (angle, rate)
    }
}

fn interpolated(series: &[JointVector], at: f64, joint: usize) -> f64 {
    let last = series.len() - 1;
    let at = at.clamp(0.0, last as f64);
    let k = (at.floor() as usize).min(last.saturating_sub(1));
    let next = (k + 1).min(last);
    series[k][joint] + (at - k as f64) * (series[next][joint] - series[k][joint])
}

fn reports(run: &Run, joint: usize, sensors: &Sensors, command: &dyn Fn(f64) -> [f64; 2]) -> Vec<Reading> {
    let Some(joints) = &run.joints else { return Vec::new() };
    let step_rad = sensors.encoder_step_rad / 12.0_f64.sqrt();
    let variances =
        [sensors.encoder_rad.hypot(step_rad).max(1e-7), sensors.encoder_rate_rad_s.max(1e-7)].map(|s| s * s);
    let value = |all: &[Vec<f64>], k: usize| all.get(joint).and_then(|v| v.get(k)).copied().filter(|v| v.is_finite());
    let rows = joints.t_s.iter().enumerate().map(|(k, t)| {
        let [angle, rate] = command(*t);
        let angle = value(&joints.q_rad, k).map(|q| (q - angle, variances[0]));
        Reading { t_s: *t, angle, rate: value(&joints.qd_rad_s, k).map(|v| (v - rate, variances[1])) }
    });
    rows.filter(|r| r.angle.is_some() || r.rate.is_some()).collect()
}

/// A joint that is told to move less than this rests (rad).
const RESTS_RAD: f64 = 1e-3;
/// Longest lag of a servo behind its command (s).
const LONGEST_LAG_S: f64 = 0.5;

/// The constant lag at which a joint follows its command best: least squares of the reported angles, by Gauss-Newton steps.
fn servo_lag_s(run: &Run, joint: usize, command: &dyn Fn(f64) -> [f64; 2]) -> f64 {
    let Some(joints) = &run.joints else { return 0.0 };
    let Some(angles) = joints.q_rad.get(joint) else { return 0.0 };
    let mut lag_s: f64 = 0.0;
    for _ in 0..3 {
        let rows = joints.t_s.iter().zip(angles).filter(|(_, q)| q.is_finite());
        // An angle that is off by a constant is no lag: both are fitted.
        let (mut n, mut sums) = (0.0, [0.0; 4]);
        for (t, q) in rows {
            let [angle, rate] = command(t - lag_s);
            let behind = angle - q;
            n += 1.0;
            [rate, behind, rate * rate, rate * behind].iter().zip(&mut sums).for_each(|(v, s)| *s += v);
        }
        let [rate, behind, square, product] = sums;
        let spread = square - rate * rate / n;
        if n < 4.0 || spread <= 1e-9 {
            return 0.0;
        }
        lag_s = (lag_s + (product - rate * behind / n) / spread).clamp(-LONGEST_LAG_S, LONGEST_LAG_S);
    }
    lag_s
}

/// A commanded angle and its rate: cubic between rows, whose rates are those of a parabola through their neighbours.
fn command_at(command: &Many, joint: usize, t_s: f64) -> Option<[f64; 2]> {
    let (times, values) = (&command.t_s, command.values.get(joint)?);
    let after = times.partition_point(|t| *t <= t_s);
    if after == 0 || after >= times.len() {
        // A record ends while the motion goes on: for an interval more, then the command is taken to hold.
        let end = if after == 0 { 0 } else { times.len() - 1 };
        let beyond = t_s - times[end];
        let interval = (times.last()? - times.first()?) / times.len().saturating_sub(1).max(1) as f64;
        let rate = command.rate_at(joint, times[end]).unwrap_or(0.0);
        let moves = if beyond.abs() < interval { rate } else { 0.0 };
        return Some([values[end] + rate * beyond.clamp(-interval, interval), moves]);
    }
    let (t0, t1) = (times[after - 1], times[after]);
    let (h, u) = (t1 - t0, (t_s - t0) / (t1 - t0));
    let (p0, p1) = (values[after - 1], values[after]);
    let (m0, m1) = (command.rate_at(joint, t0)? * h, command.rate_at(joint, t1)? * h);
    let (u2, u3) = (u * u, u * u * u);
    let angle =
        (2.0 * u3 - 3.0 * u2 + 1.0) * p0 + (u3 - 2.0 * u2 + u) * m0 + (3.0 * u2 - 2.0 * u3) * p1 + (u3 - u2) * m1;
    let slope = (6.0 * u2 - 6.0 * u) * (p0 - p1) + (3.0 * u2 - 4.0 * u + 1.0) * m0 + (3.0 * u2 - 2.0 * u) * m1;
    Some([angle, slope / h])
}
