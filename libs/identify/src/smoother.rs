//! Joint motion between slow telemetry.
//!
//! Encoder angles come 5 times a second, the base's motion is wanted 100 times. A joint's deviation from its command is
//! smooth: it is taken for a process with white jerk (state: deviation, rate, acceleration) that angles and rates
//! measure, filtered forward and smoothed backward (Rauch, Tung and Striebel, 1965). How strong the jerk is, the data
//! say: the strength with the largest likelihood of the innovations wins, so that a resting joint is smoothed hard
//! and a shaking one hardly.

use nalgebra::{Matrix3, RowVector3, Vector3};

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
/// Densities of white jerk that are tried, rad/s3 per root Hz.
const JERKS: [f64; 9] = [1e-5, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.5, 2.0];

#[derive(Clone, Copy)]
struct Estimate {
    t_s: f64,
    mean: Vector3<f64>,
    covariance: Matrix3<f64>,
}

/// What is known of the deviation at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Smoothed {
    /// Deviation, rad.
    pub angle: f64,
    /// Its rate, rad/s.
    pub rate: f64,
    /// Variance of the deviation, rad2.
    pub angle_variance: f64,
    /// Variance of the rate, rad2/s2.
    pub rate_variance: f64,
}

/// The deviation at the times of `grid_s` (increasing), from measurements in the order of time; zeros, and certain, without
/// any measurement.
pub fn smooth(measurements: &[Measurement], noise: Noise, grid_s: &[f64]) -> Vec<Smoothed> {
    if measurements.is_empty() {
        return vec![Smoothed::default(); grid_s.len()];
    }
    let likelihood = |jerk: f64| filter(measurements, noise, jerk, &[]).1;
    let mut best = (JERKS[0], f64::NEG_INFINITY);
    for jerk in JERKS {
        let l = likelihood(jerk);
        if l > best.1 {
            best = (jerk, l);
        }
    }
    let (filtered, _) = filter(measurements, noise, best.0, grid_s);
    backward(&filtered, best.0, grid_s)
}

fn transition(dt: f64) -> Matrix3<f64> {
    Matrix3::new(1.0, dt, 0.5 * dt * dt, 0.0, 1.0, dt, 0.0, 0.0, 1.0)
}

fn process(dt: f64, jerk: f64) -> Matrix3<f64> {
    let (a, b, c) = (dt.powi(5) / 20.0, dt.powi(4) / 8.0, dt.powi(3) / 6.0);
    let (d, e) = (dt.powi(3) / 3.0, dt * dt / 2.0);
    Matrix3::new(a, b, c, b, d, e, c, e, dt) * (jerk * jerk)
}

fn predict(from: &Estimate, t_s: f64, jerk: f64) -> Estimate {
    let dt = t_s - from.t_s;
    let f = transition(dt);
    Estimate { t_s, mean: f * from.mean, covariance: f * from.covariance * f.transpose() + process(dt, jerk) }
}

/// Takes one measurement; returns its log-likelihood.
fn update(estimate: &mut Estimate, row: RowVector3<f64>, value: f64, sd: f64) -> f64 {
    let ph = estimate.covariance * row.transpose();
    let variance = (row * ph)[0] + sd * sd;
    let innovation = value - (row * estimate.mean)[0];
    estimate.mean += ph * (innovation / variance);
    estimate.covariance -= ph * ph.transpose() / variance;
    -0.5 * (innovation * innovation / variance + variance.ln())
}

/// Filtered estimates at all measurement and grid times, in order, and the log-likelihood of the measurements.
fn filter(measurements: &[Measurement], noise: Noise, jerk: f64, grid_s: &[f64]) -> (Vec<Estimate>, f64) {
    let first = measurements.first().map_or(0.0, |m| m.t_s).min(grid_s.first().copied().unwrap_or(f64::INFINITY));
    let sd = Vector3::from(START_SD);
    let covariance = Matrix3::from_diagonal(&sd.component_mul(&sd));
    let mut now = Estimate { t_s: first, mean: Vector3::zeros(), covariance };
    let mut all = Vec::with_capacity(measurements.len() + grid_s.len());
    let mut likelihood = 0.0;
    let mut grid = grid_s.iter().copied().peekable();
    for m in measurements {
        while let Some(t_s) = grid.next_if(|t| *t < m.t_s) {
            now = predict(&now, t_s, jerk);
            all.push(now);
        }
        now = predict(&now, m.t_s, jerk);
        if let Some(angle) = m.angle.filter(|v| v.is_finite()) {
            likelihood += update(&mut now, RowVector3::new(1.0, 0.0, 0.0), angle, noise.angle);
        }
        if let Some(rate) = m.rate.filter(|v| v.is_finite()) {
            likelihood += update(&mut now, RowVector3::new(0.0, 1.0, 0.0), rate, noise.rate);
        }
        all.push(now);
    }
    for t_s in grid {
        now = predict(&now, t_s, jerk);
        all.push(now);
    }
    (all, likelihood)
}

fn backward(filtered: &[Estimate], jerk: f64, grid_s: &[f64]) -> Vec<Smoothed> {
    let mut out = vec![Smoothed::default(); grid_s.len()];
    let Some(last) = filtered.last() else { return out };
    let mut smoothed = *last;
    let mut left = grid_s.len();
    for k in (0..filtered.len()).rev() {
        if k + 1 < filtered.len() {
            let here = &filtered[k];
            let ahead = predict(here, filtered[k + 1].t_s, jerk);
            let f = transition(ahead.t_s - here.t_s);
            // Two estimates at one time, or a covariance that rounding has made singular: nothing to learn from ahead.
            let gain = if ahead.t_s > here.t_s {
                ahead.covariance.try_inverse().map(|inverse| here.covariance * f.transpose() * inverse)
            } else {
                Some(Matrix3::identity())
            };
            let gain = gain.unwrap_or_else(Matrix3::zeros);
            smoothed = Estimate {
                t_s: here.t_s,
                mean: here.mean + gain * (smoothed.mean - ahead.mean),
                covariance: here.covariance + gain * (smoothed.covariance - ahead.covariance) * gain.transpose(),
            };
        }
        while left > 0 && grid_s[left - 1] >= smoothed.t_s {
            left -= 1;
            out[left] = Smoothed {
                angle: smoothed.mean[0],
                rate: smoothed.mean[1],
                angle_variance: smoothed.covariance[(0, 0)].max(0.0),
                rate_variance: smoothed.covariance[(1, 1)].max(0.0),
            };
        }
    }
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
