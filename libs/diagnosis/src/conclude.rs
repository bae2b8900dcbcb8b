//! From the posterior over sets to an answer: which causes are asserted, what could stand in their place, whether a discrepancy
//! remains.

use crate::diagnosis::{Alternative, Cause, Discrepancy, Verdict};
use crate::problem::{Present, Problem, is_same};
use crate::scores::Scores;
use crate::search::{Estimate, Found, Searched};
use fss_plant::{Effect, Response};

/// Posterior probability from which a cause, or one of its alternatives, is asserted.
pub const ASSERTED: f64 = 0.9;
/// A cause that replaces another at a loss below this is its alternative (nats).
const ALTERNATIVE_NATS: f64 = 3.0;
/// Alternatives below this probability are not told.
const TOLD: f64 = 0.01;
/// A discrepancy this many times the expected one is more than its inference is uncertain by.
const UNEXPECTED: f64 = 3.0;

/// What is asserted and what is not.
pub(crate) struct Concluded {
    pub(crate) verdict: Verdict,
    /// What is of another size in each run.
    pub(crate) remarks: Vec<String>,
    pub(crate) causes: Vec<Cause>,
    pub(crate) suspects: Vec<Cause>,
    pub(crate) laws: Vec<Effect>,
    pub(crate) discrepancy: Vec<Discrepancy>,
    pub(crate) inclusion: Vec<(Effect, f64)>,
    pub(crate) probability_of_none: f64,
}

impl Concluded {
    /// Asserts no cause: what was to be asserted is a suspect.
    pub(crate) fn assert_nothing(&mut self) {
        self.suspects.splice(0..0, self.causes.drain(..));
        self.verdict = Verdict::Unexplained;
    }
}

pub(crate) fn conclude(problem: &Problem, searched: &Searched, scores: &Scores, constancies: &[f64]) -> Concluded {
    let best = &searched.sets[0].0;
    let (mut causes, mut suspects, mut laws): (Vec<(f64, Cause)>, _, _) = (Vec::new(), Vec::new(), Vec::new());
    let mut remarks = Vec::new();
    for (place, candidate) in best.causes.iter().enumerate() {
        let Some(estimate) = &searched.estimate else { continue };
        let class = class_of(searched, best, *candidate);
        let is_one = constancies.get(place).copied().unwrap_or(1.0);
        let of_any = probability_of_any(searched, &class);
        let class_probability = is_one * of_any;
        let own = &problem.candidates[*candidate];
        let Some(present) = searched.model.iter().find(|p| p.candidate == *candidate) else { continue };
        let effects = own.at(&present.coordinates);
        if own.is_law {
            if class_probability >= ASSERTED {
                laws.extend(effects);
            }
            continue;
        }
        let Some(effect) = effects.into_iter().next() else { continue };
        if (1.0 - is_one) * of_any >= ASSERTED {
            remarks.push(format!("the runs ask for {effect}, but each for another size: it is asserted as no cause"));
        }
        let cause = Cause {
            effect,
            std: deviations(problem, (best, place), estimate, present),
            probability: is_one * probability_of_any(searched, &equivalent(searched, *candidate)),
            class_probability,
            alternatives: alternatives(problem, searched, &class, *candidate, &present.coordinates),
            validation_nats: scores.validation.get(place).copied(),
            left_out_nats: scores.left_out.get(place).copied().unwrap_or(0.0),
        };
        let without = probability_where(searched, |set| !holds_any(set, &class));
        if class_probability >= ASSERTED { causes.push((without, cause)) } else { suspects.push(cause) }
    }
    // Many probabilities are 1 to all digits; what the data lose without a cause tells them apart.
    causes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let causes: Vec<Cause> = causes.into_iter().map(|(_, cause)| cause).collect();
    let discrepancy = discrepancies(problem, searched);
    let remains =
        !laws.is_empty() || !remarks.is_empty() || discrepancy.iter().any(|d| d.inferred > UNEXPECTED * d.expected);
    let verdict = match (causes.is_empty(), remains) {
        (true, false) => Verdict::Consistent,
        (false, false) => Verdict::Explained,
        (false, true) => Verdict::PartlyExplained,
        (true, true) => Verdict::Unexplained,
    };
    let none = searched.sets.iter().find(|(set, _)| set.causes.is_empty()).map_or(0.0, |(_, p)| *p);
    Concluded {
        verdict,
        remarks,
        causes,
        suspects,
        laws,
        discrepancy,
        inclusion: inclusion(problem, searched),
        probability_of_none: none,
    }
}

/// The candidate and those that act just as it does.
fn equivalent(searched: &Searched, candidate: usize) -> Vec<usize> {
    let others = searched.search.identical.keys().filter_map(|(a, b)| match candidate {
        c if c == *a => Some(*b),
        c if c == *b => Some(*a),
        _ => None,
    });
    std::iter::once(candidate).chain(others).collect()
}

/// The candidate, its equivalents, and those that replace it in the best set at little loss.
fn class_of(searched: &Searched, best: &Found, candidate: usize) -> Vec<usize> {
    let mut class = equivalent(searched, candidate);
    for (set, _) in &searched.sets {
        let is_replaced = set.causes.len() == best.causes.len()
            && best.log_posterior - set.log_posterior < ALTERNATIVE_NATS
            && best.causes.iter().all(|c| *c == candidate || set.causes.contains(c));
        if is_replaced {
            class.extend(set.causes.iter().copied().filter(|c| !best.causes.contains(c)));
        }
    }
    class.sort_unstable();
    class.dedup();
    class
}

fn probability_of_any(searched: &Searched, candidates: &[usize]) -> f64 {
    probability_where(searched, |set| holds_any(set, candidates)).min(1.0)
}

fn holds_any(set: &Found, candidates: &[usize]) -> bool {
    set.causes.iter().any(|c| candidates.contains(c))
}

fn probability_where(searched: &Searched, is_meant: impl Fn(&Found) -> bool) -> f64 {
    searched.sets.iter().filter(|(set, _)| is_meant(set)).map(|(_, p)| p).sum()
}

fn alternatives(
    problem: &Problem,
    searched: &Searched,
    class: &[usize],
    own: usize,
    coordinates: &[f64],
) -> Vec<Alternative> {
    let equals = equivalent(searched, own);
    let mut all: Vec<Alternative> = Vec::new();
    let mut others: Vec<(usize, f64)> =
        class.iter().filter(|c| **c != own).map(|c| (*c, probability_of_any(searched, &[*c]))).collect();
    others.sort_by(|a, b| b.1.total_cmp(&a.1));
    for (other, probability) in &others {
        let (is_equivalent, probability) = (equals.contains(other), *probability);
        if !is_equivalent && probability < TOLD {
            continue;
        }
        let candidate = &problem.candidates[*other];
        // The same effect of another size is no other cause.
        let is_told = is_same(&candidate.nominal, &problem.candidates[own].nominal)
            || all.iter().any(|a| is_same(&candidate.nominal, &a.effect));
        if is_told && candidate.prior.response != Response::Discrete {
            continue;
        }
        let matched = searched.search.identical.get(&(own.min(*other), own.max(*other)));
        let matched = matched.filter(|(which, _)| which == other).map(|(_, at)| at.clone());
        let at = matched
            .or_else(|| estimate_of(problem, searched, *other))
            .unwrap_or_else(|| coordinates.iter().map(|c| c.abs()).take(candidate.size).collect());
        if let Some(effect) = candidate.at(&at).into_iter().next() {
            all.push(Alternative { effect, probability, is_equivalent });
        }
    }
    all
}

/// A candidate's coordinates in the most probable set that holds it.
fn estimate_of(problem: &Problem, searched: &Searched, candidate: usize) -> Option<Vec<f64>> {
    let (set, _) = searched.sets.iter().find(|(set, _)| set.causes.contains(&candidate))?;
    let (posterior, _) = searched.search.posterior(&searched.points, set)?;
    let before: usize = set.causes.iter().take_while(|c| **c != candidate).map(|c| problem.candidates[*c].size).sum();
    Some(posterior.mean[before..before + problem.candidates[candidate].size].to_vec())
}

/// Standard deviations of the effect's parameters, from those of its coordinates.
fn deviations(problem: &Problem, (set, place): (&Found, usize), estimate: &Estimate, present: &Present) -> Vec<f64> {
    let own = &problem.candidates[present.candidate];
    let first: usize = set.causes[..place].iter().map(|c| problem.candidates[*c].size).sum();
    let variance = |i: usize, j: usize| estimate.coordinates.covariance[(first + i, first + j)];
    let mean = |i: usize| estimate.coordinates.mean[first + i];
    let mut std = vec![0.0; own.nominal.values().len()];
    match own.prior.response {
        Response::Linear => (0..own.size).for_each(|i| std[i] = variance(i, i).sqrt()),
        Response::Shape(_) | Response::Onset => std[0] = variance(0, 0).sqrt(),
        Response::Scale(_) => {
            std[0] = variance(0, 0).sqrt();
            // The shape is a logarithm.
            std[1] = present.coordinates.get(own.size).map_or(0.0, |log| log.exp() * estimate.shapes[place]);
        }
        Response::Discrete => {}
        Response::Inverse => std[0] = variance(0, 0).sqrt() / mean(0).powi(2),
        Response::Strength => {
            std[0] = variance(0, 0).sqrt();
            for i in 1..own.size {
                let k = mean(0);
                let of_ratio = variance(i, i) / k.powi(2) + mean(i).powi(2) * variance(0, 0) / k.powi(4)
                    - 2.0 * mean(i) * variance(0, i) / k.powi(3);
                std[i] = of_ratio.max(0.0).sqrt();
            }
        }
    }
    // What adds to a cause and acts just as it does leaves it no better known.
    let adds = problem.uncertain.iter().filter(|value| value.adds_to(&own.nominal));
    adds.for_each(|value| std[0] = std[0].hypot(value.sd));
    std
}

/// Of each strength, the largest over the families of blocks.
fn discrepancies(problem: &Problem, searched: &Searched) -> Vec<Discrepancy> {
    let told = problem.discrepancies(&searched.hyper);
    told.into_iter().map(|(name, inferred, expected)| Discrepancy { name, inferred, expected }).collect()
}

fn inclusion(problem: &Problem, searched: &Searched) -> Vec<(Effect, f64)> {
    let mut all: Vec<(Effect, f64)> = Vec::new();
    for candidate in &searched.search.chosen {
        let probability = probability_of_any(searched, &[*candidate]);
        if probability >= TOLD
            && let Some(at) = estimate_of(problem, searched, *candidate)
            && let Some(effect) = problem.candidates[*candidate].at(&at).into_iter().next()
        {
            all.push((effect, probability));
        }
    }
    all.sort_by(|a, b| b.1.total_cmp(&a.1));
    all
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::tuning::Tuning;
    use fss_estimation::evidence::SetPosterior;
    use fss_plant::Plant;
    use nalgebra::DMatrix;

    #[test]
    fn a_clock_of_links_is_known_no_better_than_what_their_stamps_lack_and_a_friction_as_well_as_it_is_estimated() {
        let mut plant = Plant::default_laboratory().unwrap();
        let uncertainty = plant.uncertainty.get_or_insert_default();
        (uncertainty.link_stamp_s, uncertainty.coulomb_friction_n_m) = (4e-4, 0.01);
        let problem = Problem::new(&plant, &[], &Tuning::default()).unwrap();
        let deviation = |is_meant: &dyn Fn(&Effect) -> bool| {
            let candidate = problem.candidates.iter().position(|c| is_meant(&c.nominal)).unwrap();
            let set = Found { causes: vec![candidate], classes: vec![0], log_likelihood: 0.0, log_posterior: 0.0 };
            let size = problem.candidates[candidate].size;
            let covariance = DMatrix::identity(size, size) * 3e-4_f64.powi(2);
            let coordinates = SetPosterior { log_evidence: 0.0, mean: vec![0.02; size], covariance };
            let estimate = Estimate { coordinates, shapes: vec![0.0] };
            let present = Present { candidate, coordinates: vec![0.02; size] };
            deviations(&problem, (&set, 0), &estimate, &present)[0]
        };
        let of_clock = deviation(&|e| e.id() == "clock_offset" && e.channel() == Some("joints"));
        assert!((of_clock - 5e-4).abs() < 1e-12, "{of_clock}");
        let of_friction = deviation(&|e| e.id() == "joint_coulomb_friction" && e.index() == Some(2));
        assert!((of_friction - 3e-4).abs() < 1e-12, "{of_friction}");
    }
}
