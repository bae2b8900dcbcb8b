//! A smooth path through scattered angles and rates, to linearize about.
//!
//! The angle is taken for a process with white jerk (state: angle, rate, acceleration), filtered forward and smoothed
//! backward (Bryson and Frazier, 1963). The jerk's density is the one with the largest likelihood of the innovations. The
//! path is only the point of linearization: what is inferred does not depend on it to first order.

use nalgebra::{Matrix3, Vector3};

/// What was measured at one time; what was not is `None`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading {
    /// Time, s.
    pub(super) t_s: f64,
    /// Angle (rad) or length (m) and the variance of its noise.
    pub(super) angle: Option<(f64, f64)>,
    /// Rate and the variance of its noise.
    pub(super) rate: Option<(f64, f64)>,
}

/// The path at one time.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Smoothed {
    /// Angle, rate, acceleration.
    pub(super) value: [f64; 3],
    /// Standard deviation of the rate.
    pub(super) rate_sd: f64,
}

/// What is not known before the first reading: rad, rad/s, rad/s2 (those of a pendulum that is let go).
const START_SD: [f64; 3] = [5.0, 30.0, 300.0];
/// Densities of white jerk to choose from, rad/s3 per root Hz: from a joint at rest to a pendulum that turns over.
const JERKS: [f64; 15] = [1e-4, 1e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4];

#[derive(Clone, Copy)]
struct Update {
    component: usize,
    innovation: f64,
    variance: f64,
    gain: Vector3<f64>,
}

#[derive(Clone)]
struct Step {
    t_s: f64,
    mean: Vector3<f64>,
    covariance: Matrix3<f64>,
    updates: [Option<Update>; 2],
    on_grid: bool,
}

/// The path at the times of `grid_s` (increasing) through readings in order of time; zeros without any.
pub(super) fn smooth(readings: &[Reading], grid_s: &[f64]) -> Vec<Smoothed> {
    smooth_with(readings, likeliest_jerk(readings), grid_s)
}

/// The same with a density of jerk, rad/s3 per root Hz.
pub(super) fn smooth_with(readings: &[Reading], jerk: f64, grid_s: &[f64]) -> Vec<Smoothed> {
    if readings.is_empty() {
        return vec![Smoothed::default(); grid_s.len()];
    }
    backward(&filter(readings, jerk, grid_s).0)
}

/// The density of jerk with the largest likelihood, rad/s3 per root Hz.
pub(super) fn likeliest_jerk(readings: &[Reading]) -> f64 {
    let mut best = (JERKS[0], f64::NEG_INFINITY);
    for jerk in JERKS {
        let likelihood = filter(readings, jerk, &[]).1;
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
    fn ahead(&self, t_s: f64, jerk: f64) -> Self {
        let dt = t_s - self.t_s;
        let f = transition(dt);
        let covariance = f * self.covariance * f.transpose() + process(dt, jerk);
        Self { t_s, mean: f * self.mean, covariance, updates: [None; 2], on_grid: false }
    }

    /// Takes one measured component; returns its log-likelihood.
    fn update(&mut self, component: usize, (value, noise): (f64, f64)) -> f64 {
        let column: Vector3<f64> = self.covariance.column(component).into_owned();
        let variance = column[component] + noise;
        let innovation = value - self.mean[component];
        let gain = column / variance;
        self.mean += gain * innovation;
        self.covariance -= gain * column.transpose();
        self.covariance = 0.5 * (self.covariance + self.covariance.transpose());
        self.updates[component] = Some(Update { component, innovation, variance, gain });
        -0.5 * (innovation * innovation / variance + variance.ln())
    }
}

/// The filter at the grid's times and, where there is a grid, at the readings', in order; the readings' log-likelihood.
fn filter(readings: &[Reading], jerk: f64, grid_s: &[f64]) -> (Vec<Step>, f64) {
    let first = readings.first().map_or(0.0, |m| m.t_s).min(grid_s.first().copied().unwrap_or(f64::INFINITY));
    let sd = Vector3::from(START_SD);
    let covariance = Matrix3::from_diagonal(&sd.component_mul(&sd));
    let mut now = Step { t_s: first, mean: Vector3::zeros(), covariance, updates: [None; 2], on_grid: false };
    let mut all: Vec<Step> = Vec::with_capacity(if grid_s.is_empty() { 0 } else { readings.len() + grid_s.len() });
    let mut likelihood = 0.0;
    let mut grid = grid_s.iter().copied().peekable();
    for m in readings {
        while let Some(t_s) = grid.next_if(|t| *t < m.t_s) {
            now = Step { on_grid: true, ..now.ahead(t_s, jerk) };
            all.push(now.clone());
        }
        now = now.ahead(m.t_s, jerk);
        likelihood += m.angle.map_or(0.0, |angle| now.update(0, angle));
        likelihood += m.rate.map_or(0.0, |rate| now.update(1, rate));
        if !grid_s.is_empty() {
            all.push(now.clone());
        }
    }
    for t_s in grid {
        now = Step { on_grid: true, ..now.ahead(t_s, jerk) };
        all.push(now.clone());
    }
    (all, likelihood)
}

/// Modified Bryson-Frazier smoother: the adjoint of the innovations runs back through the filter, and no covariance, which a
/// weak process leaves near singular, has to be inverted (Bierman, 1973).
fn backward(steps: &[Step]) -> Vec<Smoothed> {
    let mut out = Vec::new();
    let (mut adjoint, mut information) = (Vector3::zeros(), Matrix3::zeros());
    for k in (0..steps.len()).rev() {
        let step = &steps[k];
        if step.on_grid {
            let mean = step.mean - step.covariance * adjoint;
            let covariance = step.covariance - step.covariance * information * step.covariance;
            out.push(Smoothed { value: mean.into(), rate_sd: covariance[(1, 1)].max(0.0).sqrt() });
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
mod tests {
    use super::*;

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
            assert!((s.value[2] + 150.0 * (w * t).sin()).abs() < 2.0, "{} rad/s2 at {t} s", s.value[2]);
        }
    }
}
