//! Sets of causes: their prior, their marginal likelihood, and the beam search over them.

use super::space::{Found, HyperPoint, Search};
use fss_estimation::evidence::{SetPosterior, Slab};
use fss_plant::Response;
use rayon::prelude::*;
use std::collections::HashMap;

/// Prior probability of so many causes.
pub(crate) const SIZES: [f64; 5] = [0.5, 0.3, 0.13, 0.05, 0.02];
/// Sets that are extended at each size.
const BEAM: usize = 8;

impl Search<'_> {
    pub(super) fn classes(&self, candidate: usize) -> usize {
        self.problem.candidates[candidate].classes()
    }

    /// The priors of a set's parameters.
    pub(crate) fn slabs(&self, causes: &[usize], classes: &[usize], position: &[Option<usize>]) -> Option<Vec<Slab>> {
        let mut slabs = Vec::new();
        for (candidate, class) in causes.iter().zip(classes) {
            let own = &self.problem.candidates[*candidate];
            for (i, parameter) in self.problem.parameters_of(*candidate).enumerate() {
                let parameter = position[parameter]?;
                let bounds = own.bounds(i);
                let (mean, sd) = own.prior_in(*class, i);
                let free = [f64::NEG_INFINITY, f64::INFINITY];
                slabs.push(Slab { parameter, mean, sd, bounds: if mean == 0.0 { bounds } else { free } });
            }
        }
        Some(slabs)
    }

    /// A set's marginal likelihood at the best of the points, and which that is.
    pub(crate) fn judge(&self, points: &[HyperPoint], causes: &[usize], classes: &[usize]) -> (f64, usize) {
        let Some(slabs) = self.slabs(causes, classes, &self.position) else { return (f64::NEG_INFINITY, 0) };
        let weight: f64 = causes.iter().map(|c| (self.classes(*c) as f64).ln()).sum();
        let mut best = (f64::NEG_INFINITY, 0);
        // What is absent does not vary, or variation could stand for the cause itself.
        let own: Vec<usize> = self.varying.iter().copied().filter(|c| causes.contains(c)).collect();
        let suits = |point: &HyperPoint| point.varying.as_ref().is_none_or(|varying| *varying == own);
        for (i, point) in points.iter().enumerate().filter(|(_, p)| suits(p)) {
            let found =
                point.posterior.of_set(&slabs).map_or(f64::NEG_INFINITY, |p| p.log_evidence + point.log_prior - weight);
            if found > best.0 {
                best = (found, i);
            }
        }
        best
    }

    /// A set with one cause's class free, the others' given.
    pub(super) fn extended(
        &self,
        points: &[HyperPoint],
        causes: &[usize],
        given: &[usize],
        free: usize,
    ) -> (f64, Vec<usize>) {
        let mut values = Vec::new();
        let mut best = (f64::NEG_INFINITY, given.to_vec());
        for class in 0..self.classes(causes[free]) {
            let mut classes = given.to_vec();
            classes[free] = class;
            let (value, _) = self.judge(points, causes, &classes);
            values.push(value);
            if value > best.0 {
                best = (value, classes);
            }
        }
        (log_sum(&values), best.1)
    }

    pub(super) fn prior_of_set(&self, causes: &[usize]) -> f64 {
        let orders: f64 = (1..=causes.len()).map(|i| (i as f64).ln()).sum();
        SIZES[causes.len()].ln() + orders + causes.iter().map(|c| self.log_prior[*c]).sum::<f64>()
    }

    /// All sets that the beam meets, most probable first.
    pub(super) fn beam(&self, points: &[HyperPoint], largest: usize) -> Vec<Found> {
        let found = |causes: Vec<usize>, classes: Vec<usize>, log_likelihood: f64| {
            let log_posterior = log_likelihood + self.prior_of_set(&causes);
            Found { causes, classes, log_likelihood, log_posterior }
        };
        let empty = found(Vec::new(), Vec::new(), self.judge(points, &[], &[]).0);
        let (mut all, mut front) = (vec![empty.clone()], vec![empty]);
        for _ in 1..=largest {
            let mut keys: HashMap<Vec<usize>, (Vec<usize>, Vec<usize>)> = HashMap::new();
            for set in &front {
                for candidate in self.chosen.iter().copied().filter(|c| self.goes_with(*c, &set.causes)) {
                    let mut causes = set.causes.clone();
                    causes.push(candidate);
                    let mut key = causes.clone();
                    key.sort_unstable();
                    let mut classes = set.classes.clone();
                    classes.push(0);
                    keys.entry(key).or_insert((causes, classes));
                }
            }
            let mut news: Vec<Found> = keys
                .into_values()
                .collect::<Vec<_>>()
                .into_par_iter()
                .map(|(causes, given)| {
                    let last = causes.len() - 1;
                    let (value, classes) = self.extended(points, &causes, &given, last);
                    found(causes, classes, value)
                })
                .collect();
            sort(&mut news);
            for set in news.iter_mut().take(BEAM) {
                self.refine_classes(points, set);
            }
            sort(&mut news);
            front = news.iter().take(BEAM).cloned().collect();
            all.extend(news);
        }
        sort(&mut all);
        all
    }

    /// Every cause's class in turn, the others' as they are.
    pub(super) fn refine_classes(&self, points: &[HyperPoint], set: &mut Found) {
        for free in 0..set.causes.len() {
            let (value, classes) = self.extended(points, &set.causes, &set.classes, free);
            set.log_posterior += value - set.log_likelihood;
            set.log_likelihood = value;
            set.classes = classes;
        }
    }

    /// A cause is in a set once, whatever its shape.
    pub(super) fn goes_with(&self, candidate: usize, causes: &[usize]) -> bool {
        let own = &self.problem.candidates[candidate];
        let twice = |other: &usize| {
            let other = &self.problem.candidates[*other];
            // Of a law, one frequency: what leaks into its neighbours is no second law.
            let one_law = own.is_law && own.kind == other.kind;
            one_law
                || !own.is_law
                    && crate::problem::is_same(&own.nominal, &other.nominal)
                    && own.prior.response != Response::Discrete
        };
        let same = |other: &usize| self.identical.contains_key(&(candidate.min(*other), candidate.max(*other)));
        !causes.contains(&candidate) && !causes.iter().any(|c| twice(c) || same(c))
    }

    pub(crate) fn posterior(&self, points: &[HyperPoint], set: &Found) -> Option<(SetPosterior, usize)> {
        let slabs = self.slabs(&set.causes, &set.classes, &self.position)?;
        let (_, at) = self.judge(points, &set.causes, &set.classes);
        Some((points.get(at)?.posterior.of_set(&slabs)?, at))
    }
}

pub(super) fn probabilities(sets: Vec<Found>) -> Vec<(Found, f64)> {
    let top = sets.first().map_or(0.0, |s| s.log_posterior);
    let sum: f64 = sets.iter().map(|s| (s.log_posterior - top).exp()).sum();
    sets.into_iter()
        .map(|s| {
            let p = (s.log_posterior - top).exp() / sum;
            (s, p)
        })
        .collect()
}

fn sort(sets: &mut [Found]) {
    // Equal sets come in a fixed order, so that the answer does not hang on the threads.
    sets.sort_by(|a, b| b.log_posterior.total_cmp(&a.log_posterior).then_with(|| a.causes.cmp(&b.causes)));
}

pub(crate) fn log_sum(values: &[f64]) -> f64 {
    let top = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if top == f64::NEG_INFINITY { top } else { top + values.iter().map(|v| (v - top).exp()).sum::<f64>().ln() }
}
