//! Datagrams that arrive earlier or later than they are taken to, and what this does to the base.

use super::joint_motion::JointMotion;
use super::prediction::Predictor;
use crate::servo_response::{ARRIVAL_SD_S, Nodes};
use fss_plant::Plant;

/// A displacement of the base below this share of its sensors' noise is left out.
const UNNOTICED: f64 = 0.05;

/// A joint's datagrams arrive earlier or later than they are taken to: by u standard deviations, an Ornstein-Uhlenbeck process. A servo
/// whose commanded motion begins later is displaced along it, by x: x' = (u - x) g, with g the gain of the position loop.
#[derive(Clone)]
pub(super) struct Arrivals {
    /// Correlation time of u (s), and 1/g (s).
    pub(super) time_s: f64,
    pub(super) lag_s: f64,
    /// By what a displacement of one standard deviation of the arrival moves the base, at each block: x m, y m and heading rad.
    pub(super) moved: Vec<[f64; 3]>,
}

impl Arrivals {
    /// What later datagrams do at each block, of each joint by which the base moves noticeably beside the sensors' `noise`: m, m, rad.
    pub(super) fn of_joints(
        plant: &Plant,
        time_s: f64,
        predictor: &Predictor,
        beside: &JointMotion,
        (times, noise): (&[f64], [f64; 3]),
    ) -> Vec<Self> {
        let Some(response) = &predictor.encoders.response else { return Vec::new() };
        let of_joint = |(joint, nodes): (usize, &Nodes)| {
            let moved = |t_s: &f64| {
                let late_rad = predictor.encoders.grid.between(nodes, *t_s)[1] * ARRIVAL_SD_S;
                beside.at(*t_s, joint).map(|slope| slope * late_rad)
            };
            let lag_s = 1.0 / plant.servo(joint).position_gain_1_s.max(1e-3);
            Self { time_s, lag_s, moved: times.iter().map(moved).collect() }
        };
        let is_noticed = |own: &Self| {
            own.moved.iter().any(|moved| moved.iter().zip(noise).any(|(by, sd)| by.abs() > UNNOTICED * sd))
        };
        response.nominal.iter().enumerate().map(of_joint).filter(is_noticed).collect()
    }

    /// Stationary covariance of u and x.
    pub(super) fn stationary(&self) -> [[f64; 2]; 2] {
        let shared = self.time_s / (self.time_s + self.lag_s);
        [[1.0, shared], [shared, shared]]
    }

    /// Transition and covariance of the noise over a time.
    pub(super) fn step(&self, dt: f64) -> ([[f64; 2]; 2], [[f64; 2]; 2]) {
        let (u, x) = ((-dt / self.time_s).exp(), (-dt / self.lag_s).exp());
        let gap = 1.0 / self.lag_s - 1.0 / self.time_s;
        // (u - x)/gap, whose limit at equal times is dt x.
        let pulled = if (gap * dt).abs() < 1e-6 { dt * x } else { (u - x) / gap } / self.lag_s;
        let (f, p) = ([[u, 0.0], [pulled, x]], self.stationary());
        let carried = |i: usize, j: usize| -> f64 {
            (0..2).flat_map(|k| (0..2).map(move |l| (k, l))).map(|(k, l)| f[i][k] * p[k][l] * f[j][l]).sum()
        };
        (f, std::array::from_fn(|i| std::array::from_fn(|j| p[i][j] - carried(i, j))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_steps_are_as_good_as_one_and_the_process_is_stationary() {
        let arrivals = Arrivals { time_s: 0.1, lag_s: 0.125, moved: Vec::new() };
        let ((f1, q1), (f2, q2), (whole, noise)) = (arrivals.step(0.05), arrivals.step(0.12), arrivals.step(0.17));
        let p = arrivals.stationary();
        let sandwich = |f: &[[f64; 2]; 2], q: &[[f64; 2]; 2], i: usize, j: usize| -> f64 {
            (0..4).map(|n| f[i][n / 2] * q[n / 2][n % 2] * f[j][n % 2]).sum()
        };
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let product: f64 = (0..2).map(|k| f2[i][k] * f1[k][j]).sum();
            assert!((product - whole[i][j]).abs() < 1e-12);
            assert!((sandwich(&f2, &q1, i, j) + q2[i][j] - noise[i][j]).abs() < 1e-12);
            assert!((sandwich(&whole, &p, i, j) + noise[i][j] - p[i][j]).abs() < 1e-12);
        }
    }
}
