//! The measured path: what encoders and motion capture said, as functions of time.

use super::telemetry::{groups, is_driven, mean, unwrapped};
use super::track::{Track, quintic};
use crate::servo_response::{ARRIVAL_SD_S, Answers, Nodes, datagrams};
use fss_estimation::smoothing::{Reading, Smoother};
use fss_experiments::commands::Commands;
use fss_experiments::measured::{Joints, Many, Run};
use fss_multibody::JointVector;
use fss_plant::{Plant, Sensors};
use std::sync::OnceLock;

/// Spacing of a path's nodes, s. Between them it is a polynomial; nothing that moves a link is faster.
const NODE_S: f64 = 0.005;
/// Telemetry of arms that swing by their torques is averaged over this before it is smoothed, s.
const MERGE_S: f64 = 0.005;
/// Telemetry of arms in servo drives is, and motion capture, s: noise of the path's accelerations is in all sensitivities.
const SERVO_MERGE_S: f64 = 0.04;
/// Where noise is not stated: of a converter of 20 bits a turn and its difference, rad and rad/s.
const LEAST_ANGLE_SD: f64 = 6e-6;
const LEAST_RATE_SD: f64 = 6e-5;

/// Nodes of equal weight with the mean and the variance of an even distribution, in its standard deviations.
const ARRIVALS: [f64; 4] = [-1.38, -0.32, 0.32, 1.38];

/// What the sensors said of the motion.
#[derive(Clone, Debug)]
pub(super) struct MeasuredPath {
    /// Encoder readings of each joint over time of their stamps.
    pub(super) joints: Vec<Track>,
    /// Standard deviation of each smoothed encoder rate at the nodes, rad/s.
    rate_sd: Vec<Vec<f64>>,
    /// Whether the reference answers datagrams, each of which may arrive a little sooner or later.
    is_told_by_datagrams: bool,
    /// What each joint's encoder was to show: what the plant's servos make of the datagrams that they got, or the command, its mean
    /// lag taken off; `None` without commands.
    pub(super) reference: Option<Vec<Track>>,
    /// Motion capture of the base: x m, y m, theta rad; `None` where nothing was measured.
    pub(super) base: Option<[Track; 3]>,
    start_s: f64,
    nodes: usize,
    /// Standard deviations of the joints' rates at the times of the rows that this path serves, once they were asked for.
    rates_sd_at: OnceLock<Vec<JointVector>>,
}

impl MeasuredPath {
    /// The path of a plant's joints, whose telemetry is so much older than its stamps say, s; `None` where not every joint has an angle
    /// or a rate.
    pub(super) fn new((plant, ages_s): (&Plant, &[f64]), run: &Run, answers: &Answers) -> Option<Self> {
        let (links, sensors) = (plant.link_count(), &plant.sensors);
        let joints = run.joints.as_ref()?;
        let (start_s, end_s) = (*joints.t_s.first()?, *joints.t_s.last()?);
        if links == 0 || end_s.partial_cmp(&start_s) != Some(std::cmp::Ordering::Greater) {
            return None;
        }
        let nodes = ((end_s - start_s) / NODE_S).ceil() as usize + 1;
        let grid_s: Vec<f64> = (0..nodes).map(|k| start_s + NODE_S * k as f64).collect();
        let merge_s = if is_driven(run) { MERGE_S } else { SERVO_MERGE_S };
        let readings: Vec<Vec<Reading>> = (0..links).map(|i| readings(joints, i, sensors, merge_s)).collect();
        if readings.iter().any(Vec::is_empty) {
            return None;
        }
        let track = |nodes: Nodes| Track::new(start_s, NODE_S, nodes);
        let shown = |commands: &Commands| -> Option<Vec<Nodes>> {
            let of = |i: usize| {
                let times_s: Vec<f64> = grid_s.iter().map(|t_s| t_s - ages_s[i]).collect();
                Some(answers.response(plant, commands, &times_s).ok()?.nominal.swap_remove(i))
            };
            (0..links).map(of).collect()
        };
        let response = datagrams(plant, run).and_then(shown);
        let is_told_by_datagrams = response.is_some();
        let command = run.joint_command.as_ref().filter(|c| c.values.len() >= links && c.t_s.len() > 3);
        let follow = |c: &Many| (0..links).map(|i| followed(c, i, &readings[i], &grid_s)).collect();
        let expected: Option<Vec<Nodes>> = response.or_else(|| command.map(follow));
        let reference = expected.map(|joints| joints.into_iter().map(track).collect());
        let (joints, rate_sd) = (Vec::new(), Vec::new());
        let mut path = Self {
            joints,
            rate_sd,
            is_told_by_datagrams,
            reference,
            base: None,
            start_s,
            nodes,
            rates_sd_at: OnceLock::new(),
        };
        for (i, own) in readings.iter().enumerate() {
            path.add_joint(i, own, &grid_s);
        }
        path.base = base_track(run, sensors, &grid_s);
        Some(path)
    }

    fn add_joint(&mut self, joint: usize, readings: &[Reading], grid_s: &[f64]) {
        let reference = self.reference.as_ref().map(|joints| &joints[joint]);
        let at = |t: f64| reference.map_or([0.0; 3], |track| track.at(t));
        let deviations: Vec<Reading> = readings
            .iter()
            .map(|r| {
                let [q, qd, _] = at(r.t_s);
                Reading { angle: r.angle.map(|(v, n)| (v - q, n)), rate: r.rate.map(|(v, n)| (v - qd, n)), ..*r }
            })
            .collect();
        let smoother = Smoother::new(&deviations, grid_s);
        let sum = |(t, beside): (&f64, &[f64; 3])| {
            let expected = at(*t);
            std::array::from_fn(|i| expected[i] + beside[i])
        };
        let nodes = grid_s.iter().zip(&smoother.path(&deviations)).map(sum).collect();
        self.joints.push(Track::new(self.start_s, NODE_S, nodes));
        self.rate_sd.push(smoother.variances().iter().map(|v| v[1].sqrt()).collect());
    }

    /// Times of the nodes, s.
    pub(super) fn grid_s(&self) -> impl Iterator<Item = f64> + use<> {
        let start_s = self.start_s;
        (0..self.nodes).map(move |k| start_s + NODE_S * k as f64)
    }

    /// The node nearest to a time.
    fn node(&self, t_s: f64) -> usize {
        (((t_s - self.start_s) / NODE_S).round().max(0.0) as usize).min(self.nodes - 1)
    }

    /// A track on the nodes of this path.
    pub(super) fn track(&self, nodes: Vec<[f64; 3]>) -> Track {
        Track::new(self.start_s, NODE_S, nodes)
    }

    /// Spacing of the nodes, s.
    #[allow(clippy::unused_self)]
    pub(super) fn step_s(&self) -> f64 {
        NODE_S
    }

    /// Standard deviation of a joint's rate at `t_s`, rad/s: of the smoother, and of when datagrams arrive.
    pub(super) fn rate_sd(&self, joint: usize, t_s: f64) -> f64 {
        let smoothed = self.rate_sd[joint].get(self.node(t_s)).copied().unwrap_or(0.0);
        smoothed.hypot(self.arrivals_sd(joint, t_s)[0])
    }

    /// The same of all joints.
    pub(super) fn rates_sd(&self, t_s: f64) -> JointVector {
        let mut sd = JointVector::zeros();
        (0..self.joints.len()).for_each(|i| sd[i] = self.rate_sd(i, t_s));
        sd
    }

    /// The same at the times, s, of the rows that this path serves.
    pub(super) fn rates_sd_at(&self, times_s: &[f64]) -> &[JointVector] {
        self.rates_sd_at.get_or_init(|| times_s.iter().map(|t_s| self.rates_sd(*t_s)).collect())
    }

    /// How much of a joint's rate, rad/s, and acceleration at `t_s` hangs on when a datagram arrives, root mean square.
    pub(super) fn arrivals_sd(&self, joint: usize, t_s: f64) -> [f64; 2] {
        let Some(reference) = self.reference.as_ref().filter(|_| self.is_told_by_datagrams) else { return [0.0; 2] };
        let now = reference[joint].at(t_s);
        let others = ARRIVALS.map(|by| reference[joint].at(t_s + by * ARRIVAL_SD_S));
        let square = |k: usize| others.iter().map(|other| (other[k] - now[k]).powi(2)).sum::<f64>();
        [1, 2].map(|k| (square(k) / ARRIVALS.len() as f64).sqrt())
    }

    /// How far a joint's path is from the reference at `t_s`: angle, rate, acceleration. Zeros without one.
    pub(super) fn deviation(&self, joint: usize, t_s: f64) -> [f64; 3] {
        let Some(reference) = &self.reference else { return [0.0; 3] };
        let (path, reference) = (self.joints[joint].at(t_s), reference[joint].at(t_s));
        std::array::from_fn(|i| path[i] - reference[i])
    }
}

fn readings(joints: &Joints, joint: usize, sensors: &Sensors, merge_s: f64) -> Vec<Reading> {
    let angle = joints.q_rad.get(joint).map(|q| unwrapped(q));
    let rate = joints.qd_rad_s.get(joint);
    let angle_variance = sensors.encoder_rad.max(LEAST_ANGLE_SD).powi(2);
    let rate_variance = sensors.encoder_rate_rad_s.max(LEAST_RATE_SD).powi(2);
    let merged = |rows: std::ops::Range<usize>| Reading {
        t_s: mean(&joints.t_s, &rows).map_or(joints.t_s[rows.start], |m| m.0),
        angle: angle.as_ref().and_then(|q| mean(q, &rows)).map(|(v, n)| (v, angle_variance / n)),
        rate: rate.and_then(|qd| mean(qd, &rows)).map(|(v, n)| (v, rate_variance / n)),
    };
    let all = groups(&joints.t_s, merge_s).into_iter().map(merged);
    all.filter(|r| r.angle.is_some() || r.rate.is_some()).collect()
}

/// Longest lag of a servo behind its command that is looked for, s.
const LONGEST_LAG_S: f64 = 0.5;

/// What a servo makes of its command on the whole: the same, later by the lag that fits the run's angles in least squares.
fn followed(command: &Many, joint: usize, readings: &[Reading], grid_s: &[f64]) -> Vec<[f64; 3]> {
    // A command that rests says nothing of the lag: (1 mrad/s)2 a reading keep it at none.
    let (mut square, mut product) = (1e-6 * readings.len() as f64, 0.0);
    for reading in readings {
        let Some((angle, _)) = reading.angle else { continue };
        let [q, qd, _] = commanded(command, joint, reading.t_s);
        (square, product) = (square + qd * qd, product + qd * (q - angle));
    }
    let lag_s = (product / square).clamp(-LONGEST_LAG_S, LONGEST_LAG_S);
    grid_s.iter().map(|t| commanded(command, joint, t - lag_s)).collect()
}

/// A joint's command at `t_s`, smooth between its rows so that angle, rate and acceleration are of one motion; beyond its
/// rows it goes on as it was.
fn commanded(command: &Many, joint: usize, t_s: f64) -> [f64; 3] {
    let last = command.t_s.len() - 1;
    let or_zero = |value: Option<f64>| value.filter(|v| v.is_finite()).unwrap_or(0.0);
    let row = |k: usize| {
        let at_s = command.t_s[k];
        [
            or_zero(command.values[joint].get(k).copied()),
            or_zero(command.rate_at(joint, at_s)),
            or_zero(command.acceleration_at(joint, at_s)),
        ]
    };
    let after = command.t_s.partition_point(|t| *t <= t_s);
    if after == 0 || after > last {
        let k = if after == 0 { 0 } else { last };
        let [q, qd, _] = row(k);
        return [q + (t_s - command.t_s[k]) * qd, qd, 0.0];
    }
    let (from_s, to_s) = (command.t_s[after - 1], command.t_s[after]);
    quintic(&row(after - 1), &row(after), to_s - from_s, (t_s - from_s) / (to_s - from_s))
}

fn base_track(run: &Run, sensors: &Sensors, grid_s: &[f64]) -> Option<[Track; 3]> {
    let poses = run.base_pose.as_ref().filter(|p| p.t_s.len() > 1)?;
    let rows = groups(&poses.t_s, 0.5 * SERVO_MERGE_S);
    let track = |axis: usize| {
        let values: Vec<f64> = poses.values.iter().map(|v| v[axis]).collect();
        let values = if axis == 2 { unwrapped(&values) } else { values };
        let sd = if axis < 2 { sensors.mocap_position_m } else { sensors.mocap_angle_rad };
        let reading = |rows: &std::ops::Range<usize>| {
            let (value, count) = mean(&values, rows)?;
            let t_s = mean(&poses.t_s, rows)?.0;
            Some(Reading { t_s, angle: Some((value, sd.max(LEAST_ANGLE_SD).powi(2) / count)), rate: None })
        };
        let readings: Vec<Reading> = rows.iter().filter_map(reading).collect();
        let nodes = Smoother::new(&readings, grid_s).path(&readings);
        Track::new(grid_s.first().copied().unwrap_or(0.0), NODE_S, nodes)
    };
    Some([track(0), track(1), track(2)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_as_uncertain_as_what_it_changes_by_until_a_datagram_arrives() {
        let nodes = (0..100).map(|k| NODE_S * f64::from(k)).map(|t| [t * t, 2.0 * t, 2.0]).collect();
        let reference = Some(vec![Track::new(0.0, NODE_S, nodes)]);
        let rate_sd = vec![vec![0.003; 100]];
        let mut path = MeasuredPath {
            joints: Vec::new(),
            rate_sd,
            is_told_by_datagrams: true,
            reference,
            base: None,
            start_s: 0.0,
            nodes: 100,
            rates_sd_at: OnceLock::new(),
        };
        let by_arrival = 2.0 * ARRIVAL_SD_S;
        assert!((path.arrivals_sd(0, 0.2)[0] / by_arrival - 1.0).abs() < 0.01);
        assert!((path.rate_sd(0, 0.2) / by_arrival.hypot(0.003) - 1.0).abs() < 0.01);
        path.is_told_by_datagrams = false;
        assert_eq!((path.arrivals_sd(0, 0.2)[0], path.rate_sd(0, 0.2)), (0.0, 0.003));
    }
}
