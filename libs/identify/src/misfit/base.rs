//! A floating base: prescribed joints, momentum, thrust, a fitted initial state.

use super::geometry::Geometry;
use super::{ChannelMisfit, Gathered};
use crate::measured::{Poses, Run};
use crate::smoother::{Measurement, Noise, smooth};
use fss_multibody::{Coordinates, JointVector, Model, ModelError};
use fss_plant::{BaseSample, Grid, JointSample, Plant, Rollout, ValveHistory};
use nalgebra::{SMatrix, SVector};

/// Step of the simulation, s; joints are sampled at half of it.
const STEP_S: f64 = 0.01;
/// Rounds of Gauss-Newton: the problem is nearly linear.
const ROUNDS: usize = 3;
/// A window with fewer poses cannot hold an initial state of six numbers and say anything.
const FEWEST_POSES: usize = 12;

type Initial = SVector<f64, 6>;

/// The misfit of the base's pose, the gyro and the end-effector's pose.
pub(super) fn misfit(plant: &Plant, run: &Run, window_s: f64) -> Result<Vec<ChannelMisfit>, ModelError> {
    let Some(poses) = run.base_pose.as_ref().filter(|poses| poses.t_s.len() >= FEWEST_POSES) else {
        return Ok(Vec::new());
    };
    let simulator = Simulator::new(plant, run, poses)?;
    let names = ["base_x", "base_y", "base_theta", "gyro", "ee_x", "ee_y", "ee_theta"];
    let mut gathered: [Gathered; 7] = Default::default();
    let mut geometry = Geometry::new(plant);
    let mut from = 0;
    while from < poses.t_s.len() {
        let to = poses.t_s.partition_point(|t| *t < poses.t_s[from] + window_s);
        if to - from >= FEWEST_POSES {
            simulator.window(from, to, &mut gathered, &mut geometry);
        }
        from = to;
    }
    for (t_s, error, variance) in geometry.unexplained() {
        for i in 0..3 {
            gathered[4 + i].add(t_s, error[i], variance[i]);
        }
    }
    Ok(gathered.into_iter().zip(names).filter_map(|(g, name)| g.finish(&run.name, name)).collect())
}

/// What all windows of a run share.
struct Simulator<'a> {
    run: &'a Run,
    poses: &'a Poses,
    rollout: Rollout,
    model: Model,
    valves: ValveHistory,
    noise: [f64; 3],
    gyro_noise: f64,
    start_s: f64,
    /// Joint motion from `start_s` on, every half step.
    joints: Vec<JointSample>,
    /// Variances of its angles and rates.
    variances: Vec<[JointVector; 2]>,
}

impl<'a> Simulator<'a> {
    fn new(plant: &Plant, run: &'a Run, poses: &'a Poses) -> Result<Self, ModelError> {
        let rollout = Rollout::new(plant)?;
        let model = rollout.physics(0.0).model(0.0)?;
        let start_s = poses.t_s[0];
        let last_s = poses.t_s[poses.t_s.len() - 1];
        let halves = (2.0 * (last_s - start_s) / STEP_S).ceil() as usize + 4;
        let grid_s: Vec<f64> = (0..halves).map(|k| start_s + 0.5 * STEP_S * k as f64).collect();
        let s = &plant.sensors;
        let (joints, variances) = joint_motion(plant, run, &grid_s).into_iter().unzip();
        Ok(Self {
            run,
            poses,
            rollout,
            model,
            valves: ValveHistory::new(run.valves.clone()),
            noise: [s.mocap_position_m, s.mocap_position_m, s.mocap_angle_rad].map(|sd| sd.max(1e-6)),
            gyro_noise: s.gyro_rad_s,
            start_s,
            joints,
            variances,
        })
    }

    /// Fits the initial state of the poses `from..to` and gathers what is left.
    fn window(&self, from: usize, to: usize, gathered: &mut [Gathered; 7], geometry: &mut Geometry) {
        // The grid of a window begins on the run's grid, at or before its first pose.
        let first_step = ((self.poses.t_s[from] - self.start_s) / STEP_S + 1e-6).floor() as usize;
        let start_s = self.start_s + first_step as f64 * STEP_S;
        let steps = ((self.poses.t_s[to - 1] - start_s) / STEP_S).ceil() as usize + 1;
        let grid = Grid { start_s, step_s: STEP_S, steps };
        let joints = &self.joints[(2 * first_step).min(self.joints.len())..];
        let thrust = self.rollout.thrust(&self.valves, &grid, joints);
        let fly = |x: &Initial| {
            let start = BaseSample { t_s: start_s, pose: [x[0], x[1], x[2]], velocity: [x[3], x[4], x[5]] };
            let mut out = vec![start; steps + 1];
            self.rollout.run(&start, &grid, joints, &thrust, &mut out);
            out
        };
        let residuals = |out: &[BaseSample]| -> Vec<f64> {
            (from..to)
                .flat_map(|k| {
                    let simulated = sample(out, start_s, self.poses.t_s[k]).pose;
                    (0..3).map(move |i| (self.poses.values[k][i] - simulated[i]) / self.noise[i])
                })
                .collect()
        };
        let [x, y, theta] = self.poses.values[from];
        let (vx, vy, omega) = first_velocity(self.poses, from, to);
        let Some(motion) = fit(Initial::from([x, y, theta, vx, vy, omega]), &fly, &residuals) else { return };
        self.gather(from, to, start_s, &motion, gathered);
        self.gather_end_effector(from, to, start_s, &motion, geometry);
    }

    fn gather(&self, from: usize, to: usize, start_s: f64, motion: &[BaseSample], gathered: &mut [Gathered; 7]) {
        for k in from..to {
            let t_s = self.poses.t_s[k];
            let simulated = sample(motion, start_s, t_s).pose;
            for i in 0..3 {
                gathered[i].add(t_s, self.poses.values[k][i] - simulated[i], self.noise[i].powi(2));
            }
        }
        // The fit has taken six degrees of freedom, two from each coordinate.
        for channel in &mut gathered[..3] {
            channel.freedom -= 2.0;
        }
        let (first_s, last_s) = (self.poses.t_s[from], self.poses.t_s[to - 1]);
        let within = |t: &[f64]| t.partition_point(|t| *t < first_s)..t.partition_point(|t| *t <= last_s);
        if let Some(gyro) = &self.run.gyro {
            for k in within(&gyro.t_s) {
                let t_s = gyro.t_s[k];
                let base = sample(motion, start_s, t_s);
                let variance = self.gyro_noise.powi(2) + self.rate_variance(base.pose, t_s);
                gathered[3].add(t_s, gyro.values[k] - base.velocity[2], variance);
            }
        }
    }

    fn gather_end_effector(
        &self,
        from: usize,
        to: usize,
        start_s: f64,
        motion: &[BaseSample],
        geometry: &mut Geometry,
    ) {
        let Some(ee) = self.run.ee_pose.as_ref().filter(|_| self.model.link_count() > 0) else { return };
        let (first_s, last_s) = (self.poses.t_s[from], self.poses.t_s[to - 1]);
        for k in ee.t_s.partition_point(|t| *t < first_s)..ee.t_s.partition_point(|t| *t <= last_s) {
            let t_s = ee.t_s[k];
            let (q, [angles, _]) = self.configuration(sample(motion, start_s, t_s).pose, t_s);
            let simulated = self.model.end_effector(&q);
            let turn = ee.values[k][2] - simulated[2];
            let error = [ee.values[k][0] - simulated[0], ee.values[k][1] - simulated[1], turn.sin().atan2(turn.cos())];
            // What not knowing the joint angles leaves of the pose.
            let jacobian = self.model.jacobian(&q);
            let joints = jacobian.fixed_columns::<{ fss_multibody::MAX_LINKS }>(3);
            let variance = joints.component_mul(&joints) * angles;
            let variance = std::array::from_fn(|i| self.noise[i].powi(2) + variance[i]);
            geometry.add(&self.model, &q, t_s, error, variance);
        }
    }

    /// Configuration at a time, and the variances of joint angles and rates then.
    fn configuration(&self, base: [f64; 3], t_s: f64) -> (Coordinates, [JointVector; 2]) {
        let half = ((t_s - self.start_s) / (0.5 * STEP_S)).round().max(0.0) as usize;
        let half = half.min(self.joints.len() - 1);
        let mut q = Coordinates::zeros();
        q.fixed_rows_mut::<3>(0).copy_from_slice(&base);
        q.fixed_rows_mut::<{ fss_multibody::MAX_LINKS }>(3).copy_from(&self.joints[half].q_rad);
        (q, self.variances[half])
    }

    /// Variance of the base's rate that not knowing the joint rates leaves, rad2/s2.
    fn rate_variance(&self, base: [f64; 3], t_s: f64) -> f64 {
        let (q, [_, rates]) = self.configuration(base, t_s);
        self.model.reaction_vector(&q).component_mul(&self.model.reaction_vector(&q)).dot(&rates)
    }
}

/// The motion at the least-squares initial state, by Gauss-Newton with differences; `None` where it is not determined.
fn fit(
    mut x: Initial,
    fly: &impl Fn(&Initial) -> Vec<BaseSample>,
    residuals: &impl Fn(&[BaseSample]) -> Vec<f64>,
) -> Option<Vec<BaseSample>> {
    const STEP: f64 = 1e-6;
    let mut motion = fly(&x);
    for _ in 0..ROUNDS {
        let now = residuals(&motion);
        let columns: Vec<Vec<f64>> = (0..6)
            .map(|i| {
                let mut moved = x;
                moved[i] += STEP;
                residuals(&fly(&moved)).iter().zip(&now).map(|(a, b)| (a - b) / STEP).collect()
            })
            .collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let normal = SMatrix::<f64, 6, 6>::from_fn(|i, j| dot(&columns[i], &columns[j]));
        let right = Initial::from_fn(|i, _| dot(&columns[i], &now));
        x -= normal.cholesky()?.solve(&right);
        motion = fly(&x);
    }
    x.iter().all(|v| v.is_finite()).then_some(motion)
}

/// The simulated motion at a time, linear between steps.
fn sample(motion: &[BaseSample], start_s: f64, t_s: f64) -> BaseSample {
    let at = ((t_s - start_s) / STEP_S).clamp(0.0, (motion.len() - 1) as f64);
    let before = at.floor() as usize;
    let after = (before + 1).min(motion.len() - 1);
    let (a, b, share) = (&motion[before], &motion[after], at - before as f64);
    let mix = |x: &[f64; 3], y: &[f64; 3]| std::array::from_fn(|i| x[i] + share * (y[i] - x[i]));
    BaseSample { t_s, pose: mix(&a.pose, &b.pose), velocity: mix(&a.velocity, &b.velocity) }
}

/// A first guess of the velocity, from the first poses of a window.
fn first_velocity(poses: &Poses, from: usize, to: usize) -> (f64, f64, f64) {
    let later = (from + 10).min(to - 1);
    let dt = poses.t_s[later] - poses.t_s[from];
    let rate = |i: usize| if dt > 0.0 { (poses.values[later][i] - poses.values[from][i]) / dt } else { 0.0 };
    (rate(0), rate(1), rate(2))
}

/// Joint angles and rates on the grid, with their variances: the command, and the smoothed deviation that telemetry shows
/// from it.
fn joint_motion(plant: &Plant, run: &Run, grid_s: &[f64]) -> Vec<(JointSample, [JointVector; 2])> {
    let at_rest = JointSample { q_rad: JointVector::zeros(), qd_rad_s: JointVector::zeros() };
    let mut motion = vec![(at_rest, [JointVector::zeros(); 2]); grid_s.len()];
    let noise = Noise { angle: plant.sensors.encoder_rad.max(1e-6), rate: plant.sensors.encoder_rate_rad_s.max(1e-5) };
    for joint in 0..plant.link_count() {
        let command = |t: f64| run.joint_command.as_ref().and_then(|c| Some((c.at(joint, t)?, c.rate_at(joint, t)?)));
        let deviation = smooth(&measurements(run, joint, &command), noise, grid_s);
        for (((sample, variances), &t_s), deviation) in motion.iter_mut().zip(grid_s).zip(deviation) {
            let (q, qd) = command(t_s).unwrap_or((0.0, 0.0));
            sample.q_rad[joint] = q + deviation.angle;
            sample.qd_rad_s[joint] = qd + deviation.rate;
            variances[0][joint] = deviation.angle_variance;
            variances[1][joint] = deviation.rate_variance;
        }
    }
    motion
}

fn measurements(run: &Run, joint: usize, command: &impl Fn(f64) -> Option<(f64, f64)>) -> Vec<Measurement> {
    let Some(joints) = &run.joints else { return Vec::new() };
    let angle = joints.q_rad.get(joint);
    let rate = joints.qd_rad_s.get(joint);
    let at = |k: usize| {
        let t_s = joints.t_s[k];
        let (q, qd) = command(t_s).unwrap_or((0.0, 0.0));
        Measurement { t_s, angle: angle.map(|v| v[k] - q), rate: rate.map(|v| v[k] - qd) }
    };
    (0..joints.t_s.len()).map(at).collect()
}
