//! What a search came to.

use super::intervals::Estimate;
use super::space::{Found, HyperPoint, Search};
use crate::problem::{Linearized, Present};

/// What the search came to.
pub(crate) struct Searched<'a> {
    pub(crate) search: Search<'a>,
    pub(crate) points: Vec<HyperPoint>,
    /// All sets that were judged, most probable first, each with its probability.
    pub(crate) sets: Vec<(Found, f64)>,
    /// The most probable set at its estimate.
    pub(crate) model: Vec<Present>,
    /// How well it is known; `None` where the set has no posterior.
    pub(crate) estimate: Option<Estimate>,
    /// Hyper-parameters that suit it best.
    pub(crate) hyper: Vec<f64>,
    pub(crate) linearized: Linearized,
}

impl Searched<'_> {
    /// Place of the first uncertain value among the search's parameters.
    pub(crate) fn uncertain_at(&self) -> usize {
        self.search.parameters.len() - self.search.problem.uncertain.len()
    }

    /// Posterior means of the uncertain values with the best set, in stated standard deviations.
    pub(crate) fn uncertain_means(&self) -> Vec<f64> {
        self.search.values(&self.points, &self.sets[0].0)
    }
}
