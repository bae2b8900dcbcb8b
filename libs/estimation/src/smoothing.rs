//! A smooth motion through scattered angles and rates, and how far it is known.
//!
//! The motion is taken for a process with white jerk (state: angle, rate, acceleration) that angles and rates measure, filtered
//! forward and smoothed backward (Bryson and Frazier, 1963; Bierman, 1973). The jerk's density is the one with the
//! largest likelihood of the innovations, so that a resting joint is smoothed hard and a shaking one hardly.
//!
//! What it takes for one series of readings serves every other with the same times and variances: [`Smoother::path`] is linear.

use nalgebra::{Matrix3, Vector3};

/// What was measured at one time; what was not is `None`.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Time, s.
    pub t_s: f64,
    /// Angle (rad) or length (m), and the variance of its noise.
    pub angle: Option<(f64, f64)>,
    /// Its rate, and the variance of its noise.
    pub rate: Option<(f64, f64)>,
}

/// Standard deviations before the first reading: rad, rad/s, rad/s2 (those of a pendulum that is let go).
const START_SD: [f64; 3] = [5.0, 30.0, 300.0];
/// Densities of white jerk that are tried, rad/s3 per root Hz (or m): from a resting joint to a pendulum that turns over.
const JERKS: [f64; 16] = [1e-5, 1e-4, 1e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4];

/// One measured component: which of the state it shows, the variance of its innovation, its gain.
#[derive(Clone, Copy, Debug)]
struct Update {
    component: usize,
    variance: f64,
    gain: Vector3<f64>,
}

/// The filter at one time, after what was measured then.
#[derive(Clone, Debug)]
struct Step {
    /// Since the step before, s.
    dt_s: f64,
    covariance: Matrix3<f64>,
    updates: [Option<Update>; 2],
    /// Which reading this is; `None` for a time of the grid.
    reading: Option<usize>,
}

/// Gains and covariances at the times of all readings and of a grid.
#[derive(Clone, Debug)]
pub struct Smoother {
    steps: Vec<Step>,
}

/// The density of jerk with the largest likelihood, rad/s3 per root Hz.
pub fn likeliest_jerk(readings: &[Reading]) -> f64 {
    let mut best = (JERKS[0], f64::NEG_INFINITY);
    for jerk in JERKS {
        let likelihood = Smoother::new(readings, jerk, &[]).log_likelihood(readings);
        if likelihood > best.1 {
            best = (jerk, likelihood);
        }
    }
    best.0
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
    fn ahead(&self, dt_s: f64, jerk: f64) -> Self {
        let f = transition(dt_s);
        let covariance = f * self.covariance * f.transpose() + process(dt_s, jerk);
        Self { dt_s, covariance, updates: [None; 2], reading: None }
    }

    fn measure(&mut self, component: usize, noise: f64) {
        let column: Vector3<f64> = self.covariance.column(component).into_owned();
        let variance = column[component] + noise;
        let gain = column / variance;
        self.covariance -= gain * column.transpose();
        self.covariance = 0.5 * (self.covariance + self.covariance.transpose());
        self.updates[component] = Some(Update { component, variance, gain });
    }
}

impl Smoother {
    /// For readings in the order of time, with a density of jerk (rad/s3 per root Hz), at the times `grid_s` (increasing).
    pub fn new(readings: &[Reading], jerk: f64, grid_s: &[f64]) -> Self {
        let first = readings.first().map_or(0.0, |m| m.t_s).min(grid_s.first().copied().unwrap_or(f64::INFINITY));
        let sd = Vector3::from(START_SD);
        let covariance = Matrix3::from_diagonal(&sd.component_mul(&sd));
        let mut now = Step { dt_s: 0.0, covariance, updates: [None; 2], reading: None };
        let mut now_s = first;
        let mut steps: Vec<Step> = Vec::with_capacity(readings.len() + grid_s.len());
        let mut grid = grid_s.iter().copied().peekable();
        for (k, reading) in readings.iter().enumerate() {
            while let Some(t_s) = grid.next_if(|t| *t < reading.t_s) {
                now = now.ahead(t_s - now_s, jerk);
                now_s = t_s;
                steps.push(now.clone());
            }
            now = Step { reading: Some(k), ..now.ahead(reading.t_s - now_s, jerk) };
            now_s = reading.t_s;
            for (component, measured) in [reading.angle, reading.rate].into_iter().enumerate() {
                if let Some((_, noise)) = measured {
                    now.measure(component, noise);
                }
            }
            steps.push(now.clone());
        }
        for t_s in grid {
            now = now.ahead(t_s - now_s, jerk);
            now_s = t_s;
            steps.push(now.clone());
        }
        Self { steps }
    }

    /// Runs the filter's means through readings; `see` gets each step, its mean and the innovations of its updates.
    fn forward(&self, readings: &[Reading], mut see: impl FnMut(&Step, &Vector3<f64>, [f64; 2])) {
        let mut mean = Vector3::zeros();
        for step in &self.steps {
            mean = transition(step.dt_s) * mean;
            let mut innovations = [0.0; 2];
            let reading = step.reading.map(|k| &readings[k]);
            for update in step.updates.iter().flatten() {
                let value = reading.and_then(|r| if update.component == 0 { r.angle } else { r.rate });
                let innovation = value.map_or(0.0, |(v, _)| v - mean[update.component]);
                innovations[update.component] = innovation;
                mean += update.gain * innovation;
            }
            see(step, &mean, innovations);
        }
    }

    fn log_likelihood(&self, readings: &[Reading]) -> f64 {
        let mut sum = 0.0;
        self.forward(readings, |step, _, innovations| {
            for update in step.updates.iter().flatten() {
                sum -= 0.5 * (innovations[update.component].powi(2) / update.variance + update.variance.ln());
            }
        });
        sum
    }

    /// Angle, rate and acceleration at the grid's times, for readings of the times and variances that this was made for. Modified
    /// Bryson-Frazier smoother: the adjoint of the innovations runs back through the filter, and no covariance, which a weak
    /// process leaves near singular, has to be inverted.
    pub fn path(&self, readings: &[Reading]) -> Vec<[f64; 3]> {
        let mut forward = Vec::with_capacity(self.steps.len());
        self.forward(readings, |_, mean, innovations| forward.push((*mean, innovations)));
        let mut out = Vec::with_capacity(self.steps.len());
        let mut adjoint = Vector3::<f64>::zeros();
        for (step, (mean, innovations)) in self.steps.iter().zip(forward).rev() {
            if step.reading.is_none() {
                out.push((mean - step.covariance * adjoint).into());
            }
            for update in step.updates.iter().rev().flatten() {
                let c = update.component;
                adjoint[c] -= update.gain.dot(&adjoint) + innovations[c] / update.variance;
            }
            adjoint = transition(step.dt_s).transpose() * adjoint;
        }
        out.reverse();
        out
    }

    /// Variances of angle, rate and acceleration at the grid's times.
    pub fn variances(&self) -> Vec<[f64; 3]> {
        let mut out = Vec::with_capacity(self.steps.len());
        let mut information = Matrix3::zeros();
        for step in self.steps.iter().rev() {
            if step.reading.is_none() {
                let covariance = step.covariance - step.covariance * information * step.covariance;
                out.push(std::array::from_fn(|i| covariance[(i, i)].max(0.0)));
            }
            for update in step.updates.iter().rev().flatten() {
                let mut row = Vector3::zeros();
                row[update.component] = 1.0;
                let keep = Matrix3::identity() - update.gain * row.transpose();
                information = keep.transpose() * information * keep + row * row.transpose() / update.variance;
            }
            let f = transition(step.dt_s);
            information = f.transpose() * information * f;
        }
        out.reverse();
        out
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn smooth(readings: &[Reading], grid_s: &[f64]) -> Vec<[f64; 3]> {
        Smoother::new(readings, likeliest_jerk(readings), grid_s).path(readings)
    }

    #[test]
    fn a_swinging_joint_is_known_between_its_telemetry() {
        let seed = 11;
        println!("seed {seed}");
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut noise = |sd: f64| sd * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut rng);
        let w = 4.0;
        let readings: Vec<_> = (0..200)
            .map(|k| {
                let t_s = 0.2 * f64::from(k);
                let angle = Some((0.03 * (w * t_s).sin() + noise(2e-4), 4e-8));
                Reading { t_s, angle, rate: Some((0.03 * w * (w * t_s).cos() + noise(2e-3), 4e-6)) }
            })
            .collect();
        let grid: Vec<f64> = (0..3900).map(|k| 0.01 * f64::from(k)).collect();
        let out = smooth(&readings, &grid);
        let rms = |f: &dyn Fn(usize) -> f64| ((0..grid.len()).map(|i| f(i).powi(2)).sum::<f64>() / 3900.0).sqrt();
        let angle = rms(&|i| out[i][0] - 0.03 * (w * grid[i]).sin());
        let rate = rms(&|i| out[i][1] - 0.03 * w * (w * grid[i]).cos());
        assert!(angle < 2.5e-4 && rate < 2.5e-3, "{angle} rad, {rate} rad/s");
        // As far as it says that it knows.
        let smoother = Smoother::new(&readings, likeliest_jerk(&readings), &grid);
        let said = smoother.variances().iter().map(|v| v[0]).sum::<f64>() / 3900.0;
        assert!((0.5..2.0).contains(&(angle * angle / said)), "{angle} rad against {}", said.sqrt());
    }

    #[test]
    fn a_resting_joint_is_smoothed_to_rest() {
        let readings: Vec<_> = (0..200)
            .map(|k| {
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                let (angle, rate) = (Some((0.1 + 2e-4 * sign, 4e-8)), Some((2e-3 * sign, 4e-6)));
                Reading { t_s: 0.2 * f64::from(k), angle, rate }
            })
            .collect();
        let out = smooth(&readings, &[10.0, 10.1, 20.0]);
        assert!(out.iter().all(|s| (s[0] - 0.1).abs() < 5e-5 && s[1].abs() < 2e-4), "{out:?}");
    }

    #[test]
    fn a_swing_is_followed_with_its_acceleration() {
        let w = 10.0_f64;
        let readings: Vec<_> = (0..2000)
            .map(|k| {
                let t_s = 0.005 * f64::from(k);
                let noise = if k % 2 == 0 { 4e-5 } else { -4e-5 };
                Reading { t_s, angle: Some((1.5 * (w * t_s).sin() + noise, 1.6e-9)), rate: None }
            })
            .collect();
        let grid: Vec<f64> = (100..1900).map(|k| 0.005 * f64::from(k) + 0.002).collect();
        for (t, s) in grid.iter().zip(smooth(&readings, &grid)) {
            assert!((s[2] + 150.0 * (w * t).sin()).abs() < 2.0, "{} rad/s2 at {t} s", s[2]);
        }
    }
}
