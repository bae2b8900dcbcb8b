//! Equally long columns of numbers, stored row by row: what a linear filter is applied to all at once.

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
    pub fn of<C: AsRef<[f64]>>(columns: &[C]) -> Self {
        let rows = columns.first().map_or(0, |c| c.as_ref().len());
        assert!(columns.iter().all(|c| c.as_ref().len() == rows), "columns of one length");
        let width = columns.len();
        let mut data = vec![0.0; rows * width];
        // Some rows at a time, so that what is written stays near.
        const TOGETHER: usize = 64;
        for (k, block) in data.chunks_mut(TOGETHER * width.max(1)).enumerate() {
            for (j, column) in columns.iter().enumerate() {
                let from = &column.as_ref()[k * TOGETHER..];
                block[j..].iter_mut().step_by(width).zip(from).for_each(|(to, from)| *to = *from);
            }
        }
        Self { width, data }
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

    /// A copy of one column.
    pub fn column(&self, column: usize) -> Vec<f64> {
        (0..self.rows()).map(|row| self.data[row * self.width + column]).collect()
    }
}
