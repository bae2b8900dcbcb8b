//! What a small motion of the joints beside their path does to the base.

use super::carriage::{Carriage, Path, joints_only, rotated};
use super::samples::{Ages, Samples};
use crate::path::TimeGrid;
use fss_multibody::{JointVector, MAX_LINKS, ModelError, State};
use fss_plant::Physics;

/// Momentum stays: with H the angular momentum of a joint's unit rate about the centre of mass, I the locked inertia and c the
/// centre of mass in base axes, `d theta = -H/I dq`, `d pose = -d(R c)`.
pub(super) struct JointMotion {
    grid: TimeGrid,
    /// At each edge of the grid, for each joint: x m, y m and heading rad by an angle of 1 rad.
    slopes: Vec<Vec<[f64; 3]>>,
}

impl JointMotion {
    pub(super) fn new(physics: &Physics, grid: TimeGrid, path: &Path, carriage: &Carriage) -> Result<Self, ModelError> {
        let model = physics.model(0.0)?;
        let joints = physics.links.len().min(MAX_LINKS);
        let at = |k: usize, joint: usize| {
            let mut unit = JointVector::zeros();
            unit[joint] = 1.0;
            let q = joints_only(&carriage.samples[k].q_rad);
            let moving = model.momentum(&State { q, v: joints_only(&unit) });
            let turn = -moving.angular_about_com / carriage.inertia_kg_m2[k];
            let [dx, dy] = [moving.linear.x / carriage.mass_kg, moving.linear.y / carriage.mass_kg];
            let [dx, dy] = rotated(path.pose[k][2].sin_cos(), [dx, dy]);
            [-dx, -dy, turn]
        };
        let slopes = (0..path.pose.len()).map(|k| (0..joints).map(|joint| at(k, joint)).collect()).collect();
        Ok(Self { grid, slopes })
    }

    /// x m, y m and heading rad by an angle of a joint, and rate by its rate.
    pub(super) fn at(&self, t_s: f64, joint: usize) -> [f64; 3] {
        self.slopes[self.grid.locate(t_s).0][joint]
    }

    /// What the rows change by with a motion of the joints, angle and rate of each over time, that sensors of these ages show.
    pub(super) fn rows(&self, samples: &Samples, ages: Ages, motion: impl Fn(usize, f64) -> [f64; 2]) -> Vec<f64> {
        let joints = self.slopes[0].len();
        let pose = |t_s: f64| {
            let of = |joint: usize| self.at(t_s, joint).map(|slope| slope * motion(joint, t_s)[0]);
            (0..joints).map(of).fold([0.0; 3], |sum, own| std::array::from_fn(|i| sum[i] + own[i]))
        };
        let rate = |t_s: f64| (0..joints).map(|joint| self.at(t_s, joint)[2] * motion(joint, t_s)[1]).sum();
        samples.read_small(ages, pose, rate)
    }
}
