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
    pub fn of(columns: &[Vec<f64>]) -> Self {
        let rows = columns.first().map_or(0, Vec::len);
        assert!(columns.iter().all(|c| c.len() == rows), "columns of one length");
        let data = (0..rows).flat_map(|row| columns.iter().map(move |c| c[row])).collect();
        Self { width: columns.len(), data }
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

    /// A copy of one column.
    pub fn column(&self, column: usize) -> Vec<f64> {
        (0..self.rows()).map(|row| self.data[row * self.width + column]).collect()
    }
}
