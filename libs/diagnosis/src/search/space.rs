//! What is searched: the causes and their priors, sets of causes, and the hyper-parameters at which they are compared.

use crate::problem::{Present, Problem};
use fss_estimation::evidence::{Slab, SpikePosterior};
use nalgebra::DMatrix;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Mutex, PoisonError};

/// Variations from run to run that sets are compared at.
pub(super) const VARIATIONS: [f64; 4] = [1e-4, 0.03, 0.1, 0.3];

/// The candidates, and which of them a round looks at.
pub(crate) struct Search<'a> {
    pub(crate) problem: &'a Problem,
    /// Parameters in the Gram matrices, and the place of each of the problem's parameters among them.
    pub(super) parameters: Vec<usize>,
    pub(super) position: Vec<Option<usize>>,
    /// Logarithm of each candidate's prior among all.
    pub(super) log_prior: Vec<f64>,
    /// Candidates that the present round looks at.
    pub(crate) chosen: Vec<usize>,
    /// Causes of the model that everything is linearized about: they may vary from run to run.
    pub(super) varying: Vec<usize>,
    /// Pairs of candidates that these data cannot tell apart at all, the smaller first, with the one of them that was not in the
    /// model and the coordinates at which it does what the other did.
    pub(crate) identical: BTreeMap<(usize, usize), (usize, Vec<f64>)>,
    /// How the likelihood bends about the hyper-parameters of the present model: those of a set that promises more are sought with that.
    curvature: Mutex<Option<DMatrix<f64>>>,
}

/// Hyper-parameters and everything that follows from the data at them.
pub(crate) struct HyperPoint {
    pub(crate) hyper: Vec<f64>,
    pub(super) log_prior: f64,
    /// Causes that vary from run to run, of those that the search says may; `None` where none varies by anything.
    pub(super) varying: Option<Vec<usize>>,
    pub(crate) posterior: SpikePosterior,
}

impl HyperPoint {
    /// Logarithm of the marginal likelihood with these causes, and of the prior of the hyper-parameters.
    pub(super) fn log_posterior(&self, slabs: &[Slab]) -> Option<f64> {
        Some(self.posterior.of_set(slabs)?.log_evidence + self.log_prior)
    }
}

/// A set of causes with its posterior.
#[derive(Clone, Debug)]
pub(crate) struct Found {
    /// Candidates, in the order in which they were added.
    pub(crate) causes: Vec<usize>,
    /// Which slab or point each is in.
    pub(crate) classes: Vec<usize>,
    /// Logarithm of the marginal likelihood, hyper-parameters at their best, summed over the classes of the last cause.
    pub(crate) log_likelihood: f64,
    /// The same with the prior of the set.
    pub(crate) log_posterior: f64,
}

impl<'a> Search<'a> {
    pub(super) fn new(problem: &'a Problem) -> Self {
        let (parameters, position) = (Vec::new(), Vec::new());
        let mut count: HashMap<&str, usize> = HashMap::new();
        problem.candidates.iter().for_each(|c| *count.entry(&c.kind).or_default() += 1);
        let kinds = count.len() as f64;
        let log_prior = problem.candidates.iter().map(|c| -(kinds * count[c.kind.as_str()] as f64).ln()).collect();
        Self {
            problem,
            parameters,
            position,
            log_prior,
            chosen: Vec::new(),
            varying: Vec::new(),
            identical: BTreeMap::new(),
            curvature: Mutex::default(),
        }
    }

    pub(super) fn curvature(&self) -> Option<DMatrix<f64>> {
        self.curvature.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(super) fn note_curvature(&self, curvature: Option<DMatrix<f64>>) {
        *self.curvature.lock().unwrap_or_else(PoisonError::into_inner) = curvature;
    }

    pub(super) fn names(&self, model: &[Present]) -> String {
        let effects: Vec<String> = model
            .iter()
            .flat_map(|p| self.problem.candidates[p.candidate].at(&p.coordinates))
            .map(|e| e.to_string())
            .collect();
        effects.join(", ")
    }

    /// Parameters of some candidates and the uncertain values, and where each of the problem's is among them.
    pub(crate) fn parameters_with(&self, candidates: &[usize]) -> (Vec<usize>, Vec<Option<usize>>) {
        let own = candidates.iter().flat_map(|c| self.problem.parameters_of(*c));
        let parameters: Vec<usize> = own.chain(self.problem.uncertain_parameters()).collect();
        let mut position = vec![None; self.problem.parameters()];
        parameters.iter().enumerate().for_each(|(at, p)| position[*p] = Some(at));
        (parameters, position)
    }
}
