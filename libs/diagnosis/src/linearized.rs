//! Columns of a linearization about a model.

/// How the columns of a present cause are taken.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slope {
    /// Through its absence: absent and present are both exact.
    Secant,
    /// At its present value, for estimating this.
    Tangent,
}

/// Columns of every block about a model: the data, then every parameter; an empty one is not known.
#[derive(Default)]
pub(crate) struct Linearized {
    pub(crate) columns: Vec<Vec<Vec<f64>>>,
    /// Size of each parameter in the model, which may vary from run to run.
    pub(crate) size: Vec<f64>,
}

/// What a coordinate does, in proportion: the difference of two predictions over its size.
pub(crate) fn difference(a: &[f64], b: &[f64], by: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| (a - b) / by).collect()
}
