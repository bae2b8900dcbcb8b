//! Datagrams that arrive earlier or later than they are taken to, and what this does to the base.

use super::joint_motion::JointMotion;
use super::prediction::Predictor;
use crate::servo_response::{ARRIVAL_SD_S, Nodes};
use fss_plant::Plant;

/// Datagrams arrive earlier or later than they are taken to: by u standard deviations, an Ornstein-Uhlenbeck process. A servo
/// whose commanded motion begins later is displaced along it, by x: x' = (u - x) g, with g the gain of the position loop.
pub(super) struct Arrivals {
    /// Correlation time of u (s), and 1/g (s).
    pub(super) time_s: f64,
    pub(super) lag_s: f64,
    /// What a displacement of one standard deviation of the arrival turns the base by, at each block (rad).
    pub(super) turn_rad: Vec<f64>,
}

impl Arrivals {
    /// What later datagrams do at each block.
    pub(super) fn new(
        plant: &Plant,
        time_s: f64,
        predictor: &Predictor,
        beside: &JointMotion,
        times: &[f64],
    ) -> Option<Self> {
        let grid = predictor.encoders.grid;
        let nominal = &predictor.encoders.response.as_ref()?.nominal;
        let turn = |t_s: &f64| {
            let of = |(joint, nodes): (usize, &Nodes)| {
                beside.at(*t_s, joint)[2] * grid.between(nodes, *t_s)[1] * ARRIVAL_SD_S
            };
            nominal.iter().enumerate().map(|own| of(own).powi(2)).sum::<f64>().sqrt()
        };
        let gain = (0..nominal.len()).map(|i| plant.servo(i).position_gain_1_s).sum::<f64>() / nominal.len() as f64;
        Some(Self { time_s, lag_s: 1.0 / gain.max(1e-3), turn_rad: times.iter().map(turn).collect() })
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
        let arrivals = Arrivals { time_s: 0.1, lag_s: 0.125, turn_rad: Vec::new() };
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
