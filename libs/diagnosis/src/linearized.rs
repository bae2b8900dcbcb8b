//! Columns of a linearization about a model: what they are of, which are taken anew.

/// How the columns of a present cause are taken.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slope {
    /// Through its absence: absent and present are both exact.
    Secant,
    /// At its present value, for estimating this.
    Tangent,
}

/// What of earlier columns stays as it is where it is not asked for anew.
pub(crate) enum Kept {
    Nothing,
    /// Columns of causes.
    Causes(Linearized),
    /// Those of uncertain values, too, as far as there are any: they hardly hang on a small change of the model.
    All(Linearized),
}

/// Columns of every block about a model: the data, then every parameter.
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
