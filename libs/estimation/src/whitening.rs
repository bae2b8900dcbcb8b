//! A Kalman filter that whitens many columns at once: its gains depend on the model alone, so that one pass over the
//! covariance serves every column.
//!
//! The model is `x_{k+1} = Phi_k x_k + w_k`, `cov w_k = Q_k`; each row of the columns is a scalar measurement `h . x + v`,
//! `var v` given, in order of time. The innovations over their standard deviations are a linear map of the column,
//! `L^-1 y` with `L L'` the covariance of all rows (Kailath, Sayed and Hassibi, *Linear Estimation*, 2000, chapter 9).

mod states;

use crate::Columns;
use states::States;

/// A step from one time of measurement to the next; matrices by their elements that are not 0: row, column, value.
#[derive(Clone, Debug, Default)]
pub struct Step {
    /// Transition, n x n.
    pub transition: Vec<(usize, usize, f64)>,
    /// Covariance of the process noise of the step, n x n, with the elements on both sides of its diagonal.
    pub noise: Vec<(usize, usize, f64)>,
}

impl Step {
    /// Nothing in either matrix.
    pub fn clear(&mut self) {
        self.transition.clear();
        self.noise.clear();
    }
}

/// The filter, on its way through the rows of the columns that it whitens in place.
#[derive(Debug)]
pub struct Whitener<'a> {
    columns: &'a mut Columns,
    row: usize,
    log_det: f64,
    states: States,
}

impl<'a> Whitener<'a> {
    /// Begins with the covariance of the states at the first measurement, n x n, row-major.
    pub fn new(states: usize, initial: &[f64], columns: &'a mut Columns) -> Self {
        let states = States::new(states, initial, columns.width());
        Self { columns, row: 0, log_det: 0.0, states }
    }

    /// On to the time of the next measurement.
    pub fn advance(&mut self, step: &Step) {
        self.states.advance(step);
    }

    /// The next row: the states that it measures, each with its coefficient, and the variance of its noise, larger than 0.
    ///
    /// # Panics
    /// Where the columns have no more rows.
    pub fn measure(&mut self, states: &[(usize, f64)], variance: f64) {
        let values = self.columns.row_mut(self.row);
        self.row += 1;
        self.log_det += self.states.measure(values, states, variance).ln();
    }

    /// Logarithm of the determinant of the covariance of the rows that were measured.
    pub fn log_det(&self) -> f64 {
        self.log_det
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use nalgebra::{Cholesky, DMatrix, DVector};
    use rand::{RngExt, SeedableRng};

    /// A whole model: rows with the step that leads to each, the states that it measures and the variance of its noise.
    struct StateSpace {
        states: usize,
        initial: Vec<f64>,
        steps: Vec<Step>,
        measurements: Vec<Measurement>,
    }

    struct Measurement {
        step: Option<usize>,
        states: Vec<(usize, f64)>,
        variance: f64,
    }

    /// The elements of matrices n x n, row-major, that are not 0.
    fn step(n: usize, transition: &[f64], noise: &[f64]) -> Step {
        let elements = |matrix: &[f64]| -> Vec<(usize, usize, f64)> {
            matrix.iter().enumerate().filter(|(_, v)| **v != 0.0).map(|(k, v)| (k / n, k % n, *v)).collect()
        };
        Step { transition: elements(transition), noise: elements(noise) }
    }

    /// Covariance of all measurements, assembled from the definition.
    fn dense(model: &StateSpace) -> DMatrix<f64> {
        let n = model.states;
        let square = |values: &[f64]| DMatrix::from_row_slice(n, n, values);
        let rows = model.measurements.len();
        // Each row as a linear map of the initial state and all process noises.
        let mut maps: Vec<Vec<DMatrix<f64>>> = vec![vec![DMatrix::identity(n, n)]];
        let mut covariances = vec![square(&model.initial)];
        let mut out = DMatrix::zeros(rows, rows);
        let mut of_row = Vec::new();
        for m in &model.measurements {
            if let Some(step) = m.step {
                let full = |elements: &[(usize, usize, f64)]| {
                    let mut out = DMatrix::zeros(n, n);
                    for (i, j, v) in elements {
                        out[(*i, *j)] += v;
                    }
                    out
                };
                let f: DMatrix<f64> = full(&model.steps[step].transition);
                let mut now: Vec<_> = maps.last().unwrap().iter().map(|map| &f * map).collect();
                now.push(DMatrix::identity(n, n));
                covariances.push(full(&model.steps[step].noise));
                maps.push(now);
            }
            let mut h = DVector::zeros(n);
            m.states.iter().for_each(|(i, c)| h[*i] += c);
            of_row.push((h, maps.len() - 1));
        }
        for (i, (hi, ti)) in of_row.iter().enumerate() {
            for (j, (hj, tj)) in of_row.iter().enumerate() {
                let shared = maps[*ti].len().min(maps[*tj].len());
                for k in 0..shared {
                    out[(i, j)] +=
                        (hi.transpose() * &maps[*ti][k] * &covariances[k] * maps[*tj][k].transpose() * hj)[0];
                }
            }
            out[(i, i)] += model.measurements[i].variance;
        }
        out
    }

    #[test]
    fn whitening_is_the_inverse_cholesky_factor_of_the_covariance() {
        let seed = 11;
        println!("seed {seed}");
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let n = 3;
        let mut any = |scale: f64| -> Vec<f64> { (0..n * n).map(|_| scale * random.random_range(-1.0..1.0)).collect() };
        let squared = |m: Vec<f64>| {
            let m = DMatrix::from_row_slice(n, n, &m);
            (&m * m.transpose()).as_slice().to_vec()
        };
        let steps: Vec<Step> = (0..5)
            .map(|k| {
                let mut transition = any(0.8);
                // In some steps a state only decays.
                if k % 2 == 1 {
                    (transition[3], transition[5]) = (0.0, 0.0);
                }
                step(n, &transition, &squared(any(0.5)))
            })
            .collect();
        let initial = squared(any(2.0));
        // More rows at a time than wait for each other.
        let (rows, at_once) = (36, 6);
        let measurements = (0..rows)
            .map(|row| Measurement {
                step: (row > 0 && row % at_once == 0).then(|| row / at_once - 1),
                states: vec![(row % n, 1.0), ((row + 1) % n, 0.3 * row as f64)],
                variance: 0.1 + 0.05 * row as f64,
            })
            .collect();
        let model = StateSpace { states: n, initial, steps, measurements };
        let columns: Vec<Vec<f64>> =
            (0..11).map(|_| (0..rows).map(|_| random.random_range(-1.0..1.0)).collect()).collect();
        let mut white = Columns::of(&columns);
        let mut filter = Whitener::new(n, &model.initial, &mut white);
        for m in &model.measurements {
            m.step.iter().for_each(|step| filter.advance(&model.steps[*step]));
            filter.measure(&m.states, m.variance);
        }
        let log_det = filter.log_det();
        let factor = Cholesky::new(dense(&model)).unwrap().l();
        let expected = 2.0 * factor.diagonal().iter().map(|d| d.ln()).sum::<f64>();
        assert!((log_det - expected).abs() < 1e-9, "{log_det} {expected}");
        for (k, column) in columns.iter().enumerate() {
            let by_factor = factor.solve_lower_triangular(&DVector::from_column_slice(column)).unwrap();
            for row in 0..rows {
                assert!((white.row(row)[k] - by_factor[row]).abs() < 1e-9);
            }
        }
    }
}
