//! A Kalman filter that whitens many columns at once: its gains depend on the model alone, so that one pass over the
//! covariance serves every column.
//!
//! The model is `x_{k+1} = Phi_k x_k + w_k`, `cov w_k = Q_k`; each row of the columns is a scalar measurement `h . x + v`,
//! `var v` given, in order of time. The innovations over their standard deviations are a linear map of the column,
//! `L^-1 y` with `L L'` the covariance of all rows (Kailath, Sayed and Hassibi, *Linear Estimation*, 2000, chapter 9).

use crate::Columns;

/// A step from one time of measurement to the next; matrices by their elements that are not 0: row, column, value.
#[derive(Clone, Debug, Default)]
pub struct Step {
    /// Transition, n x n.
    pub transition: Vec<(usize, usize, f64)>,
    /// Covariance of the process noise of the step, n x n, with the elements on both sides of its diagonal.
    pub noise: Vec<(usize, usize, f64)>,
}

impl Step {
    /// From the matrices n x n, row-major.
    pub fn of_dense(n: usize, transition: &[f64], noise: &[f64]) -> Self {
        Self { transition: nonzero(transition, n), noise: nonzero(noise, n) }
    }
}

/// A scalar measurement.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Step that leads to the time of this measurement from that of the last one; `None` at the same time.
    pub step: Option<usize>,
    /// Coefficients of the states that it depends on.
    pub states: Vec<(usize, f64)>,
    /// Variance of its noise, larger than 0.
    pub variance: f64,
}

/// A linear-Gaussian state-space model of a series of scalar measurements.
#[derive(Clone, Debug)]
pub struct StateSpace {
    /// Number of states n.
    pub states: usize,
    /// Covariance of the states at the first measurement, n x n, row-major.
    pub initial: Vec<f64>,
    /// Steps that the measurements refer to.
    pub steps: Vec<Step>,
    /// Measurements in order of time, one for each row of the columns.
    pub measurements: Vec<Measurement>,
}

impl StateSpace {
    /// Whitens the columns in place and returns the logarithm of the determinant of the rows' covariance.
    ///
    /// # Panics
    /// Where the columns have another number of rows than the model has measurements.
    pub fn whiten(&self, columns: &mut Columns) -> f64 {
        assert_eq!(columns.rows(), self.measurements.len(), "a row for each measurement");
        let (n, width) = (self.states, columns.width());
        let mut covariance = self.initial.clone();
        let (mut means, mut next) = (vec![0.0; n * width], vec![0.0; n * width]);
        let mut scratch = vec![0.0; n * n];
        let mut gain = vec![0.0; n];
        let mut log_det = 0.0;
        for (row, measurement) in self.measurements.iter().enumerate() {
            if let Some(step) = measurement.step {
                let step = &self.steps[step];
                advance_means(&step.transition, width, &means, &mut next);
                std::mem::swap(&mut means, &mut next);
                advance_covariance(step, n, &mut covariance, &mut scratch);
            }
            let variance = project(&covariance, measurement, &mut gain);
            let sd = variance.sqrt();
            log_det += variance.ln();
            let values = columns.row_mut(row);
            for &(state, coefficient) in &measurement.states {
                let mean = &means[state * width..(state + 1) * width];
                values.iter_mut().zip(mean).for_each(|(v, m)| *v -= coefficient * m);
            }
            for v in values.iter_mut() {
                *v /= sd;
            }
            for (state, g) in gain.iter().enumerate().filter(|(_, g)| **g != 0.0) {
                let mean = &mut means[state * width..(state + 1) * width];
                let g = g / sd;
                mean.iter_mut().zip(values.iter()).for_each(|(m, v)| *m += g * v);
            }
            for i in 0..n {
                let g = gain[i] / variance;
                if g != 0.0 {
                    let row = &mut covariance[i * n..(i + 1) * n];
                    row.iter_mut().zip(&gain).for_each(|(p, other)| *p -= g * other);
                }
            }
        }
        log_det
    }
}

/// Places and values of a matrix's elements that are not 0.
fn nonzero(matrix: &[f64], n: usize) -> Vec<(usize, usize, f64)> {
    let places = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
    places.zip(matrix).filter(|(_, v)| **v != 0.0).map(|((i, j), v)| (i, j, *v)).collect()
}

fn advance_means(transition: &[(usize, usize, f64)], width: usize, means: &[f64], next: &mut [f64]) {
    next.fill(0.0);
    for &(i, j, f) in transition {
        let from = &means[j * width..(j + 1) * width];
        next[i * width..(i + 1) * width].iter_mut().zip(from).for_each(|(to, from)| *to += f * from);
    }
}

/// `P <- F P F' + Q`, kept symmetric.
fn advance_covariance(step: &Step, n: usize, p: &mut [f64], half: &mut [f64]) {
    half.fill(0.0);
    for &(i, j, f) in &step.transition {
        let (to, from) = (&mut half[i * n..(i + 1) * n], &p[j * n..(j + 1) * n]);
        to.iter_mut().zip(from).for_each(|(to, from)| *to += f * from);
    }
    // The other side by rows of the transpose, F (F P)'.
    p.fill(0.0);
    for r in 0..n {
        for c in 0..r {
            half.swap(r * n + c, c * n + r);
        }
    }
    for &(i, j, f) in &step.transition {
        let (to, from) = (&mut p[i * n..(i + 1) * n], &half[j * n..(j + 1) * n]);
        to.iter_mut().zip(from).for_each(|(to, from)| *to += f * from);
    }
    for &(i, j, q) in &step.noise {
        p[i * n + j] += q;
    }
    for i in 0..n {
        for j in 0..i {
            let mean = 0.5 * (p[i * n + j] + p[j * n + i]);
            p[i * n + j] = mean;
            p[j * n + i] = mean;
        }
    }
}

/// Variance of a measurement; `gain` becomes the covariance of the states with it.
fn project(covariance: &[f64], measurement: &Measurement, gain: &mut [f64]) -> f64 {
    let n = gain.len();
    gain.fill(0.0);
    for &(state, coefficient) in &measurement.states {
        // The covariance is symmetric: a row is a column.
        let row = &covariance[state * n..(state + 1) * n];
        gain.iter_mut().zip(row).for_each(|(g, c)| *g += coefficient * c);
    }
    measurement.states.iter().map(|(state, c)| c * gain[*state]).sum::<f64>() + measurement.variance
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use nalgebra::{Cholesky, DMatrix, DVector};
    use rand::{RngExt, SeedableRng};

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
                    elements.iter().for_each(|(i, j, v)| out[(*i, *j)] += v);
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
        let steps: Vec<Step> = (0..5).map(|_| Step::of_dense(n, &any(0.8), &squared(any(0.5)))).collect();
        let initial = squared(any(2.0));
        let measurements = (0..12)
            .map(|row| Measurement {
                step: (row > 0 && row % 2 == 0).then_some(row / 2 - 1),
                states: vec![(row % n, 1.0), ((row + 1) % n, 0.3 * row as f64)],
                variance: 0.1 + 0.05 * row as f64,
            })
            .collect();
        let model = StateSpace { states: n, initial, steps, measurements };
        let columns: Vec<Vec<f64>> =
            (0..4).map(|_| (0..12).map(|_| random.random_range(-1.0..1.0)).collect()).collect();
        let mut white = Columns::of(&columns);
        let log_det = model.whiten(&mut white);
        let factor = Cholesky::new(dense(&model)).unwrap().l();
        let expected = 2.0 * factor.diagonal().iter().map(|d| d.ln()).sum::<f64>();
        assert!((log_det - expected).abs() < 1e-9, "{log_det} {expected}");
        for (k, column) in columns.iter().enumerate() {
            let by_factor = factor.solve_lower_triangular(&DVector::from_column_slice(column)).unwrap();
            for row in 0..12 {
                assert!((white.row(row)[k] - by_factor[row]).abs() < 1e-9);
            }
        }
    }
}
