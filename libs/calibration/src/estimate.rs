//! Batch least squares with the noise of each kind of observation estimated from its residuals, rank and covariance.

use super::words::{SHARE, in_words};
use super::{CalibrationError, Estimate, Estimated, Row, SHORTEST_SERIES, Unknown, sandwich};
use fss_estimation::least_squares::{self, Linearization, Parameter, Weights};
use nalgebra::DMatrix;
use std::collections::BTreeMap;

/// Whether neighbours share errors is a matter of yes or no; after so many iterations the answer stays.
const SETTLE_AFTER: usize = 3;
/// Residuals beyond this many standard deviations are outliers.
const OUTLIER: f64 = 5.0;

/// Least squares of `residuals(values)` = measured less predicted (the paper's equations 2 to 4, weighted), from `start`.
///
/// The unknowns' first guesses are the means of their priors, and what is plausible the standard deviations. Where data speak
/// at all they outweigh them by far; along a direction that the data do not determine the values stay where they were
/// guessed, and what that direction could shift is in every standard deviation. Without it the iteration would come to rest
/// anywhere in a valley that bends, and what is well seen at one place of it is something else at another.
///
/// `sensor_noise` is the noise of each kind before the residuals tell, and where they are too few to tell.
///
/// # Errors
/// [`CalibrationError`].
pub fn solve(
    unknowns: &[Unknown],
    start: &[f64],
    rows: &[Row],
    sensor_noise: &[f64],
    residuals: impl Fn(&[f64]) -> Option<Vec<f64>> + Sync,
) -> Result<Estimate, CalibrationError> {
    let parameters: Vec<Parameter> = unknowns.iter().map(|u| Parameter::new(u.value, u.plausible)).collect();
    let mut noise = NoiseModel::new(unknowns.len(), rows, sensor_noise);
    let mut values = least_squares::solve(&parameters, start, &mut noise, &residuals)?;
    if noise.reject_outliers(&residuals(&values).ok_or(CalibrationError::Diverged)?) {
        values = least_squares::solve(&parameters, &values, &mut noise, &residuals)?;
    }
    let linear = Linearization::at(&parameters, &values, |row| noise.of(row), &residuals)?;
    Ok(noise.estimate(unknowns, values, &linear))
}

/// The noise of each kind of observation, and the instants that are taken for outliers.
struct NoiseModel<'a> {
    unknown_count: usize,
    rows: &'a [Row],
    sensor_noise: &'a [f64],
    noise: Vec<f64>,
    /// Samples that say as much as one without shared errors, by kind.
    shared: Vec<f64>,
    rejected: Vec<usize>,
    /// Fewest degrees of freedom that a noise was estimated with; infinite while all are the sensors'.
    freedom: f64,
}

impl Weights for NoiseModel<'_> {
    fn of(&self, row: usize) -> f64 {
        let Row { kind, instant, .. } = self.rows[row];
        if self.rejected.contains(&instant) { 0.0 } else { 1.0 / self.noise[kind] }
    }

    fn update(&mut self, iteration: usize, before_step: &Linearization) -> bool {
        let before = self.noise.clone();
        if iteration < SETTLE_AFTER {
            self.shared = (0..self.noise.len()).map(|kind| self.samples_for_one(kind, before_step)).collect();
        }
        self.noise = self.noise_of(before_step);
        let settled = before.iter().zip(&self.noise).all(|(a, b)| (a - b).abs() <= 1e-3 * a);
        settled && iteration >= SETTLE_AFTER
    }
}

impl<'a> NoiseModel<'a> {
    fn new(unknown_count: usize, rows: &'a [Row], sensor_noise: &'a [f64]) -> Self {
        Self {
            unknown_count,
            rows,
            sensor_noise,
            noise: sensor_noise.to_vec(),
            shared: vec![1.0; sensor_noise.len()],
            rejected: Vec::new(),
            freedom: f64::INFINITY,
        }
    }

    /// Noise of each kind from its residuals and what they kept of their degrees of freedom.
    fn noise_of(&mut self, linear: &Linearization) -> Vec<f64> {
        let mut squares = vec![0.0; self.sensor_noise.len()];
        let mut freedom = vec![0.0; self.sensor_noise.len()];
        for (i, row) in self.rows.iter().enumerate().filter(|(i, _)| self.of(*i) > 0.0) {
            let share = |k: usize| linear.left[(i, k)].powi(2) * (1.0 - linear.variance(k));
            let leverage: f64 = (0..linear.singular.len()).map(share).sum();
            squares[row.kind] += linear.residual[i].powi(2);
            freedom[row.kind] += 1.0 - leverage;
        }
        let shared = &self.shared;
        let counted = freedom.iter().zip(shared).filter(|(left, _)| **left >= 3.0);
        self.freedom = counted.map(|(left, shared)| left / shared).fold(f64::INFINITY, f64::min);
        let of = |kind: usize| {
            let floor = 1e-9 * self.sensor_noise[kind];
            if freedom[kind] < 3.0 {
                self.sensor_noise[kind]
            } else {
                (squares[kind] / freedom[kind] * shared[kind]).sqrt().max(floor)
            }
        };
        (0..self.sensor_noise.len()).map(of).collect()
    }

    /// How many samples of a kind say as much as one that shares no error with its neighbours: 1 or more.
    fn samples_for_one(&self, kind: usize, linear: &Linearization) -> f64 {
        let mut series: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        for (i, row) in self.rows.iter().enumerate().filter(|(_, row)| row.kind == kind) {
            let value = if self.of(i) > 0.0 { linear.residual[i] } else { 0.0 };
            series.entry(row.series).or_default().push(value);
        }
        series.retain(|_, values| values.len() >= SHORTEST_SERIES);
        let product = |lag: usize| -> f64 {
            series.values().flat_map(|v| v.iter().zip(v.iter().skip(lag)).map(|(a, b)| a * b)).sum()
        };
        let longest = series.values().map(|values| values.len() / 4).max().unwrap_or(0);
        let power = product(0);
        // White noise has pairs of autocorrelations of about this size.
        let chance = (2.0 / series.values().map(Vec::len).sum::<usize>().max(1) as f64).sqrt();
        let mut sum = 0.0;
        for lag in (1..longest).step_by(2) {
            let pair = (product(lag) + product(lag + 1)) / power;
            if pair.is_nan() || pair <= chance {
                break;
            }
            sum += pair;
        }
        1.0 + 2.0 * sum
    }

    /// Rejects instants far off, by a scale that outliers do not widen; at most a fifth of all.
    fn reject_outliers(&mut self, residual: &[f64]) -> bool {
        let mut worst: Vec<(f64, usize)> = Vec::new();
        for kind in 0..self.noise.len() {
            let of_kind = || self.rows.iter().zip(residual).filter(move |(row, _)| row.kind == kind);
            let mut sizes: Vec<f64> = of_kind().map(|(_, r)| r.abs()).collect();
            if sizes.len() < 8 {
                continue;
            }
            sizes.sort_by(f64::total_cmp);
            let scale = (1.4826 * sizes[sizes.len() / 2]).max(1e-9 * self.sensor_noise[kind]);
            // Few rows follow their own outliers and leave small residuals; their median is trusted less.
            let shrunk = (1.0 - self.unknown_count as f64 / self.rows.len() as f64).max(0.3).sqrt();
            worst.extend(of_kind().map(|(row, r)| (r.abs() / scale * shrunk, row.instant)));
        }
        worst.retain(|(size, _)| *size > OUTLIER);
        worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        let instants = self.rows.iter().map(|row| row.instant).max().map_or(0, |last| last + 1);
        for (_, instant) in worst {
            if !self.rejected.contains(&instant) && 5 * (self.rejected.len() + 1) <= instants {
                self.rejected.push(instant);
            }
        }
        !self.rejected.is_empty()
    }

    /// The estimate that the problem at its solution makes.
    fn estimate(self, unknowns: &[Unknown], values: Vec<f64>, linear: &Linearization) -> Estimate {
        let n = unknowns.len();
        let hidden: Vec<usize> = (0..n).filter(|k| !linear.is_determined(*k)).collect();
        let share = |j: usize| hidden.iter().map(|k| linear.right[(*k, j)].powi(2)).sum::<f64>().sqrt();
        let variance = |j: usize, part: fn((f64, f64)) -> f64| -> f64 {
            (0..n).map(|k| linear.right[(k, j)].powi(2) * part(linear.variance_shares(k))).sum()
        };
        let weighted: Vec<f64> = (0..self.rows.len()).map(|i| linear.residual[i] * self.of(i)).collect();
        let by_blocks = sandwich::variances(linear, self.rows, &weighted);
        let variance = |j: usize| {
            let of_noise = by_blocks.as_ref().map_or(0.0, |v| v[j]).max(variance(j, |shares| shares.0));
            of_noise + variance(j, |shares| shares.1)
        };
        let mut parameters = Vec::new();
        let mut unseen = Vec::new();
        for (j, unknown) in unknowns.iter().enumerate() {
            if share(j) > SHARE {
                unseen.push(unknown.name.clone());
            } else {
                let std = variance(j).sqrt() * unknown.plausible;
                parameters.push(Estimated { name: unknown.name.clone(), value: values[j], std });
            }
        }
        let used = (0..self.rows.len()).filter(|i| self.of(*i) > 0.0).count();
        let rank = linear.rank();
        let residual_std = (0..self.noise.len()).map(|kind| {
            let of = (0..self.rows.len()).filter(|i| self.rows[*i].kind == kind && self.of(*i) > 0.0);
            let squares: Vec<f64> = of.map(|i| linear.residual[i].powi(2)).collect();
            (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
        });
        Estimate {
            parameters,
            undetermined: in_words(unknowns, &linear.right, &hidden),
            undetermined_parameters: unseen,
            rank,
            unknowns: n,
            condition: if rank < n { f64::INFINITY } else { condition(&linear.jacobian) },
            residual_std: residual_std.collect(),
            noise: self.noise,
            noise_degrees_of_freedom: self.freedom,
            degrees_of_freedom: used.saturating_sub(rank),
            rejected: self.rejected,
            values,
        }
    }
}

/// Condition number with columns of unit norm.
fn condition(jacobian: &DMatrix<f64>) -> f64 {
    let mut scaled = jacobian.clone();
    for mut column in scaled.column_iter_mut() {
        let norm = column.norm();
        if norm > 0.0 {
            column /= norm;
        }
    }
    let singular = scaled.singular_values();
    singular.max() / singular.min()
}
