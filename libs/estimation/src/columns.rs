//! Equally long columns of numbers, stored row by row: what a linear filter is applied to all at once.

use multiversion::multiversion;

/// A dense matrix, row-major: a row is a scalar measurement, a column a time series to be whitened with the others.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    width: usize,
    data: Vec<f64>,
}

impl Columns {
    /// The columns side by side; all must be as long as the first.
    ///
    /// # Panics
    /// Where the columns differ in length.
    pub fn of<T: Copy + Into<f64>, C: AsRef<[T]>>(columns: &[C]) -> Self {
        let mut out = Self::default();
        out.fill_from(columns);
        out
    }

    /// Becomes these columns side by side, in the memory that it has.
    ///
    /// # Panics
    /// Where the columns differ in length.
    pub fn fill_from<T: Copy + Into<f64>, C: AsRef<[T]>>(&mut self, columns: &[C]) {
        let rows = columns.first().map_or(0, |c| c.as_ref().len());
        assert!(columns.iter().all(|c| c.as_ref().len() == rows), "columns of one length");
        let width = columns.len();
        self.width = width;
        self.data.resize(rows * width, 0.0);
        // Some rows at a time, so that what is written stays near.
        const TOGETHER: usize = 64;
        for (k, block) in self.data.chunks_mut(TOGETHER * width.max(1)).enumerate() {
            for (j, column) in columns.iter().enumerate() {
                let from = &column.as_ref()[k * TOGETHER..];
                block[j..].iter_mut().step_by(width).zip(from).for_each(|(to, from)| *to = (*from).into());
            }
        }
    }

    /// Becomes a copy of others, in the memory that it has.
    pub fn copy_from(&mut self, other: &Self) {
        self.width = other.width;
        self.data.clone_from(&other.data);
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.data.len().checked_div(self.width).unwrap_or(0)
    }

    /// One row.
    pub fn row(&self, row: usize) -> &[f64] {
        &self.data[row * self.width..(row + 1) * self.width]
    }

    /// One row, to be changed.
    pub fn row_mut(&mut self, row: usize) -> &mut [f64] {
        &mut self.data[row * self.width..(row + 1) * self.width]
    }

    /// All values, row by row.
    pub fn values(&self) -> &[f64] {
        &self.data
    }

    /// The Gram matrix of the columns, row-major: scalar products of each with each.
    pub fn products(&self) -> Vec<f64> {
        let width = self.width;
        let mut out = vec![0.0; width * width];
        let together = 4 * width;
        let whole = self.data.len() - self.data.len().checked_rem(together).unwrap_or(0);
        let (fours, rest) = self.data.split_at(whole);
        fours.chunks_exact(together.max(1)).for_each(|rows| add_products(rows, width, &mut out));
        let mut last = rest.to_vec();
        last.resize(together, 0.0);
        add_products(&last, width, &mut out);
        for i in 0..width {
            (0..i).for_each(|j| out[j * width + i] = out[i * width + j]);
        }
        out
    }

    /// A copy of one column.
    pub fn column(&self, column: usize) -> Vec<f64> {
        (0..self.rows()).map(|row| self.data[row * self.width + column]).collect()
    }
}

/// Adds the products of the numbers in each of four rows to the lower triangle of a Gram matrix.
#[multiversion(targets("x86_64+avx2+fma", "aarch64+neon"))]
fn add_products(rows: &[f64], width: usize, out: &mut [f64]) {
    let [a, b, c, d] = std::array::from_fn(|k| &rows[k * width..(k + 1) * width]);
    for i in 0..width {
        let by = [a[i], b[i], c[i], d[i]];
        let factors = a[..=i].iter().zip(&b[..=i]).zip(&c[..=i]).zip(&d[..=i]);
        for (to, (((a, b), c), d)) in out[i * width..=i * width + i].iter_mut().zip(factors) {
            *to += (by[0] * a + by[1] * b) + (by[2] * c + by[3] * d);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_each_column_with_each() {
        let columns: Vec<Vec<f64>> = (0..3).map(|j| (0..6).map(|i| f64::from(i * i + j) - 7.0).collect()).collect();
        let products = Columns::of(&columns).products();
        for (i, a) in columns.iter().enumerate() {
            for (j, b) in columns.iter().enumerate() {
                let expected: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                assert!((products[3 * i + j] - expected).abs() < 1e-9, "{i} {j}");
            }
        }
        assert!(Columns::default().products().is_empty());
    }
}
