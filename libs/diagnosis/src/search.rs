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
use crate::problem::{Kept, Linearized, Member, Present, Problem, Slope, is_same};
use fss_estimation::evidence::SetPosterior;
use fss_multibody::ModelError;
use fss_plant::Response;
use hyper::{PROMISING, Reach};
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
    say("inferring the noise without causes");
    let uncertain = problem.linearized(&[], Slope::Secant, &|_, _| false, Kept::Nothing)?;
    Ok(NoCause::with(problem, uncertain, noise))
}

impl NoCause {
    /// The same of the same problem with other knowledge of the hyper-parameters.
    pub(crate) fn again(self, problem: &Problem, noise: Noise) -> Self {
        Self::with(problem, self.uncertain, noise)
    }

    fn with(problem: &Problem, uncertain: Linearized, noise: Noise) -> Self {
        let search = Search::new(problem);
        let from = |start: &[f64], reach: Reach| search.optimized(&uncertain, &[], &[], start, reach, |_, _| true);
        let hyper = match noise {
            Noise::Unknown => from(&medians(problem), Reach::OF_PRIOR),
            Noise::Near(known) => from(known, Reach::NEAR),
            Noise::As(known) => known.to_vec(),
        };
        let point = search.point(&uncertain, &hyper, &search.parameters_with(&[]).0, &GramCache::default());
        let (means, log_posterior) =
            point.and_then(|p| Some((p.posterior.means().to_vec(), p.log_posterior(&[])?))).map_or_else(
                || (vec![0.0; problem.uncertain.len()], f64::NEG_INFINITY),
                |(means, likelihood)| (means, likelihood + search.prior_of_set(&[])),
            );
        Self { uncertain, hyper, means, log_posterior }
    }
}

/// Searches `among` some candidates, or all. `None` where a soft drive is less probable than a `rival`, which is asked for where one
/// comes up: a logarithm.
pub(crate) fn search<'a>(
    problem: &'a Problem,
    NoCause { uncertain, hyper: null_hyper, mut log_posterior, .. }: NoCause,
    among: Option<&BTreeSet<usize>>,
    rival: &dyn Fn() -> Result<Option<f64>, ModelError>,
    say: &(dyn Fn(&str) + Sync),
) -> Result<Option<Searched<'a>>, ModelError> {
    let mut search = Search::new(problem);
    let (mut model, mut refuted) = (Vec::new(), BTreeSet::new());
    let is_elastic = |c: &usize| problem.candidates[*c].is_elastic(&problem.plant);
    let loses = |set: &Found, log_posterior: f64| -> Result<bool, ModelError> {
        Ok(set.causes.iter().any(is_elastic) && rival()?.is_some_and(|rival| log_posterior < rival))
    };
    say("linearizing");
    let is_among = |c: usize| among.is_none_or(|among| among.contains(&c));
    let at_first = |c: usize, member: &Member| is_among(c) && problem.at_first(c, member);
    let mut linearized = problem.linearized(&model, Slope::Secant, &at_first, Kept::All(uncertain))?;
    let mut hyper = null_hyper.clone();
    let (mut largest, mut again, mut unchanged) = (1, 0, false);
    let mut points = Vec::new();
    let mut visited = BTreeSet::from([Vec::new()]);
    let mut round = 0;
    loop {
        round += 1;
        say(&format!("searching for up to {largest}, round {round}"));
        if !unchanged {
            let is_open = |c: usize| is_among(c) && !refuted.contains(&c);
            search.shortlist(&linearized, &model, (&null_hyper, &hyper), &is_open);
            let chosen = &search.chosen;
            let wanted = |c: usize, m: &Member| chosen.contains(&c) && (round > 1 || !problem.at_first(c, m));
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
        let scanned = || search.scanned(&linearized, (&model, estimate), &best, &start);
        let Some(from) = (if same { Some(model.clone()) } else { scanned()? }) else {
            // Another stiffness may keep what this one's column promised.
            let is_new = |c: &&usize| model.iter().all(|p: &Present| p.candidate != **c);
            refuted.extend(best.causes.iter().filter(is_new).filter(|c| is_elastic(c)));
            unchanged = false;
            linearized = problem.linearized(&model, Slope::Secant, &|_, _| false, Kept::All(linearized))?;
            continue;
        };
        let now = search.polished(&linearized, from, &best, &start)?;
        let still = Search::stands_still(&model, &now, &deviations) || again >= AGAIN;
        let mut key = best.causes.clone();
        key.sort_unstable();
        // A set that was left for another and comes back would go on so for ever: it is taken.
        let comes_back = !same && !visited.insert(key.clone());
        let is_whole = comes_back || best.causes.len() < largest || largest + 1 == SIZES.len();
        if (still && is_whole) || comes_back || round >= ROUNDS {
            let sets = probabilities(sets);
            return Ok(Some(Searched { search, points, sets, model: now, hyper, linearized }));
        }
        if still {
            (model, largest, again, unchanged) = (now, largest + 1, 0, true);
            continue;
        }
        unchanged = false;
        say(&format!("linearizing about {}", search.names(&now)));
        let next = search.about(now, &best, &start, linearized)?;
        if loses(&best, next.log_posterior)? {
            return Ok(None);
        }
        let news = search.like_news(&best, &model);
        if news.iter().any(is_elastic) && next.log_posterior < log_posterior {
            // What a soft drive does is far from proportional: its column promised what the drive itself does not keep.
            refuted.extend(news);
            visited.remove(&key);
            let present = |c: usize, _: &Member| model.iter().any(|p| p.candidate == c);
            linearized = problem.linearized(&model, Slope::Secant, &present, Kept::Causes(next.linearized))?;
            continue;
        }
        (model, linearized, hyper, log_posterior) = (next.model, next.linearized, next.hyper, next.log_posterior);
        if !same {
            refuted.clear();
            search.note_identical(&linearized, &hyper, &model)?;
        }
        model = search.polished(&linearized, model, &best, &hyper)?;
    }
}

/// The hyper-parameters' medians, without variation from run to run.
fn medians(problem: &Problem) -> Vec<f64> {
    let mut start: Vec<f64> = problem.hyper.iter().map(|h| h.median).collect();
    if let Some(variation) = start.last_mut() {
        *variation = VARIATIONS[0];
    }
    start
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

/// A model with the linearization about it.
struct About {
    model: Vec<Present>,
    linearized: Linearized,
    /// Hyper-parameters that suit it best.
    hyper: Vec<f64>,
    /// Logarithm of its marginal likelihood and prior.
    log_posterior: f64,
}

impl Search<'_> {
    /// Linearizes about a model of a set; columns of causes that it does not have stay.
    fn about(&self, model: Vec<Present>, set: &Found, start: &[f64], kept: Linearized) -> Result<About, ModelError> {
        let present = |c: usize, _: &Member| model.iter().any(|p| p.candidate == c);
        let linearized = self.problem.linearized(&model, Slope::Secant, &present, Kept::Causes(kept))?;
        let hyper = self.optimized(&linearized, &set.causes, &set.classes, start, Reach::OF_MODEL, |_, _| true);
        let log_posterior = self.log_posterior((&linearized, &hyper), set);
        Ok(About { model, linearized, hyper, log_posterior })
    }

    /// Causes of a set that a model does not have, and the same effects with other values.
    fn like_news(&self, set: &Found, model: &[Present]) -> Vec<usize> {
        let candidates = &self.problem.candidates;
        let is_new = |c: &&usize| model.iter().all(|p| p.candidate != **c);
        let like = |c: &usize| {
            let same = |other: &usize| other == c || is_same(&candidates[*other].nominal, &candidates[*c].nominal);
            (0..candidates.len()).filter(|other| same(other)).collect::<Vec<_>>()
        };
        set.causes.iter().filter(is_new).flat_map(like).collect()
    }

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
