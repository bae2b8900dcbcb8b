//! The search: marginal likelihoods of sets of causes, the noise's strength inferred with each.
//!
//! A set of causes is judged at the hyper-parameters that suit it best: at the strength that the empty set needs, all causes
//! look alike; a cause shows at the strength that it leaves. So the sets are compared on a ladder of strengths, the best set's
//! hyper-parameters are optimized, everything is linearized anew about it, until set and values stand still.

use crate::block::{HyperParameter, Strength};
use crate::problem::{GramCache, Linearized, Present, Problem, Slope};
use fss_estimation::evidence::{SetPosterior, Slab, SpikePosterior};
use fss_estimation::pattern_search::maximize;
use fss_multibody::ModelError;
use fss_plant::{Response, SLAB_WIDTHS};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Prior probability of so many causes.
pub(crate) const SIZES: [f64; 5] = [0.5, 0.3, 0.13, 0.05, 0.02];
/// Sets that are extended at each size.
const BEAM: usize = 8;
/// Strengths of the discrepancy that sets are compared at, over the present ones.
const LADDER: [f64; 5] = [1.0, 0.25, 0.06, 0.015, 3e-3];
/// And about the present ones.
const AROUND: [f64; 3] = [0.7, 1.0, 1.4];
/// Logarithms by which a strength is moved to look for another optimum.
const FAR: [f64; 3] = [-4.0, 2.5, 5.0];
/// So many sets have the hyper-parameters that suit them best among those that all are compared at.
const PROMISING: usize = 3;
/// Strengths that all candidates are looked at first, and how many of them the search goes on with; of a law, so many shapes.
const SCREENED_AT: [f64; 3] = [1.0, 0.1, 5e-3];
const SHORTLIST: usize = 28;
const SHAPES: usize = 3;
const OF_A_KIND: usize = 8;
/// Variations from run to run that sets are compared at; below the least the prior is flat.
const VARIATIONS: [f64; 5] = [1e-4, 0.03, 0.1, 0.3, 1.0];
const LEAST_VARIATION: f64 = 0.03;
const FEWEST_VARYING: usize = 3;
/// Rounds of search, optimization and linearization at the most.
const ROUNDS: usize = 14;
/// Steps of estimation about one set at the most.
const POLISHED: usize = 6;
/// A change of a coordinate below this share of its deviation stands still.
const STANDS_STILL: f64 = 0.5;
/// So often at the most a set is linearized about its values without another set being better.
const AGAIN: usize = 3;
/// Standard deviation of a discrete cause's coordinate about 1.
const DISCRETE_SD: f64 = 0.01;

/// Hyper-parameters and everything that follows from the data at them.
pub(crate) struct HyperPoint {
    pub(crate) hyper: Vec<f64>,
    log_prior: f64,
    pub(crate) posterior: SpikePosterior,
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

/// What the search came to.
pub(crate) struct Searched<'a> {
    pub(crate) search: Search<'a>,
    pub(crate) points: Vec<HyperPoint>,
    /// All sets that were judged, most probable first, each with its probability.
    pub(crate) sets: Vec<(Found, f64)>,
    /// The most probable set at its estimates.
    pub(crate) model: Vec<Present>,
    /// Hyper-parameters that suit it best.
    pub(crate) hyper: Vec<f64>,
    pub(crate) linearized: Linearized,
}

pub(crate) struct Search<'a> {
    pub(crate) problem: &'a Problem,
    /// Parameters in the Gram matrices, and the place of each of the problem's parameters among them.
    parameters: Vec<usize>,
    position: Vec<Option<usize>>,
    /// Logarithm of each candidate's prior among all.
    log_prior: Vec<f64>,
    /// Candidates that the present round looks at.
    pub(crate) chosen: Vec<usize>,
    /// Causes of the model that everything is linearized about: they may vary from run to run.
    varying: Vec<usize>,
    /// Pairs of candidates that these data cannot tell apart at all, the smaller first, with the one of them that was not in the
    /// model and the coordinates at which it does what the other did.
    pub(crate) identical: BTreeMap<(usize, usize), (usize, Vec<f64>)>,
}

pub(crate) fn search<'a>(problem: &'a Problem, say: &(dyn Fn(&str) + Sync)) -> Result<Searched<'a>, ModelError> {
    say("linearizing");
    let mut linearized = problem.linearized(&[], Slope::Secant, &|c, family| problem.at_first(c, family), None)?;
    let mut search = Search::new(problem);
    say("inferring the noise without causes");
    let mut start: Vec<f64> = problem.hyper.iter().map(|h| h.median).collect();
    if let Some(variation) = start.last_mut() {
        *variation = VARIATIONS[0];
    }
    let null_hyper = search.optimized(&linearized, &[], &[], &start, 1.0, |_, _| true);
    let mut hyper = null_hyper.clone();
    let mut model: Vec<Present> = Vec::new();
    let (mut largest, mut again, mut unchanged) = (1, 0, false);
    let mut points = Vec::new();
    let mut visited = BTreeSet::from([Vec::new()]);
    for round in 1..=ROUNDS {
        say(&format!("searching for up to {largest}, round {round}"));
        if !unchanged {
            search.shortlist(&linearized, &model, &null_hyper, &hyper);
            let chosen = &search.chosen;
            let wanted = |c: usize, family: usize| chosen.contains(&c) && (round > 1 || !problem.at_first(c, family));
            linearized = problem.linearized(&model, Slope::Secant, &wanted, Some(linearized))?;
            points = search.points(&linearized, &null_hyper, &hyper);
        }
        search.varying = model.iter().map(|p| p.candidate).collect();
        let mut sets = search.beam(&points, largest);
        if search.add_optima(&linearized, &model, &sets, if unchanged { 1 } else { PROMISING }, &mut points) {
            sets = search.beam(&points, largest);
        }
        let best = sets[0].clone();
        let same = model.len() == best.causes.len() && model.iter().all(|p| best.causes.contains(&p.candidate));
        again = if same { again + 1 } else { 0 };
        let (estimate, deviations) = search.estimate(&points, &best);
        let start = points[search.judge(&points, &best.causes, &best.classes).1].hyper.clone();
        let now = search.polished(if same { model.clone() } else { estimate }, &best, &start)?;
        let still = Search::stands_still(&model, &now, &deviations) || again >= AGAIN;
        let mut key = best.causes.clone();
        key.sort_unstable();
        // A set that was left for another and comes back would go on so for ever: it is taken.
        let comes_back = !same && !visited.insert(key);
        let is_whole = comes_back || best.causes.len() < largest || largest + 1 == SIZES.len();
        model = now;
        if (still && is_whole) || comes_back || round == ROUNDS {
            return Ok(Searched { search, points, sets: probabilities(sets), model, hyper, linearized });
        }
        if still {
            (largest, again, unchanged) = (largest + 1, 0, true);
            continue;
        }
        unchanged = false;
        say(&format!("linearizing about {}", search.names(&model)));
        let present: Vec<usize> = model.iter().map(|p| p.candidate).collect();
        linearized = problem.linearized(&model, Slope::Secant, &|c, _| present.contains(&c), Some(linearized))?;
        hyper = search.optimized(&linearized, &best.causes, &best.classes, &start, 0.5, |_, _| true);
        if !same {
            search.note_identical(&linearized, &hyper, &model)?;
        }
        model = search.polished(model, &best, &hyper)?;
    }
    unreachable_round()
}

/// The loop above always returns in its last round.
fn unreachable_round<'a>() -> Result<Searched<'a>, ModelError> {
    unreachable!("the last round returns")
}

impl Searched<'_> {
    /// Place of the first uncertain value among the search's parameters.
    pub(crate) fn uncertain_at(&self) -> usize {
        self.search.parameters.len() - self.search.problem.uncertain.len()
    }

    /// Posterior means of the uncertain values with the best set, in stated standard deviations.
    pub(crate) fn uncertain_means(&self) -> Vec<f64> {
        let best = &self.sets[0].0;
        let slabs = self.search.slabs(&best.causes, &best.classes, &self.search.position);
        let found = self.search.posterior(&self.points, best).zip(slabs);
        let means = found.map(|((posterior, at), slabs)| self.points[at].posterior.means_given(&slabs, &posterior));
        means.map_or_else(|| vec![0.0; self.search.problem.uncertain.len()], |m| m[self.uncertain_at()..].to_vec())
    }
}

fn probabilities(sets: Vec<Found>) -> Vec<(Found, f64)> {
    let top = sets.first().map_or(0.0, |s| s.log_posterior);
    let sum: f64 = sets.iter().map(|s| (s.log_posterior - top).exp()).sum();
    sets.into_iter()
        .map(|s| {
            let p = (s.log_posterior - top).exp() / sum;
            (s, p)
        })
        .collect()
}

impl<'a> Search<'a> {
    fn new(problem: &'a Problem) -> Self {
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
        }
    }

    /// Chooses the candidates that explain most beside the present model, at some strength of the discrepancy.
    fn shortlist(&mut self, linearized: &Linearized, model: &[Present], null: &[f64], present: &[f64]) {
        let problem = self.problem;
        let of_model = |p: &Present| -> Vec<(usize, f64)> {
            let typical = &problem.candidates[p.candidate].prior.typical;
            let widest = SLAB_WIDTHS[SLAB_WIDTHS.len() - 1];
            problem.parameters_of(p.candidate).zip(typical).map(|(at, size)| (at, widest * size.max(1e-6))).collect()
        };
        let (base, sd): (Vec<usize>, Vec<f64>) =
            model.iter().flat_map(of_model).chain(problem.uncertain_parameters().map(|at| (at, 1.0))).unzip();
        let slabs = |candidate: usize| -> Vec<Vec<Slab>> {
            let local: Vec<Option<usize>> = (0..problem.parameters())
                .map(|p| problem.parameters_of(candidate).contains(&p).then(|| p - problem.first[candidate]))
                .collect();
            (0..self.classes(candidate)).filter_map(|class| self.slabs(&[candidate], &[class], &local)).collect()
        };
        let ladders =
            SCREENED_AT.iter().flat_map(|by| [0, 1].map(|family| self.scaled(null, present, family, |_| *by)));
        let mut hypers = vec![present.to_vec()];
        for hyper in ladders {
            if !hypers.contains(&hyper) {
                hypers.push(hyper);
            }
        }
        let mut best = vec![f64::NEG_INFINITY; problem.candidates.len()];
        let (prepared, mut known) = (problem.prepared(linearized), HashMap::new());
        for hyper in hypers {
            let Some(values) = problem.screened(&prepared, (&hyper, &mut known), &base, &sd, &slabs) else { continue };
            let prior = self.log_prior_of(&hyper);
            best.iter_mut().zip(values).for_each(|(b, value)| *b = b.max(value + prior));
        }
        let value = |c: usize| best[c] + self.log_prior[c];
        let mut order: Vec<usize> = (0..best.len()).filter(|c| best[*c] > f64::NEG_INFINITY).collect();
        order.sort_by(|a, b| value(*b).total_cmp(&value(*a)).then(a.cmp(b)));
        let mut chosen: Vec<usize> = model.iter().map(|p| p.candidate).collect();
        let mut of_kind: HashMap<&str, usize> = HashMap::new();
        for c in order {
            let shapes = of_kind.entry(&problem.candidates[c].kind).or_default();
            let room = if problem.candidates[c].is_law { SHAPES } else { OF_A_KIND };
            if chosen.len() < SHORTLIST && !chosen.contains(&c) && *shapes < room {
                *shapes += 1;
                chosen.push(c);
            }
        }
        chosen.sort_unstable();
        (self.parameters, self.position) = self.parameters_with(&chosen);
        self.chosen = chosen;
    }

    fn names(&self, model: &[Present]) -> String {
        let effects: Vec<String> = model
            .iter()
            .flat_map(|p| self.problem.candidates[p.candidate].at(&p.coordinates))
            .map(|e| e.to_string())
            .collect();
        effects.join(", ")
    }

    fn log_prior_of(&self, hyper: &[f64]) -> f64 {
        let last = hyper.len() - 1;
        let density = |(i, (h, value)): (usize, (&HyperParameter, &f64))| {
            let value = if i == last { value.max(LEAST_VARIATION) } else { *value };
            let z = (value / h.median).ln() / h.log_sd;
            -0.5 * z * z
        };
        self.problem.hyper.iter().zip(hyper).enumerate().map(density).sum()
    }

    fn point(
        &self,
        linearized: &Linearized,
        hyper: &[f64],
        parameters: &[usize],
        cache: &GramCache,
    ) -> Option<HyperPoint> {
        let gram = self.problem.gram(linearized, hyper, parameters, cache)?;
        let spikes: Vec<f64> = parameters.iter().map(|p| self.problem.spikes[*p]).collect();
        let posterior = SpikePosterior::new(&gram, &spikes)?;
        Some(HyperPoint { hyper: hyper.to_vec(), log_prior: self.log_prior_of(hyper), posterior })
    }

    /// Hyper-parameters that suit a set best, from `start`; only the set's own columns and the uncertain values play a part.
    fn optimized(
        &self,
        linearized: &Linearized,
        causes: &[usize],
        classes: &[usize],
        start: &[f64],
        width: f64,
        which: impl Fn(usize, &HyperParameter) -> bool,
    ) -> Vec<f64> {
        let (parameters, position) = self.parameters_with(causes);
        let bounded = |logs: &[f64]| -> Vec<f64> {
            logs.iter().zip(&self.problem.hyper).map(|(l, h)| l.exp().clamp(h.bounds[0], h.bounds[1])).collect()
        };
        let cache = GramCache::default();
        let value = |logs: &[f64]| {
            let hyper = bounded(logs);
            if hyper.iter().zip(logs).any(|(h, l)| (h.ln() - l).abs() > 1e-9) {
                return f64::NEG_INFINITY;
            }
            let Some(point) = self.point(linearized, &hyper, &parameters, &cache) else { return f64::NEG_INFINITY };
            let Some(slabs) = self.slabs(causes, classes, &position) else { return f64::NEG_INFINITY };
            point.posterior.of_set(&slabs).map_or(f64::NEG_INFINITY, |p| p.log_evidence + point.log_prior)
        };
        let mut logs: Vec<f64> = start.iter().map(|h| h.ln()).collect();
        // A process that is far too weak to be seen has no slope: each strength is tried far from where it starts, too.
        let mut found = value(&logs);
        for (i, h) in self.problem.hyper.iter().enumerate() {
            if h.strength_of.is_none() || !which(self.problem.family_of[i], h) {
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
        let step =
            |(h, family): (&HyperParameter, &usize)| if which(*family, h) { width * h.log_sd.min(1.5) } else { 0.0 };
        let mut steps: Vec<f64> = self.problem.hyper.iter().zip(&self.problem.family_of).map(step).collect();
        // How much causes vary from run to run is judged with all of them, on the grid.
        if let Some(variation) = steps.last_mut() {
            *variation = 0.0;
        }
        let (best, _) = maximize(&logs, &steps, 0.15, 150, value);
        bounded(&best)
    }

    /// Hyper-parameters of a family as the empty set needs them, the strengths of its discrepancies scaled; all others as `present`.
    /// Below the strength that the empty set needs, its inflated noise is no guide either: that is as stated.
    fn scaled(&self, null: &[f64], present: &[f64], family: usize, by: impl Fn(Strength) -> f64) -> Vec<f64> {
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
    fn points(&self, linearized: &Linearized, null: &[f64], present: &[f64]) -> Vec<HyperPoint> {
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
        kept.iter().filter_map(|hyper| self.point(linearized, hyper, &self.parameters, &cache)).collect()
    }

    /// Adds the optima of the sets that promise most beyond the present model, in the hyper-parameters that their causes bear on.
    fn add_optima(
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
                self.optimized(linearized, &set.causes, &set.classes, &start, 0.5, |family, h| {
                    h.strength_of.is_some() && families.contains(&family)
                });
            points.extend(self.point(linearized, &hyper, &self.parameters, &GramCache::default()));
        }
        !promising.is_empty()
    }

    fn classes(&self, candidate: usize) -> usize {
        let own = &self.problem.candidates[candidate];
        if own.prior.response == Response::Discrete { 1 } else { SLAB_WIDTHS.len() + own.prior.points.len() }
    }

    /// The priors of a set's parameters.
    pub(crate) fn slabs(&self, causes: &[usize], classes: &[usize], position: &[Option<usize>]) -> Option<Vec<Slab>> {
        let mut slabs = Vec::new();
        for (candidate, class) in causes.iter().zip(classes) {
            let own = &self.problem.candidates[*candidate];
            for (i, parameter) in self.problem.parameters_of(*candidate).enumerate() {
                let parameter = position[parameter]?;
                let bounds = own.bounds(i);
                let (mean, sd) = match (own.prior.response, SLAB_WIDTHS.get(*class)) {
                    (Response::Discrete, _) => (1.0, DISCRETE_SD),
                    (_, Some(width)) => (0.0, width * own.prior.typical[i]),
                    (_, None) => (own.points()[class - SLAB_WIDTHS.len()], own.prior.spike[i]),
                };
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
        let may_vary = self.varying.iter().all(|c| causes.contains(c));
        let varies = |point: &HyperPoint| point.hyper.last().is_some_and(|v| *v > VARIATIONS[0] * 1.001);
        for (i, point) in points.iter().enumerate().filter(|(_, p)| may_vary || !varies(p)) {
            let found =
                point.posterior.of_set(&slabs).map_or(f64::NEG_INFINITY, |p| p.log_evidence + point.log_prior - weight);
            if found > best.0 {
                best = (found, i);
            }
        }
        best
    }

    /// A set with one cause's class free, the others' given.
    fn extended(&self, points: &[HyperPoint], causes: &[usize], given: &[usize], free: usize) -> (f64, Vec<usize>) {
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

    fn prior_of_set(&self, causes: &[usize]) -> f64 {
        let orders: f64 = (1..=causes.len()).map(|i| (i as f64).ln()).sum();
        SIZES[causes.len()].ln() + orders + causes.iter().map(|c| self.log_prior[*c]).sum::<f64>()
    }

    /// All sets that the beam meets, most probable first.
    fn beam(&self, points: &[HyperPoint], largest: usize) -> Vec<Found> {
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

    /// Notes which candidates act just as a cause of the model does: by what both do at its size, not by their columns, which
    /// differ where actions are not in proportion.
    fn note_identical(&mut self, linearized: &Linearized, hyper: &[f64], model: &[Present]) -> Result<(), ModelError> {
        for present in model.iter().filter(|p| !self.problem.candidates[p.candidate].is_law) {
            let own = present.candidate;
            let alike = self.problem.acting_alike(linearized, hyper, model, present)?;
            self.identical.extend(alike.into_iter().map(|(other, at)| ((own.min(other), own.max(other)), (other, at))));
        }
        Ok(())
    }

    /// Every cause's class in turn, the others' as they are.
    fn refine_classes(&self, points: &[HyperPoint], set: &mut Found) {
        for free in 0..set.causes.len() {
            let (value, classes) = self.extended(points, &set.causes, &set.classes, free);
            set.log_posterior += value - set.log_likelihood;
            set.log_likelihood = value;
            set.classes = classes;
        }
    }

    /// A cause is in a set once, whatever its shape.
    fn goes_with(&self, candidate: usize, causes: &[usize]) -> bool {
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

    /// Gauss-Newton steps: the model's coordinates at the posterior mean of its linearization about themselves.
    fn polished(&self, mut model: Vec<Present>, set: &Found, hyper: &[f64]) -> Result<Vec<Present>, ModelError> {
        let present: Vec<usize> = model.iter().map(|p| p.candidate).collect();
        let (parameters, position) = self.parameters_with(&present);
        let Some(slabs) = self.slabs(&set.causes, &set.classes, &position) else { return Ok(model) };
        let steps = if model.is_empty() { 0 } else { POLISHED };
        for _ in 0..steps {
            let linearized = self.problem.linearized(&model, Slope::Tangent, &|c, _| present.contains(&c), None)?;
            let Some(point) = self.point(&linearized, hyper, &parameters, &GramCache::default()) else { break };
            let Some(posterior) = point.posterior.of_set(&slabs) else { break };
            let (estimate, deviations) = self.presented(set, &posterior);
            let still = Self::stands_still(&model, &estimate, &deviations);
            model = estimate;
            if still {
                break;
            }
        }
        Ok(model)
    }

    /// Parameters of some candidates and the uncertain values, and where each of the problem's is among them.
    pub(crate) fn parameters_with(&self, candidates: &[usize]) -> (Vec<usize>, Vec<Option<usize>>) {
        let own = candidates.iter().flat_map(|c| self.problem.parameters_of(*c));
        let parameters: Vec<usize> = own.chain(self.problem.uncertain_parameters()).collect();
        let mut position = vec![None; self.problem.parameters()];
        parameters.iter().enumerate().for_each(|(at, p)| position[*p] = Some(at));
        (parameters, position)
    }

    /// The best set at its posterior mean, and the deviations of its coordinates.
    fn estimate(&self, points: &[HyperPoint], set: &Found) -> (Vec<Present>, Vec<Vec<f64>>) {
        match self.posterior(points, set) {
            Some((posterior, _)) => self.presented(set, &posterior),
            None => (Vec::new(), Vec::new()),
        }
    }

    /// A set at its posterior mean, within bounds, and the deviations of its coordinates.
    fn presented(&self, set: &Found, posterior: &SetPosterior) -> (Vec<Present>, Vec<Vec<f64>>) {
        let (mut model, mut deviations) = (Vec::new(), Vec::new());
        let mut at = 0;
        for candidate in &set.causes {
            let size = self.problem.candidates[*candidate].size;
            let own = |i: usize| posterior.mean[at + i];
            let coordinates = if self.problem.candidates[*candidate].prior.response == Response::Discrete {
                vec![1.0]
            } else {
                let inside = |i: usize| {
                    let [lower, upper] = self.problem.candidates[*candidate].bounds(i);
                    own(i).clamp(lower, upper)
                };
                (0..size).map(inside).collect()
            };
            deviations.push((0..size).map(|i| posterior.covariance[(at + i, at + i)].sqrt()).collect());
            model.push(Present { candidate: *candidate, coordinates });
            at += size;
        }
        (model, deviations)
    }

    pub(crate) fn posterior(&self, points: &[HyperPoint], set: &Found) -> Option<(SetPosterior, usize)> {
        let slabs = self.slabs(&set.causes, &set.classes, &self.position)?;
        let (_, at) = self.judge(points, &set.causes, &set.classes);
        Some((points.get(at)?.posterior.of_set(&slabs)?, at))
    }

    fn stands_still(model: &[Present], estimate: &[Present], deviations: &[Vec<f64>]) -> bool {
        let close = |now: &Present, sd: &Vec<f64>| {
            let before = model.iter().find(|p| p.candidate == now.candidate);
            before.is_some_and(|before| {
                let moved = before.coordinates.iter().zip(&now.coordinates).zip(sd);
                moved.into_iter().all(|((a, b), sd)| (a - b).abs() <= (STANDS_STILL * sd).max(1e-3 * b.abs()))
            })
        };
        model.len() == estimate.len() && estimate.iter().zip(deviations).all(|(now, sd)| close(now, sd))
    }
}

fn sort(sets: &mut [Found]) {
    // Equal sets come in a fixed order, so that the answer does not hang on the threads.
    sets.sort_by(|a, b| b.log_posterior.total_cmp(&a.log_posterior).then_with(|| a.causes.cmp(&b.causes)));
}

fn log_sum(values: &[f64]) -> f64 {
    let top = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if top == f64::NEG_INFINITY { top } else { top + values.iter().map(|v| (v - top).exp()).sum::<f64>().ln() }
}
