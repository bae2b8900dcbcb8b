//! What motion capture and gyro measured: blocks of samples, averaged, so that white noise stays white and the filter short.

use super::prediction::Motion;
use fss_experiments::measured::Run;
use fss_plant::{Physics, Plant, Stream};
use std::ops::Range;

/// Blocks that a run is cut into, if its sampling and its length allow, and bounds of their rate (Hz).
const BLOCKS: f64 = 800.0;
const BLOCK_RATE_HZ: [f64; 2] = [12.5, 60.0];

/// How much older samples are than their stamps say, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Ages {
    pub(super) pose_s: f64,
    pub(super) gyro_s: f64,
}

impl Ages {
    pub(super) fn of(physics: &Physics) -> Self {
        let age_s = |stream| physics.sensors.age_s(stream);
        Self { pose_s: age_s(Stream::BasePose), gyro_s: age_s(Stream::Gyro) }
    }
}

/// The samples of a run and the rows that they become.
pub(super) struct Samples {
    pose_t_s: Vec<f64>,
    poses: Vec<[f64; 3]>,
    gyro_t_s: Vec<f64>,
    /// Samples of each block: of motion capture, and of the gyro.
    blocks: Vec<(Range<usize>, Range<usize>)>,
    sd: [f64; 3],
    pub(super) measured: Vec<f64>,
    pub(super) channel_of_row: Vec<usize>,
    pub(super) channels: Vec<String>,
    pub(super) time_of_row: Vec<f64>,
    pub(super) noise_of_row: Vec<f64>,
}

impl Samples {
    pub(super) fn of(plant: &Plant, run: &Run) -> Option<Self> {
        let poses = run.base_pose.as_ref()?;
        let known =
            poses.t_s.iter().zip(&poses.values).filter(|(t, v)| t.is_finite() && v.iter().all(|x| x.is_finite()));
        let (pose_t_s, poses): (Vec<f64>, Vec<[f64; 3]>) = known.map(|(t, v)| (*t, *v)).unzip();
        let (first, last) = (*pose_t_s.first()?, *pose_t_s.last()?);
        if pose_t_s.len() < 4 || last <= first {
            return None;
        }
        let (gyro_t_s, rates): (Vec<f64>, Vec<f64>) = run.gyro.as_ref().map_or_else(Default::default, |g| {
            g.t_s.iter().zip(&g.values).filter(|(_, v)| v.is_finite()).map(|(t, v)| (*t, *v)).unzip()
        });
        let sensors = &plant.sensors;
        let mut samples = Self {
            blocks: blocks(&pose_t_s, &gyro_t_s),
            sd: [sensors.mocap_position_m, sensors.mocap_position_m, sensors.mocap_angle_rad].map(|sd| sd.max(1e-9)),
            pose_t_s,
            poses,
            gyro_t_s,
            measured: Vec::new(),
            channel_of_row: Vec::new(),
            channels: ["base_x", "base_y", "base_theta", "gyro"].map(str::to_owned).to_vec(),
            time_of_row: Vec::new(),
            noise_of_row: Vec::new(),
        };
        samples.measured = samples.averaged(|k| samples.poses[k], |k| rates[k]);
        let gyro_sd = sensors.gyro_rad_s.max(1e-9);
        for (block, (poses, gyro)) in samples.blocks.clone().iter().enumerate() {
            let t_s = samples.block_times()[block];
            let sd = samples.sd.map(|sd| sd / (poses.len() as f64).sqrt());
            let gyro = (!gyro.is_empty()).then(|| gyro_sd / (gyro.len() as f64).sqrt());
            for (channel, noise) in sd.into_iter().chain(gyro).enumerate() {
                samples.channel_of_row.push(channel);
                samples.time_of_row.push(t_s);
                samples.noise_of_row.push(noise);
            }
        }
        Some(samples)
    }

    pub(super) fn span_s(&self) -> (f64, f64) {
        (self.pose_t_s[0], self.pose_t_s[self.pose_t_s.len() - 1])
    }

    /// Mean time of each block's poses.
    pub(super) fn block_times(&self) -> Vec<f64> {
        self.blocks.iter().map(|(poses, _)| mean(&self.pose_t_s[poses.clone()])).collect()
    }

    pub(super) fn block_poses(&self) -> Vec<[f64; 3]> {
        let mean = |i: usize, range: &Range<usize>| {
            self.poses[range.clone()].iter().map(|p| p[i]).sum::<f64>() / range.len() as f64
        };
        self.blocks.iter().map(|(poses, _)| std::array::from_fn(|i| mean(i, poses))).collect()
    }

    /// Noise of a block's mean pose.
    pub(super) fn block_sd(&self) -> [f64; 3] {
        let per_block = self.poses.len() as f64 / self.blocks.len() as f64;
        self.sd.map(|sd| sd / per_block.sqrt())
    }

    /// Rows of each block: x, y, theta, and the gyro where it spoke.
    fn averaged(&self, pose: impl Fn(usize) -> [f64; 3], rate: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut rows = Vec::with_capacity(4 * self.blocks.len());
        for (poses, gyro) in &self.blocks {
            let mut sum = [0.0; 3];
            poses.clone().for_each(|k| sum.iter_mut().zip(pose(k)).for_each(|(s, p)| *s += p));
            rows.extend(sum.map(|s| s / poses.len() as f64));
            if !gyro.is_empty() {
                rows.push(gyro.clone().map(&rate).sum::<f64>() / gyro.len() as f64);
            }
        }
        rows
    }

    /// What the rows change by with a small motion, of pose and rate over time, that sensors of these ages show.
    pub(super) fn read_small(&self, ages: Ages, pose: impl Fn(f64) -> [f64; 3], rate: impl Fn(f64) -> f64) -> Vec<f64> {
        self.averaged(|k| pose(self.pose_t_s[k] - ages.pose_s), |k| rate(self.gyro_t_s[k] - ages.gyro_s))
    }

    /// The rows that a motion would give.
    pub(super) fn read(&self, motion: &Motion) -> Vec<f64> {
        let (sensors, ages) = (&motion.physics.sensors, Ages::of(&motion.physics));
        let pose = |k: usize| motion.pose_reading(self.pose_t_s[k] - ages.pose_s);
        let rate = |k: usize| sensors.gyro_reading(motion.rate(self.gyro_t_s[k] - ages.gyro_s));
        self.averaged(pose, rate)
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Cuts samples into blocks of equal counts, and the gyro's by the times at which these begin.
fn blocks(pose_t_s: &[f64], gyro_t_s: &[f64]) -> Vec<(Range<usize>, Range<usize>)> {
    let duration_s = pose_t_s[pose_t_s.len() - 1] - pose_t_s[0];
    let rate_hz = (BLOCKS / duration_s).clamp(BLOCK_RATE_HZ[0], BLOCK_RATE_HZ[1]);
    let per_block = ((pose_t_s.len() as f64 / duration_s / rate_hz).round() as usize).max(1);
    let mut out = Vec::new();
    let mut from_gyro = gyro_t_s.partition_point(|t| *t < pose_t_s[0]);
    let starts: Vec<usize> = (0..pose_t_s.len()).step_by(per_block).collect();
    for (i, start) in starts.iter().enumerate() {
        let end = starts.get(i + 1).copied().unwrap_or(pose_t_s.len());
        let until = pose_t_s.get(end).copied().unwrap_or(f64::INFINITY).min(pose_t_s[end - 1] + 2.0 / rate_hz);
        let to_gyro = gyro_t_s.partition_point(|t| *t < until);
        out.push((*start..end, from_gyro..to_gyro.max(from_gyro)));
        from_gyro = to_gyro.max(from_gyro);
    }
    out
}
