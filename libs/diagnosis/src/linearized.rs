//! Columns of a linearization about a model.

/// How the columns of a present cause are taken.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slope {
    /// Through its absence: absent and present are both exact.
    Secant,
    /// At its present value, for estimating this.
    Tangent,
}

/// What a parameter does to each row of a block, or the data. There are many, so they are kept in single precision: what a secant leaves
/// out, and all noise, is far coarser.
pub(crate) type Column = Vec<f32>;

/// Columns of every block about a model: the data, then every parameter; an empty one is not known.
#[derive(Default)]
pub(crate) struct Linearized {
    pub(crate) columns: Vec<Vec<Column>>,
    /// Size of each parameter in the model, which may vary from run to run.
    pub(crate) size: Vec<f64>,
}

/// What a coordinate does, in proportion: the difference of two predictions over its size.
pub(crate) fn difference(a: &[f64], b: &[f64], by: f64) -> Column {
    a.iter().zip(b).map(|(a, b)| ((a - b) / by) as f32).collect()
}
