//! Joint motion between slow telemetry.
//!
//! Encoder angles come 5 times a second, the base's motion is wanted 100 times. A joint's deviation from its command is
//! smooth: it is taken for a process with white jerk (state: deviation, rate, acceleration) that angles and rates
//! measure, filtered forward and smoothed backward (Bryson and Frazier, 1963; Bierman, 1973). How strong the jerk is, the data
//! say: the strength with the largest likelihood of the innovations wins, so that a resting joint is smoothed hard
//! and a shaking one hardly.

use nalgebra::{Matrix3, Vector3};

/// A measurement of the deviation at one time; what was not measured is `None`.
#[derive(Clone, Copy, Debug)]
pub struct Measurement {
    /// Time, s.
    pub t_s: f64,
    /// Deviation, rad.
    pub angle: Option<f64>,
    /// Its rate, rad/s.
    pub rate: Option<f64>,
}

/// Standard deviations of the measurements.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    /// Of an angle, rad.
    pub angle: f64,
    /// Of a rate, rad/s.
    pub rate: f64,
}

/// What is not known before the first measurement: rad, rad/s, rad/s2.
const START_SD: [f64; 3] = [0.5, 1.0, 3.0];
/// Densities of white jerk that are tried, rad/s3 per root Hz (or m): from a resting joint to a fast hovercraft.
const JERKS: [f64; 16] = [1e-5, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3];

/// One measured component: which of the state it shows, innovation, its variance, gain.
#[derive(Clone, Copy)]
struct Update {
    component: usize,
    innovation: f64,
    variance: f64,
    gain: Vector3<f64>,
}

/// The filter at one time, after what was measured then.
struct Step {
    t_s: f64,
    mean: Vector3<f64>,
    covariance: Matrix3<f64>,
    updates: [Option<Update>; 2],
    on_grid: bool,
}

/// What is known of the deviation at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Smoothed {
    /// Deviation, rad.
    pub angle: f64,
    /// Its rate, rad/s.
    pub rate: f64,
    /// Its second derivative, rad/s2.
    pub acceleration: f64,
    /// Variance of the deviation, rad2.
    pub angle_variance: f64,
    /// Variance of the rate, rad2/s2.
    pub rate_variance: f64,
    /// Variance of the second derivative, rad2/s4.
    pub acceleration_variance: f64,
}

/// The deviation at the times of `grid_s` (increasing), from measurements in the order of time; zeros, and certain, without
/// any measurement.
pub fn smooth(measurements: &[Measurement], noise: Noise, grid_s: &[f64]) -> Vec<Smoothed> {
    if measurements.is_empty() {
        return vec![Smoothed::default(); grid_s.len()];
    }
    let mut best = (JERKS[0], f64::NEG_INFINITY);
    for jerk in JERKS {
        let likelihood = filter(measurements, noise, jerk, &[]).1;
        if likelihood > best.1 {
            best = (jerk, likelihood);
        }
    }
    let (steps, _) = filter(measurements, noise, best.0, grid_s);
    backward(&steps)
}

fn transition(dt: f64) -> Matrix3<f64> {
    Matrix3::new(1.0, dt, 0.5 * dt * dt, 0.0, 1.0, dt, 0.0, 0.0, 1.0)
}

fn process(dt: f64, jerk: f64) -> Matrix3<f64> {
    let (a, b, c) = (dt.powi(5) / 20.0, dt.powi(4) / 8.0, dt.powi(3) / 6.0);
    let (d, e) = (dt.powi(3) / 3.0, dt * dt / 2.0);
    Matrix3::new(a, b, c, b, d, e, c, e, dt) * (jerk * jerk)
}

impl Step {
    fn ahead(&self, t_s: f64, jerk: f64) -> Self {
        let dt = t_s - self.t_s;
        let f = transition(dt);
        let covariance = f * self.covariance * f.transpose() + process(dt, jerk);
        Self { t_s, mean: f * self.mean, covariance, updates: [None; 2], on_grid: false }
    }

    /// Takes one measured component; returns its log-likelihood.
    fn update(&mut self, component: usize, value: f64, sd: f64) -> f64 {
        let column: Vector3<f64> = self.covariance.column(component).into_owned();
        let variance = column[component] + sd * sd;
        let innovation = value - self.mean[component];
        let gain = column / variance;
        self.mean += gain * innovation;
        self.covariance -= gain * column.transpose();
        self.covariance = 0.5 * (self.covariance + self.covariance.transpose());
        self.updates[component] = Some(Update { component, innovation, variance, gain });
        -0.5 * (innovation * innovation / variance + variance.ln())
    }
}

/// The filter at all measurement and grid times, in order, and the log-likelihood of the measurements.
fn filter(measurements: &[Measurement], noise: Noise, jerk: f64, grid_s: &[f64]) -> (Vec<Step>, f64) {
    let first = measurements.first().map_or(0.0, |m| m.t_s).min(grid_s.first().copied().unwrap_or(f64::INFINITY));
    let sd = Vector3::from(START_SD);
    let covariance = Matrix3::from_diagonal(&sd.component_mul(&sd));
    let begin = Step { t_s: first, mean: Vector3::zeros(), covariance, updates: [None; 2], on_grid: false };
    let mut all: Vec<Step> = Vec::with_capacity(measurements.len() + grid_s.len());
    let ahead = |all: &[Step], t_s: f64| all.last().unwrap_or(&begin).ahead(t_s, jerk);
    let mut likelihood = 0.0;
    let mut grid = grid_s.iter().copied().peekable();
    for m in measurements {
        while let Some(t_s) = grid.next_if(|t| *t < m.t_s) {
            all.push(Step { on_grid: true, ..ahead(&all, t_s) });
        }
        let mut now = ahead(&all, m.t_s);
        likelihood += m.angle.filter(|v| v.is_finite()).map_or(0.0, |angle| now.update(0, angle, noise.angle));
        likelihood += m.rate.filter(|v| v.is_finite()).map_or(0.0, |rate| now.update(1, rate, noise.rate));
        all.push(now);
    }
    for t_s in grid {
        all.push(Step { on_grid: true, ..ahead(&all, t_s) });
    }
    (all, likelihood)
}

/// Modified Bryson-Frazier smoother: the adjoint of the innovations runs back through the filter, and no covariance, which a
/// weak process leaves near singular, has to be inverted.
fn backward(steps: &[Step]) -> Vec<Smoothed> {
    let mut out = Vec::new();
    let (mut adjoint, mut information) = (Vector3::zeros(), Matrix3::zeros());
    for k in (0..steps.len()).rev() {
        let step = &steps[k];
        if step.on_grid {
            let mean = step.mean - step.covariance * adjoint;
            let covariance = step.covariance - step.covariance * information * step.covariance;
            out.push(Smoothed {
                angle: mean[0],
                rate: mean[1],
                acceleration: mean[2],
                angle_variance: covariance[(0, 0)].max(0.0),
                rate_variance: covariance[(1, 1)].max(0.0),
                acceleration_variance: covariance[(2, 2)].max(0.0),
            });
        }
        for update in step.updates.iter().rev().flatten() {
            let mut row = Vector3::zeros();
            row[update.component] = 1.0;
            let keep = Matrix3::identity() - update.gain * row.transpose();
            adjoint = keep.transpose() * adjoint - row * (update.innovation / update.variance);
            information = keep.transpose() * information * keep + row * row.transpose() / update.variance;
        }
        if k > 0 {
            let f = transition(step.t_s - steps[k - 1].t_s);
            adjoint = f.transpose() * adjoint;
            information = f.transpose() * information * f;
        }
    }
    out.reverse();
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn a_swinging_joint_is_known_between_its_telemetry() {
        let seed = 11;
        println!("seed {seed}");
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut noise = |sd: f64| sd * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
        let w = 4.0;
        let measurements: Vec<_> = (0..200)
            .map(|k| {
                let t_s = 0.2 * f64::from(k);
                let angle = 0.03 * (w * t_s).sin() + noise(2e-4);
                Measurement { t_s, angle: Some(angle), rate: Some(0.03 * w * (w * t_s).cos() + noise(2e-3)) }
            })
            .collect();
        let grid: Vec<f64> = (0..3900).map(|k| 0.01 * f64::from(k)).collect();
        let out = smooth(&measurements, Noise { angle: 2e-4, rate: 2e-3 }, &grid);
        let rms = |f: &dyn Fn(usize) -> f64| ((0..grid.len()).map(|i| f(i).powi(2)).sum::<f64>() / 3900.0).sqrt();
        let angle = rms(&|i| out[i].angle - 0.03 * (w * grid[i]).sin());
        let rate = rms(&|i| out[i].rate - 0.03 * w * (w * grid[i]).cos());
        assert!(angle < 2.5e-4 && rate < 2.5e-3, "{angle} rad, {rate} rad/s");
    }

    #[test]
    fn a_resting_joint_is_smoothed_to_rest() {
        let measurements: Vec<_> = (0..200)
            .map(|k| {
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                Measurement { t_s: 0.2 * f64::from(k), angle: Some(0.1 + 2e-4 * sign), rate: Some(2e-3 * sign) }
            })
            .collect();
        let out = smooth(&measurements, Noise { angle: 2e-4, rate: 2e-3 }, &[10.0, 10.1, 20.0]);
        assert!(out.iter().all(|s| (s.angle - 0.1).abs() < 5e-5 && s.rate.abs() < 2e-4), "{out:?}");
    }
}
