//! Hyper-parameters: the grid that sets are compared at, and the optimum of a set.

use super::space::{Found, HyperPoint, Search, VARIATIONS};
use crate::block::{HyperParameter, Strength};
use crate::gram::GramCache;
use crate::problem::{Linearized, Present};
use fss_estimation::evidence::SpikePosterior;
use fss_estimation::quasi_newton::{Effort, maximize};
use std::collections::BTreeSet;

/// Strengths of the discrepancy that sets are compared at, over the present ones.
const LADDER: [f64; 5] = [1.0, 0.25, 0.06, 0.015, 3e-3];
/// And about the present ones.
const AROUND: [f64; 3] = [0.7, 1.0, 1.4];
/// Logarithms by which a strength is moved to look for another optimum.
const FAR: [f64; 3] = [-4.0, 2.5, 5.0];
/// So many sets have the hyper-parameters that suit them best among those that all are compared at.
pub(super) const PROMISING: usize = 3;
/// A smaller gain, nats, is not sought: in the end, and in a first look, where servos are not tuned yet.
const TOLERANCE: f64 = 0.1;
const FIRST_TOLERANCE: f64 = 20.0;
/// Evaluations at the most: in the end, and for a set that only promises.
const EVALUATIONS: usize = 400;
const FEW_EVALUATIONS: usize = 60;
/// Below this variation from run to run the prior is flat.
const LEAST_VARIATION: f64 = 0.03;
/// Runs among which a variation can be told.
const FEWEST_VARYING: usize = 3;

/// How far hyper-parameters are sought from where they start.
#[derive(Clone, Copy)]
pub(super) struct Reach {
    /// First differences over the deviations of the priors.
    width: f64,
    /// Whether each strength is tried far from where it starts, too: a process that is far too weak to be seen has no slope.
    far: bool,
    /// Gain that is not sought, nats.
    tolerance: f64,
    evaluations: usize,
    /// Whether the likelihood bends much as it did about the present model.
    bends_alike: bool,
}

impl Reach {
    /// From the priors' medians, a first look.
    pub(super) const OF_PRIOR: Self =
        Self { width: 1.0, far: true, tolerance: FIRST_TOLERANCE, evaluations: EVALUATIONS, bends_alike: false };
    /// Of a new model.
    pub(super) const OF_MODEL: Self =
        Self { width: 0.5, far: true, tolerance: TOLERANCE, evaluations: EVALUATIONS, bends_alike: false };
    /// From the best of some that were compared, or of a problem much like this one.
    pub(super) const NEAR: Self = Self { far: false, ..Self::OF_MODEL };
    /// Of a set that promises to be more probable.
    pub(super) const OF_PROMISING: Self = Self { evaluations: FEW_EVALUATIONS, bends_alike: true, ..Self::NEAR };
}

impl Search<'_> {
    pub(super) fn log_prior_of(&self, hyper: &[f64]) -> f64 {
        let last = hyper.len() - 1;
        let density = |(i, (h, value)): (usize, (&HyperParameter, &f64))| {
            let value = if i == last { value.max(LEAST_VARIATION) } else { *value };
            let z = (value / h.median).ln() / h.log_sd;
            -0.5 * z * z
        };
        self.problem.hyper.iter().zip(hyper).enumerate().map(density).sum()
    }

    pub(super) fn point(
        &self,
        linearized: &Linearized,
        hyper: &[f64],
        parameters: &[usize],
        cache: &GramCache,
    ) -> Option<HyperPoint> {
        self.point_of((linearized, &linearized.size), hyper, parameters, cache)
    }

    /// The same where causes of these sizes vary from run to run.
    fn point_of(
        &self,
        linearized: (&Linearized, &[f64]),
        hyper: &[f64],
        parameters: &[usize],
        cache: &GramCache,
    ) -> Option<HyperPoint> {
        let gram = self.problem.gram(linearized, hyper, parameters, cache)?;
        let spikes = self.problem.spikes_of(linearized.0, parameters);
        let posterior = SpikePosterior::new(&gram, &spikes)?;
        Some(HyperPoint { hyper: hyper.to_vec(), log_prior: self.log_prior_of(hyper), varying: None, posterior })
    }

    /// Everything that follows from the data at these hyper-parameters: for each set of causes that may vary from run to run, of those
    /// of the model, where any does.
    fn points_at(&self, linearized: &Linearized, hyper: &[f64], cache: &GramCache) -> Vec<HyperPoint> {
        if hyper.last().is_none_or(|variation| *variation <= VARIATIONS[0] * 1.001) {
            return self.point(linearized, hyper, &self.parameters, cache).into_iter().collect();
        }
        let with = |subset: u32| {
            let is_in = |(i, c): (usize, &usize)| (subset >> i & 1 == 1).then_some(*c);
            let varying: Vec<usize> = self.varying.iter().enumerate().filter_map(is_in).collect();
            let mut size = vec![0.0; linearized.size.len()];
            for p in varying.iter().flat_map(|c| self.problem.parameters_of(*c)) {
                size[p] = linearized.size[p];
            }
            let point = self.point_of((linearized, &size), hyper, &self.parameters, cache)?;
            Some(HyperPoint { varying: Some(varying), ..point })
        };
        (0..1 << self.varying.len()).filter_map(with).collect()
    }

    /// Hyper-parameters that suit a set best, from `start`; only the set's own columns and the uncertain values play a part.
    pub(super) fn optimized(
        &self,
        linearized: &Linearized,
        causes: &[usize],
        classes: &[usize],
        start: &[f64],
        Reach { width, far, tolerance, evaluations, bends_alike }: Reach,
        which: impl Fn(usize, &HyperParameter) -> bool,
    ) -> Vec<f64> {
        let (parameters, position) = self.parameters_with(causes);
        let all = &self.problem.hyper;
        let bounded = |logs: &[f64]| -> Vec<f64> {
            logs.iter().zip(all).map(|(l, h)| l.exp().clamp(h.bounds[0], h.bounds[1])).collect()
        };
        // A stated noise is known to a part of what an unstated strength is: each is sought as finely as its prior is wide.
        let units: Vec<f64> = all.iter().map(|h| h.log_sd.min(1.5)).collect();
        let scaled = |values: &[f64], by: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
            values.iter().zip(&units).map(|(value, unit)| by(*value, *unit)).collect()
        };
        let cache = GramCache::default();
        let value = |logs: &[f64]| {
            let hyper = bounded(logs);
            let Some(point) = self.point(linearized, &hyper, &parameters, &cache) else { return f64::NEG_INFINITY };
            let Some(slabs) = self.slabs(causes, classes, &position) else { return f64::NEG_INFINITY };
            point.posterior.of_set(&slabs).map_or(f64::NEG_INFINITY, |p| p.log_evidence + point.log_prior)
        };
        let mut logs: Vec<f64> = start.iter().map(|h| h.ln()).collect();
        let mut found = if far { value(&logs) } else { f64::INFINITY };
        for (i, h) in all.iter().enumerate() {
            if !far || h.strength_of.is_none() || !which(self.problem.family_of[i], h) {
                continue;
            }
            for by in FAR {
                let mut far = logs.clone();
                far[i] = (start[i].ln() + by).clamp(h.bounds[0].ln(), h.bounds[1].ln());
                let there = value(&far);
                if there > found {
                    (found, logs) = (there, far);
                }
            }
        }
        let step = |(h, family): (&HyperParameter, &usize)| if which(*family, h) { width } else { 0.0 };
        let mut steps: Vec<f64> = all.iter().zip(&self.problem.family_of).map(step).collect();
        // How much causes vary from run to run is judged with all of them, on the grid.
        if let Some(variation) = steps.last_mut() {
            *variation = 0.0;
        }
        let start = scaled(&logs, &|log, unit| log / unit);
        let of_scaled = |at: &[f64]| value(&scaled(at, &|at, unit| at * unit));
        let bounds: Vec<[f64; 2]> = all.iter().zip(&units).map(|(h, unit)| h.bounds.map(|b| b.ln() / unit)).collect();
        let known = if bends_alike { self.curvature() } else { None };
        let effort = Effort { tolerance, evaluations };
        let best = maximize(&start, &steps, &bounds, effort, known.as_ref(), of_scaled);
        if !bends_alike {
            self.note_curvature(Some(best.curvature));
        }
        bounded(&scaled(&best.at, &|at, unit| at * unit))
    }

    /// Hyper-parameters of a family as the empty set needs them, the strengths of its discrepancies scaled; all others as `present`.
    /// Below the strength that the empty set needs, its inflated noise is no guide either: that is as stated.
    pub(super) fn scaled(
        &self,
        null: &[f64],
        present: &[f64],
        family: usize,
        by: impl Fn(Strength) -> f64,
    ) -> Vec<f64> {
        let full = [Strength::Force, Strength::Torque, Strength::Joint].iter().all(|s| by(*s) == 1.0);
        let scale = |(i, h): (usize, &HyperParameter)| match h.strength_of {
            _ if self.problem.family_of[i] != family => present[i],
            Some(strength) => (null[i] * by(strength)).clamp(h.bounds[0], h.bounds[1]),
            None if full => null[i],
            None => h.median,
        };
        self.problem.hyper.iter().enumerate().map(scale).collect()
    }

    /// The hyper-parameters that sets are compared at: ladders down from those of no cause, and about the present ones.
    pub(super) fn points(&self, linearized: &Linearized, null: &[f64], present: &[f64]) -> Vec<HyperPoint> {
        let mut grid: Vec<Vec<f64>> = vec![null.to_vec()];
        let of_base = |a: f64, b: f64| move |s: Strength| if s == Strength::Force { a } else { b };
        for (i, a) in LADDER.iter().enumerate() {
            for (j, b) in LADDER.iter().enumerate() {
                if i.abs_diff(j) <= 1 {
                    grid.push(self.scaled(null, present, 0, of_base(*a, *b)));
                }
            }
        }
        grid.extend(LADDER.iter().map(|c| self.scaled(null, present, 1, |_| *c)));
        let around = |a: f64, b: f64, c: f64| -> Vec<f64> {
            let scale = |(h, value): (&HyperParameter, &f64)| {
                let by = match h.strength_of {
                    Some(Strength::Force) => a,
                    Some(Strength::Torque) => b,
                    Some(Strength::Joint) => c,
                    None => 1.0,
                };
                (value * by).clamp(h.bounds[0], h.bounds[1])
            };
            self.problem.hyper.iter().zip(present).map(scale).collect()
        };
        for a in AROUND {
            grid.extend(AROUND.iter().map(|b| around(a, *b, 1.0)));
        }
        grid.extend(AROUND.iter().map(|c| around(1.0, 1.0, *c)));
        // A variation from run to run is one only among several: of fewer runs its prior alone would speak.
        let variations = if self.problem.runs() < FEWEST_VARYING { &VARIATIONS[..1] } else { &VARIATIONS[..] };
        for variation in variations.iter().copied() {
            let mut varied = present.to_vec();
            if let Some(last) = varied.last_mut() {
                *last = variation;
            }
            grid.push(varied);
        }
        let mut kept: Vec<Vec<f64>> = Vec::new();
        for hyper in grid {
            if !kept.contains(&hyper) {
                kept.push(hyper);
            }
        }
        let cache = GramCache::default();
        kept.iter().flat_map(|hyper| self.points_at(linearized, hyper, &cache)).collect()
    }

    /// Adds the optima of the sets that promise most beyond the present model, in the hyper-parameters that their causes bear on.
    pub(super) fn add_optima(
        &self,
        linearized: &Linearized,
        model: &[Present],
        sets: &[Found],
        count: usize,
        points: &mut Vec<HyperPoint>,
    ) -> bool {
        let is_new = |set: &&Found| set.causes.iter().any(|c| model.iter().all(|p| p.candidate != *c));
        let promising: Vec<&Found> = sets.iter().filter(is_new).take(count).collect();
        for set in &promising {
            let start = points[self.judge(points, &set.causes, &set.classes).1].hyper.clone();
            let news = set.causes.iter().filter(|c| model.iter().all(|p| p.candidate != **c));
            let families: BTreeSet<usize> = news.flat_map(|c| self.problem.families(linearized, *c)).collect();
            let hyper =
                self.optimized(linearized, &set.causes, &set.classes, &start, Reach::OF_PROMISING, |family, h| {
                    h.strength_of.is_some() && families.contains(&family)
                });
            points.extend(self.points_at(linearized, &hyper, &GramCache::default()));
        }
        !promising.is_empty()
    }
}
