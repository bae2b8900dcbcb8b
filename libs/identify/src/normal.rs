//! Least squares from sums: what a linear fit of any subset of columns gives.

use nalgebra::{DMatrix, DVector};

/// Normal equations of some rows: `J'J`, `J'r`, `r'r`, and the degrees of freedom of `r`.
#[derive(Clone, Debug)]
pub(crate) struct Normal {
    pub(crate) g: DMatrix<f64>,
    pub(crate) b: DVector<f64>,
    pub(crate) c: f64,
    pub(crate) freedom: f64,
}

/// A fit of some columns.
#[derive(Clone, Debug)]
pub(crate) struct Fit {
    /// Coefficients, in the order of the columns asked for.
    pub(crate) value: DVector<f64>,
    /// Their covariance where the rows are white.
    pub(crate) covariance: DMatrix<f64>,
    /// By how much the sum of squares falls.
    pub(crate) gain: f64,
}

impl Normal {
    pub(crate) fn zero(columns: usize) -> Self {
        Self { g: DMatrix::zeros(columns, columns), b: DVector::zeros(columns), c: 0.0, freedom: 0.0 }
    }

    /// The sum of several.
    pub(crate) fn sum<'a>(columns: usize, parts: impl Iterator<Item = &'a Self>) -> Self {
        let mut all = Self::zero(columns);
        for part in parts {
            all.g += &part.g;
            all.b += &part.b;
            all.c += part.c;
            all.freedom += part.freedom;
        }
        all
    }

    /// Of some columns only.
    pub(crate) fn of(&self, columns: &[usize]) -> Self {
        let n = columns.len();
        let g = DMatrix::from_fn(n, n, |i, j| self.g[(columns[i], columns[j])]);
        Self { g, b: DVector::from_fn(n, |i, _| self.b[columns[i]]), c: self.c, freedom: self.freedom }
    }

    /// With the first `count` columns taken out, normal a priori with variance `1 / prior`: they absorb what they may.
    pub(crate) fn absorbed(&self, count: usize, prior: f64) -> Self {
        if count == 0 {
            return self.clone();
        }
        let rest = self.b.len() - count;
        let own = self.g.view((0, 0), (count, count)) + prior * DMatrix::identity(count, count);
        let cross = self.g.view((0, count), (count, rest)).into_owned();
        let right = self.b.rows(0, count).into_owned();
        let mut out = self.clone();
        if let Some(factor) = own.cholesky() {
            let solved = factor.solve(&cross);
            let value = factor.solve(&right);
            let reduced = self.g.view((count, count), (rest, rest)) - cross.tr_mul(&solved);
            out.g.view_mut((count, count), (rest, rest)).copy_from(&reduced);
            out.b.rows_mut(count, rest).copy_from(&(self.b.rows(count, rest) - cross.tr_mul(&value)));
            out.c = self.c - right.dot(&value);
        }
        // What is absorbed is no longer there to be asked.
        out.g.view_mut((0, 0), (count, count)).fill(0.0);
        out.g.view_mut((0, count), (count, rest)).fill(0.0);
        out.g.view_mut((count, 0), (rest, count)).fill(0.0);
        out.b.rows_mut(0, count).fill(0.0);
        out
    }

    /// The fit of some columns; directions that the rows do not determine stay at zero.
    pub(crate) fn fit(&self, columns: &[usize]) -> Fit {
        let n = columns.len();
        if n == 0 {
            return Fit { value: DVector::zeros(0), covariance: DMatrix::zeros(0, 0), gain: 0.0 };
        }
        let scale: Vec<f64> = columns.iter().map(|i| self.g[(*i, *i)].max(0.0).sqrt()).collect();
        let unit = |i: usize| if scale[i] > 1e-12 { 1.0 / scale[i] } else { 0.0 };
        let g = DMatrix::from_fn(n, n, |i, j| self.g[(columns[i], columns[j])] * unit(i) * unit(j));
        let b = DVector::from_fn(n, |i, _| self.b[columns[i]] * unit(i));
        let eigen = g.symmetric_eigen();
        let mut inverse = DMatrix::zeros(n, n);
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > 1e-7 {
                inverse += vector * vector.transpose() / *value;
            }
        }
        let scaled = &inverse * &b;
        let gain = b.dot(&scaled);
        let value = DVector::from_fn(n, |i, _| scaled[i] * unit(i));
        let covariance = DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * unit(i) * unit(j));
        Fit { value, covariance, gain }
    }

    /// Change of the sum of squares where these columns have these values: negative is better.
    pub(crate) fn change(&self, columns: &[usize], value: &DVector<f64>) -> f64 {
        let mut sum = 0.0;
        for (i, a) in columns.iter().enumerate() {
            sum -= 2.0 * value[i] * self.b[*a];
            for (j, b) in columns.iter().enumerate() {
                sum += value[i] * value[j] * self.g[(*a, *b)];
            }
        }
        sum
    }
}
