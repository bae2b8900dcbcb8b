//! A Kalman filter that whitens many columns at once: its gains depend on the model alone, so that one pass over the
//! covariance serves every column.
//!
//! The model is `x_{k+1} = Phi_k x_k + w_k`, `cov w_k = Q_k`; each row of the columns is a scalar measurement `h . x + v`,
//! `var v` given, in order of time. The innovations over their standard deviations are a linear map of the column,
//! `L^-1 y` with `L L'` the covariance of all rows (Kailath, Sayed and Hassibi, *Linear Estimation*, 2000, chapter 9).

use crate::Columns;
use multiversion::multiversion;

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

    /// Takes over matrices n x n, row-major.
    pub fn set_dense(&mut self, n: usize, transition: &[f64], noise: &[f64]) {
        for (to, from) in [(&mut self.transition, transition), (&mut self.noise, noise)] {
            to.clear();
            let elements = from
                .chunks_exact(n)
                .enumerate()
                .flat_map(|(i, row)| row.iter().enumerate().map(move |(j, v)| (i, j, *v)));
            to.extend(elements.filter(|(_, _, v)| *v != 0.0));
        }
    }
}

/// The filter, on its way through the rows of the columns that it whitens in place.
#[derive(Debug)]
pub struct Whitener<'a> {
    columns: &'a mut Columns,
    states: usize,
    row: usize,
    covariance: Vec<f64>,
    means: Vec<f64>,
    log_det: f64,
    gain: Vec<f64>,
    scratch: Vec<f64>,
    next: Vec<f64>,
}

impl<'a> Whitener<'a> {
    /// Begins with the covariance of the states at the first measurement, n x n, row-major.
    pub fn new(states: usize, initial: Vec<f64>, columns: &'a mut Columns) -> Self {
        let n = states;
        let means = vec![0.0; n * columns.width()];
        let (next, scratch, gain) = (means.clone(), vec![0.0; n * n], vec![0.0; n]);
        Self { columns, states, row: 0, covariance: initial, means, log_det: 0.0, gain, scratch, next }
    }

    /// On to the time of the next measurement.
    pub fn advance(&mut self, step: &Step) {
        advance_means(&step.transition, self.columns.width(), &self.means, &mut self.next);
        std::mem::swap(&mut self.means, &mut self.next);
        advance_covariance(step, self.states, &mut self.covariance, &mut self.scratch);
    }

    /// The next row: the states that it measures, each with its coefficient, and the variance of its noise, larger than 0.
    ///
    /// # Panics
    /// Where the columns have no more rows.
    pub fn measure(&mut self, states: &[(usize, f64)], variance: f64) {
        let variance = project(&self.covariance, states, variance, &mut self.gain);
        self.log_det += variance.ln();
        let values = self.columns.row_mut(self.row);
        self.row += 1;
        update((values, &mut self.means), &mut self.covariance, (states, &self.gain, variance));
    }

    /// Logarithm of the determinant of the covariance of the rows that were measured.
    pub fn log_det(&self) -> f64 {
        self.log_det
    }
}

/// An innovation over its standard deviation, and what it says of the states.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn update(
    (values, means): (&mut [f64], &mut [f64]),
    covariance: &mut [f64],
    (states, gain, variance): (&[(usize, f64)], &[f64], f64),
) {
    let (n, width, sd) = (gain.len(), values.len(), variance.sqrt());
    for &(state, coefficient) in states {
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
    for (i, row) in covariance.chunks_exact_mut(n).enumerate() {
        let g = gain[i] / variance;
        if g != 0.0 {
            row.iter_mut().zip(gain.iter()).for_each(|(p, other)| *p -= g * other);
        }
    }
}

#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn advance_means(transition: &[(usize, usize, f64)], width: usize, means: &[f64], next: &mut [f64]) {
    next.fill(0.0);
    for &(i, j, f) in transition {
        let from = &means[j * width..(j + 1) * width];
        next[i * width..(i + 1) * width].iter_mut().zip(from).for_each(|(to, from)| *to += f * from);
    }
}

/// `P <- F P F' + Q`, kept symmetric.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
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
fn project(covariance: &[f64], states: &[(usize, f64)], noise: f64, gain: &mut [f64]) -> f64 {
    let n = gain.len();
    gain.fill(0.0);
    for &(state, coefficient) in states {
        // The covariance is symmetric: a row is a column.
        let row = &covariance[state * n..(state + 1) * n];
        gain.iter_mut().zip(row).for_each(|(g, c)| *g += coefficient * c);
    }
    states.iter().map(|(state, c)| c * gain[*state]).sum::<f64>() + noise
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
            .map(|_| {
                let mut step = Step::default();
                step.set_dense(n, &any(0.8), &squared(any(0.5)));
                step
            })
            .collect();
        let initial = squared(any(2.0));
        let measurements = (0..12)
            .map(|row| Measurement {
                step: (row > 0 && row % 2 == 0).then(|| row / 2 - 1),
                states: vec![(row % n, 1.0), ((row + 1) % n, 0.3 * row as f64)],
                variance: 0.1 + 0.05 * row as f64,
            })
            .collect();
        let model = StateSpace { states: n, initial, steps, measurements };
        let columns: Vec<Vec<f64>> =
            (0..4).map(|_| (0..12).map(|_| random.random_range(-1.0..1.0)).collect()).collect();
        let mut white = Columns::of(&columns);
        let mut filter = Whitener::new(n, model.initial.clone(), &mut white);
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
            for row in 0..12 {
                assert!((white.row(row)[k] - by_factor[row]).abs() < 1e-9);
            }
        }
    }
}
