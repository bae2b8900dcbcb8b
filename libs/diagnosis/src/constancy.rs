//! Whether a cause is one: of the same size in every run, as what is wrong with a vehicle is, or of another in each, as what only looks
//! like it.

use crate::gram::{GramCache, of_own_sizes};
use crate::search::{Searched, log_sum};
use fss_estimation::evidence::{Gram, Slab, SpikePosterior};
use fss_plant::Response;

/// Prior probability that what the data ask for is of one size.
const IS_ONE: f64 = 0.95;

/// For each cause of the best set, the probability that it has one size in all runs, its rival being one that has a size of its own in
/// each, from the same slab. The ratio of their marginal likelihoods is 1 for a cause that a single run shows.
pub(crate) fn constancies(searched: &Searched) -> Vec<f64> {
    let (best, problem) = (&searched.sets[0].0, searched.search.problem);
    let parameters = searched.search.parameters_with(&best.causes).0;
    let runs = problem.grams_of_runs(&searched.linearized, &searched.hyper, &parameters, &GramCache::default());
    let runs = runs.unwrap_or_default();
    let of = |place: usize| {
        let own = &problem.candidates[best.causes[place]];
        let has_size = !own.is_law && own.prior.response != Response::Discrete;
        let odds = if has_size { log_odds(searched, &runs, &parameters, place) } else { None };
        odds.map_or(1.0, |log_odds| (1.0 + (-log_odds).exp() * (1.0 - IS_ONE) / IS_ONE).recip())
    };
    (0..best.causes.len()).map(of).collect()
}

/// Logarithm of the ratio of the marginal likelihoods: the cause at a place of the best set with one size, over a size in each run.
fn log_odds(searched: &Searched, runs: &[Gram], parameters: &[usize], place: usize) -> Option<f64> {
    let (best, problem) = (&searched.sets[0].0, searched.search.problem);
    let of_cause: Vec<usize> = problem.parameters_of(best.causes[place]).collect();
    let places: Vec<usize> = (0..parameters.len()).filter(|at| of_cause.contains(&parameters[*at])).collect();
    let one = likelihood(searched, (runs, parameters), place, &[])?;
    let own = likelihood(searched, (runs, parameters), place, &places)?;
    Some(one - own)
}

/// Logarithm of the marginal likelihood of the best set, the parameters at some places with a value of their own in each run; summed
/// over the classes of one cause.
fn likelihood(
    searched: &Searched,
    (runs, parameters): (&[Gram], &[usize]),
    place: usize,
    own: &[usize],
) -> Option<f64> {
    let (best, problem) = (&searched.sets[0].0, searched.search.problem);
    let gram = of_own_sizes(runs, own)?;
    let mut spikes = problem.spikes_of(&searched.linearized, parameters);
    let first = spikes.len();
    let of_own: Vec<f64> = own.iter().map(|at| spikes[*at]).collect();
    (1..runs.len()).for_each(|_| spikes.extend_from_slice(&of_own));
    let posterior = SpikePosterior::new(&gram, &spikes)?;
    let (_, position) = searched.search.parameters_with(&best.causes);
    let with_class = |class: usize| {
        let mut classes = best.classes.clone();
        classes[place] = class;
        let mut slabs = searched.search.slabs(&best.causes, &classes, &position)?;
        // Those of the first run, then the same of each other one.
        let of_first = slabs.clone();
        for run in 1..runs.len() {
            let there = |slab: &Slab| {
                let i = own.iter().position(|at| *at == slab.parameter)?;
                Some(Slab { parameter: first + (run - 1) * own.len() + i, ..*slab })
            };
            slabs.extend(of_first.iter().filter_map(there));
        }
        Some(posterior.of_set(&slabs)?.log_evidence)
    };
    let values: Option<Vec<f64>> = (0..problem.candidates[best.causes[place]].classes()).map(with_class).collect();
    values.map(|values| log_sum(&values))
}
