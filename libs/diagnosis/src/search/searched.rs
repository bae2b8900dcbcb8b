//! What a search came to.

use super::space::{Found, HyperPoint, Search};
use crate::problem::{Kept, Linearized, Member, Present, Problem, Slope};
use fss_multibody::ModelError;

/// What the search came to.
pub(crate) struct Searched<'a> {
    pub(crate) search: Search<'a>,
    pub(crate) points: Vec<HyperPoint>,
    /// All sets that were judged, most probable first, each with its probability.
    pub(crate) sets: Vec<(Found, f64)>,
    /// The most probable set at its estimate.
    pub(crate) model: Vec<Present>,
    /// Hyper-parameters that suit it best.
    pub(crate) hyper: Vec<f64>,
    pub(crate) linearized: Linearized,
}

impl Searched<'_> {
    /// Place of the first uncertain value among the search's parameters.
    pub(crate) fn uncertain_at(&self) -> usize {
        self.search.parameters.len() - self.search.problem.uncertain.len()
    }

    /// Whether the model is more probable in another problem of the same runs, whose servos are tuned as was found here.
    pub(crate) fn is_likelier_in(&self, other: &Problem) -> Result<bool, ModelError> {
        let is_present = |c: usize, _: &Member| self.model.iter().any(|p| p.candidate == c);
        let log_posterior = |problem: &Problem, kept: Kept| -> Result<f64, ModelError> {
            let about = problem.linearized(&self.model, Slope::Secant, &is_present, kept)?;
            Ok(Search::new(problem).log_posterior((&about, &self.hyper), &self.sets[0].0))
        };
        let problem = self.search.problem;
        let own = log_posterior(problem, Kept::All(problem.of_uncertain(&self.linearized)))?;
        Ok(log_posterior(other, Kept::Nothing)? > own)
    }

    /// Posterior means of the uncertain values with the best set, in stated standard deviations.
    pub(crate) fn uncertain_means(&self) -> Vec<f64> {
        self.search.values(&self.points, &self.sets[0].0)
    }
}
