//! The search: marginal likelihoods of sets of causes, the noise's strength inferred with each.
//!
//! A set of causes is judged at the hyper-parameters that suit it best: at the strength that the empty set needs, all causes
//! look alike; a cause shows at the strength that it leaves. So the sets are compared on a ladder of strengths, the best set's
//! hyper-parameters are optimized, everything is linearized anew about it, until set and values stand still.

mod estimate;
mod hyper;
mod sets;
mod shortlist;
mod space;
mod wiring;

use crate::gram::GramCache;
use crate::problem::{Kept, Linearized, Present, Problem, Slope};
use fss_estimation::evidence::SetPosterior;
use fss_multibody::ModelError;
use fss_plant::Response;
use hyper::PROMISING;
use sets::probabilities;
pub(crate) use sets::{SIZES, log_sum};
use space::VARIATIONS;
pub(crate) use space::{Found, HyperPoint, Search};
use std::collections::BTreeSet;
pub(crate) use wiring::{Rewired, rewired};

/// Rounds of search, optimization and linearization at the most.
const ROUNDS: usize = 14;
/// A change of a coordinate below this share of its deviation stands still.
const STANDS_STILL: f64 = 0.5;
/// So often at the most a set is linearized about its values without another set being better.
const AGAIN: usize = 3;

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

/// The runs without any cause.
pub(crate) struct NoCause {
    /// Columns of the uncertain values.
    uncertain: Linearized,
    /// Hyper-parameters that suit it best.
    pub(crate) hyper: Vec<f64>,
    /// Posterior means of the uncertain values, in stated standard deviations.
    pub(crate) means: Vec<f64>,
    /// Logarithm of its marginal likelihood and prior.
    pub(crate) log_posterior: f64,
}

/// What is known of the hyper-parameters without causes.
#[derive(Clone, Copy)]
pub(crate) enum Noise<'a> {
    Unknown,
    /// They are near those that suited a problem much like this one.
    Near(&'a [f64]),
    As(&'a [f64]),
}

/// The runs without causes.
pub(crate) fn without_causes(
    problem: &Problem,
    noise: Noise,
    say: &(dyn Fn(&str) + Sync),
) -> Result<NoCause, ModelError> {
    let search = Search::new(problem);
    say("inferring the noise without causes");
    let uncertain = problem.linearized(&[], Slope::Secant, &|_, _| false, Kept::Nothing)?;
    let from = |start: &[f64], width: f64| search.optimized(&uncertain, &[], &[], start, width, |_, _| true);
    let hyper = match noise {
        Noise::Unknown => from(&medians(problem), 1.0),
        Noise::Near(known) => from(known, 0.5),
        Noise::As(known) => known.to_vec(),
    };
    let point = search.point(&uncertain, &hyper, &search.parameters_with(&[]).0, &GramCache::default());
    let (means, log_posterior) =
        point.and_then(|p| Some((p.posterior.means().to_vec(), p.log_posterior(&[])?))).map_or_else(
            || (vec![0.0; problem.uncertain.len()], f64::NEG_INFINITY),
            |(means, likelihood)| (means, likelihood + search.prior_of_set(&[])),
        );
    Ok(NoCause { uncertain, hyper, means, log_posterior })
}

/// Searches `among` some candidates, or all. `None` where a soft drive is less probable than a `rival`, which is asked for where one
/// comes up: a logarithm.
pub(crate) fn search<'a>(
    problem: &'a Problem,
    NoCause { uncertain, hyper: null_hyper, .. }: NoCause,
    among: Option<&BTreeSet<usize>>,
    rival: &dyn Fn() -> Result<Option<f64>, ModelError>,
    say: &(dyn Fn(&str) + Sync),
) -> Result<Option<Searched<'a>>, ModelError> {
    let mut search = Search::new(problem);
    let mut model = Vec::new();
    let is_elastic = |c: &usize| problem.candidates[*c].is_elastic(&problem.plant);
    let loses = |set: &Found, log_posterior: f64| -> Result<bool, ModelError> {
        Ok(set.causes.iter().any(is_elastic) && rival()?.is_some_and(|rival| log_posterior < rival))
    };
    say("linearizing");
    let is_among = |c: usize| among.is_none_or(|among| among.contains(&c));
    let at_first = |c: usize, family: usize| is_among(c) && problem.at_first(c, family);
    let mut linearized = problem.linearized(&model, Slope::Secant, &at_first, Kept::All(uncertain))?;
    let mut hyper = null_hyper.clone();
    let (mut largest, mut again, mut unchanged) = (1, 0, false);
    let mut points = Vec::new();
    let mut visited = BTreeSet::from([Vec::new()]);
    for round in 1..=ROUNDS {
        say(&format!("searching for up to {largest}, round {round}"));
        if !unchanged {
            search.shortlist(&linearized, &model, (&null_hyper, &hyper), &is_among);
            let chosen = &search.chosen;
            let wanted = |c: usize, family: usize| chosen.contains(&c) && (round > 1 || !problem.at_first(c, family));
            linearized = problem.linearized(&model, Slope::Secant, &wanted, Kept::All(linearized))?;
            points = search.points(&linearized, &null_hyper, &hyper);
        }
        search.varying = model.iter().map(|p| p.candidate).collect();
        let mut sets = search.beam(&points, largest);
        if search.add_optima(&linearized, &model, &sets, if unchanged { 1 } else { PROMISING }, &mut points) {
            sets = search.beam(&points, largest);
        }
        let best = sets[0].clone();
        if loses(&best, best.log_posterior)? {
            return Ok(None);
        }
        let same = model.len() == best.causes.len() && model.iter().all(|p| best.causes.contains(&p.candidate));
        again = if same { again + 1 } else { 0 };
        let (estimate, deviations) = search.estimate(&points, &best);
        let start = points[search.judge(&points, &best.causes, &best.classes).1].hyper.clone();
        let from = if same { model.clone() } else { search.scanned(&linearized, (&model, estimate), &best, &start)? };
        let now = search.polished(&linearized, from, &best, &start)?;
        let still = Search::stands_still(&model, &now, &deviations) || again >= AGAIN;
        let mut key = best.causes.clone();
        key.sort_unstable();
        // A set that was left for another and comes back would go on so for ever: it is taken.
        let comes_back = !same && !visited.insert(key);
        let is_whole = comes_back || best.causes.len() < largest || largest + 1 == SIZES.len();
        model = now;
        if (still && is_whole) || comes_back || round == ROUNDS {
            let sets = probabilities(sets);
            return Ok(Some(Searched { search, points, sets, model, hyper, linearized }));
        }
        if still {
            (largest, again, unchanged) = (largest + 1, 0, true);
            continue;
        }
        unchanged = false;
        say(&format!("linearizing about {}", search.names(&model)));
        let present: Vec<usize> = model.iter().map(|p| p.candidate).collect();
        linearized =
            problem.linearized(&model, Slope::Secant, &|c, _| present.contains(&c), Kept::Causes(linearized))?;
        hyper = search.optimized(&linearized, &best.causes, &best.classes, &start, 0.5, |_, _| true);
        if loses(&best, search.log_posterior((&linearized, &hyper), &best))? {
            return Ok(None);
        }
        if !same {
            search.note_identical(&linearized, &hyper, &model)?;
        }
        model = search.polished(&linearized, model, &best, &hyper)?;
    }
    unreachable_round()
}

/// The hyper-parameters' medians, without variation from run to run.
fn medians(problem: &Problem) -> Vec<f64> {
    let mut start: Vec<f64> = problem.hyper.iter().map(|h| h.median).collect();
    if let Some(variation) = start.last_mut() {
        *variation = VARIATIONS[0];
    }
    start
}

/// The loop above always returns in its last round.
fn unreachable_round<'a>() -> Result<Option<Searched<'a>>, ModelError> {
    unreachable!("the last round returns")
}

impl Searched<'_> {
    /// Place of the first uncertain value among the search's parameters.
    pub(crate) fn uncertain_at(&self) -> usize {
        self.search.parameters.len() - self.search.problem.uncertain.len()
    }

    /// Whether the model is more probable in another problem of the same runs, whose servos are tuned as was found here.
    pub(crate) fn is_likelier_in(&self, other: &Problem) -> Result<bool, ModelError> {
        let is_present = |c: usize, _| self.model.iter().any(|p| p.candidate == c);
        let log_posterior = |problem: &Problem| -> Result<f64, ModelError> {
            let about = problem.linearized(&self.model, Slope::Secant, &is_present, Kept::Nothing)?;
            Ok(Search::new(problem).log_posterior((&about, &self.hyper), &self.sets[0].0))
        };
        Ok(log_posterior(other)? > log_posterior(self.search.problem)?)
    }

    /// Posterior means of the uncertain values with the best set, in stated standard deviations.
    pub(crate) fn uncertain_means(&self) -> Vec<f64> {
        self.search.values(&self.points, &self.sets[0].0)
    }
}

impl Search<'_> {
    /// Logarithm of a set's marginal likelihood and prior, about its own estimate.
    fn log_posterior(&self, (about, hyper): (&Linearized, &[f64]), set: &Found) -> f64 {
        let (parameters, position) = self.parameters_with(&set.causes);
        let point = self.point(about, hyper, &parameters, &GramCache::default());
        let slabs = self.slabs(&set.causes, &set.classes, &position);
        let value = point.zip(slabs).and_then(|(point, slabs)| point.log_posterior(&slabs));
        value.map_or(f64::NEG_INFINITY, |value| value + self.prior_of_set(&set.causes))
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

    /// Posterior means of the uncertain values with a set, in stated standard deviations.
    fn values(&self, points: &[HyperPoint], set: &Found) -> Vec<f64> {
        let slabs = self.slabs(&set.causes, &set.classes, &self.position);
        let found = self.posterior(points, set).zip(slabs);
        let means = found.map(|((posterior, at), slabs)| points[at].posterior.means_given(&slabs, &posterior));
        let first = self.parameters.len() - self.problem.uncertain.len();
        means.map_or_else(|| vec![0.0; self.problem.uncertain.len()], |m| m[first..].to_vec())
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

    fn stands_still(before: &[Present], now: &[Present], deviations: &[Vec<f64>]) -> bool {
        let close = |now: &Present, sd: &Vec<f64>| {
            let before = before.iter().find(|p| p.candidate == now.candidate);
            before.is_some_and(|before| {
                let moved = before.coordinates.iter().zip(&now.coordinates).zip(sd);
                moved.into_iter().all(|((a, b), sd)| (a - b).abs() <= (STANDS_STILL * sd).max(1e-3 * b.abs()))
            })
        };
        before.len() == now.len() && now.iter().zip(deviations).all(|(now, sd)| close(now, sd))
    }
}
