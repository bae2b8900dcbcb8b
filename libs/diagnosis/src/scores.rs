//! Predictive scores of the causes: of validation runs, and of each fitted run from the others. They judge, and choose nothing.

use crate::gram::GramCache;
use crate::problem::{Linearized, Member, Problem, Slope};
use crate::search::Searched;
use fss_estimation::evidence::{Gram, SpikePosterior};
use fss_multibody::ModelError;

/// For each cause of the best set, what it adds to the logarithm of the predictive density (nats).
#[derive(Default)]
pub(crate) struct Scores {
    pub(crate) validation: Vec<f64>,
    pub(crate) left_out: Vec<f64>,
}

pub(crate) fn scores(searched: &Searched, validation: Option<&Problem>) -> Result<Scores, ModelError> {
    let best = &searched.sets[0].0;
    if best.causes.is_empty() {
        return Ok(Scores::default());
    }
    let problem = searched.search.problem;
    let (parameters, _) = searched.search.parameters_with(&best.causes);
    let fitted = problem
        .grams_of_runs(&searched.linearized, &searched.hyper, &parameters, &GramCache::default())
        .unwrap_or_default();
    let all = sum(&fitted);
    let mut out = Scores::default();
    let without_each_run: Vec<Gram> = (0..fitted.len())
        .map(|left_out| {
            sum(&fitted.iter().enumerate().filter(|(k, _)| *k != left_out).map(|(_, g)| g.clone()).collect::<Vec<_>>())
        })
        .collect();
    let whole = |gram: &Gram, leaving: Option<usize>| evidence(searched, gram, &parameters, leaving).unwrap_or(0.0);
    for place in 0..best.causes.len() {
        let gain = |more: &Gram, less: &Gram| {
            (whole(more, None) - whole(less, None)) - (whole(more, Some(place)) - whole(less, Some(place)))
        };
        out.left_out.push(without_each_run.iter().map(|less| gain(&all, less)).sum());
    }
    if let Some(validation) = validation.filter(|v| !v.is_empty()) {
        let wanted = |c: usize, _: &Member| best.causes.contains(&c);
        let linearized: Linearized =
            validation.linearized((&searched.model, &searched.hyper), Slope::Secant, &wanted, Linearized::default())?;
        let grams = validation
            .grams_of_runs(&linearized, &searched.hyper, &parameters, &GramCache::default())
            .unwrap_or_default();
        let mut together = fitted;
        together.extend(grams);
        let together = sum(&together);
        for place in 0..best.causes.len() {
            let gain = |leaving| whole(&together, leaving) - whole(&all, leaving);
            out.validation.push(gain(None) - gain(Some(place)));
        }
    }
    Ok(out)
}

fn sum(grams: &[Gram]) -> Gram {
    let mut grams = grams.iter();
    let Some(first) = grams.next() else { return Gram { products: nalgebra::DMatrix::zeros(1, 1), log_det: 0.0 } };
    grams.fold(first.clone(), |mut sum, gram| {
        sum.products += &gram.products;
        sum.log_det += gram.log_det;
        sum
    })
}

/// Evidence of the best set, or of it without one cause.
fn evidence(searched: &Searched, gram: &Gram, parameters: &[usize], leaving: Option<usize>) -> Option<f64> {
    let (best, problem) = (&searched.sets[0].0, searched.search.problem);
    let keep = |place: &usize| Some(*place) != leaving;
    let places: Vec<usize> = (0..best.causes.len()).filter(keep).collect();
    let causes: Vec<usize> = places.iter().map(|p| best.causes[*p]).collect();
    let classes: Vec<usize> = places.iter().map(|p| best.classes[*p]).collect();
    let (_, position) = searched.search.parameters_with(&best.causes);
    let spikes = problem.spikes_of(&searched.linearized, parameters);
    let slabs = searched.search.slabs(&causes, &classes, &position)?;
    if gram.products.ncols() != parameters.len() + 1 {
        return None;
    }
    Some(SpikePosterior::new(gram, &spikes)?.of_set(&slabs)?.log_evidence)
}
