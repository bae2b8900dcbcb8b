//! A mean that grows sample by sample.

/// Mean and spread of vectors (Welford, Technometrics 4, 1962).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mean<const N: usize> {
    pub(crate) count: u32,
    pub(crate) value: [f64; N],
    squares: [f64; N],
}

impl<const N: usize> Default for Mean<N> {
    fn default() -> Self {
        Self { count: 0, value: [0.0; N], squares: [0.0; N] }
    }
}

impl<const N: usize> Mean<N> {
    pub(crate) fn add(&mut self, sample: &[f64; N]) {
        self.count += 1;
        for ((mean, squares), x) in self.value.iter_mut().zip(&mut self.squares).zip(sample) {
            let off = x - *mean;
            *mean += off / f64::from(self.count);
            *squares += off * (x - *mean);
        }
    }

    /// Standard deviations of single samples; zero of fewer than two.
    pub(crate) fn std(&self) -> [f64; N] {
        let freedom = f64::from(self.count.saturating_sub(1).max(1));
        self.squares.map(|squares| (squares / freedom).sqrt())
    }
}
