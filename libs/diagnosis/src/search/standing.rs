//! Where a search stands still: whether its servos are tuned in another way.

use super::space::{Found, HyperPoint, Search};
use crate::problem::{Linearized, Member, Present, Problem, Slope};
use crate::tuning::Tuning;
use fss_multibody::ModelError;

/// A set of causes at its estimate, about which everything is linearized.
pub(crate) struct Standing<'s> {
    pub(super) search: &'s Search<'s>,
    pub(super) points: &'s [HyperPoint],
    pub(crate) linearized: &'s Linearized,
    pub(super) hyper: &'s [f64],
    pub(super) set: &'s Found,
    pub(super) model: &'s [Present],
}

impl Standing<'_> {
    /// What servos' answers hang on, with this set.
    pub(crate) fn tuning(&self) -> Result<Tuning, ModelError> {
        let in_joints = self.search.values_in_joints((self.linearized, self.hyper), self.model)?;
        Ok(Tuning::of(&self.search.problem.uncertain, &self.search.values(self.points, self.set), &in_joints))
    }

    /// Whether the model is more probable in another problem of the same runs, whose servos are tuned in another way.
    pub(crate) fn is_likelier_in(&self, other: &Problem) -> Result<bool, ModelError> {
        let is_present = |c: usize, _: &Member| self.model.iter().any(|p| p.candidate == c);
        let log_posterior = |problem: &Problem, known: Linearized| -> Result<f64, ModelError> {
            let about = problem.linearized((self.model, self.hyper), Slope::Secant, &is_present, known)?;
            Ok(Search::new(problem).log_posterior((&about, self.hyper), self.set))
        };
        let problem = self.search.problem;
        let own = log_posterior(problem, problem.of_uncertain(self.linearized))?;
        Ok(log_posterior(other, other.of_causes(other.known_from(problem, self.linearized), true))? > own)
    }
}
