//! The course of a search: rounds that choose a set of causes, estimate it and linearize about it, until set and values stand still.

use super::contacts::Contact;
use super::hyper::PROMISING;
use super::no_cause::{NoCause, Noise, medians};
use super::searched::Searched;
use super::sets::{SIZES, probabilities};
use super::space::{Found, HyperPoint, Search};
use super::standing::Standing;
use crate::problem::{Linearized, Member, Present, Problem, Slope, is_same};
use fss_multibody::ModelError;
use std::collections::BTreeSet;

/// Rounds at the most.
const ROUNDS: usize = 14;
/// So often at the most a set is linearized about its values without another set being better.
const AGAIN: usize = 3;

/// A model with the linearization about it.
struct About {
    model: Vec<Present>,
    linearized: Linearized,
    /// Hyper-parameters that suit it best.
    hyper: Vec<f64>,
    /// Logarithm of its marginal likelihood and prior.
    log_posterior: f64,
}

/// Where a search stands.
struct Course<'a> {
    search: Search<'a>,
    now: About,
    /// Hyper-parameters that suit the runs without causes.
    null_hyper: Vec<f64>,
    /// Candidates that the search is among; all where there are none.
    among: Option<BTreeSet<usize>>,
    /// Candidates whose columns promised what they themselves do not keep beside the present model.
    refuted: BTreeSet<usize>,
    /// Sets that any round chose.
    visited: BTreeSet<Vec<usize>>,
    points: Vec<HyperPoint>,
    round: usize,
    /// Causes of a set at the most.
    largest: usize,
    /// Rounds that chose the same set.
    again: usize,
    /// Whether the points are about the present model.
    is_seen: bool,
}

/// What becomes of the set that a round chose.
enum Next {
    /// Another one is sought.
    Another,
    /// It stands still with this model: another one is sought among larger ones.
    Larger(Vec<Present>),
    /// The search ends with this model.
    End(Vec<Present>),
    /// It is linearized about this model.
    About(Vec<Present>),
}

/// Searches from no cause or `from` a contact, `among` some candidates or all. Where a set and its values stand still, it ends if the
/// servos are tuned in another way.
pub(crate) fn search<'a>(
    problem: &'a Problem,
    nothing: NoCause,
    (from, among): (Option<&Contact>, Option<&BTreeSet<usize>>),
    is_tuned_otherwise: &mut dyn FnMut(&Standing) -> Result<bool, ModelError>,
    say: &(dyn Fn(&str) + Sync),
) -> Result<Searched<'a>, ModelError> {
    say("linearizing");
    let mut course = Course::new(problem, nothing, from, among)?;
    loop {
        say(&format!("searching for up to {}, round {}", course.largest, course.round + 1));
        let sets = course.sets()?;
        let best = sets[0].clone();
        match course.estimated(&best)? {
            Next::Another => {}
            Next::Larger(_) | Next::End(_) if course.does_with_fewer()? => {}
            Next::Larger(model) => {
                if is_tuned_otherwise(&course.standing(&best, &model))? {
                    return course.ended(sets, model);
                }
                course.go_on_to_larger(model);
            }
            Next::End(model) => {
                is_tuned_otherwise(&course.standing(&best, &model))?;
                return course.ended(sets, model);
            }
            Next::About(model) => {
                say(&format!("linearizing about {}", course.names(&model)));
                let about = course.linearized(model, &best)?;
                course.take(about, &best)?;
            }
        }
    }
}

impl<'a> Course<'a> {
    /// Linearizes about the first model.
    fn new(
        problem: &'a Problem,
        NoCause { uncertain, noise: Noise { hyper, curvature }, log_posterior, .. }: NoCause,
        from: Option<&Contact>,
        among: Option<&BTreeSet<usize>>,
    ) -> Result<Self, ModelError> {
        let model: Vec<Present> = from.iter().map(|contact| contact.present.clone()).collect();
        let is_in = |c: usize| model.iter().any(|p| p.candidate == c);
        let at_first = |c: usize, member: &Member| {
            is_in(c) || among.is_none_or(|among| among.contains(&c)) && problem.at_first(c, member)
        };
        let known = if model.is_empty() { uncertain } else { Linearized::default() };
        let linearized = problem.linearized((&model, &hyper), Slope::Secant, &at_first, known)?;
        let search = Search::new(problem);
        search.note_curvature(curvature);
        let null_hyper = hyper.clone();
        let (hyper, log_posterior) = match from {
            Some(contact) => search.optimum(&linearized, &contact.alone(), &medians(problem)),
            None => (hyper, log_posterior),
        };
        Ok(Self {
            search,
            null_hyper,
            now: About { model, linearized, hyper, log_posterior },
            among: among.cloned(),
            refuted: BTreeSet::new(),
            visited: BTreeSet::from([Vec::new()]),
            points: Vec::new(),
            round: 0,
            largest: 1,
            again: 0,
            is_seen: false,
        })
    }

    /// A round's sets, most probable first.
    fn sets(&mut self) -> Result<Vec<Found>, ModelError> {
        self.round += 1;
        self.search.varying = self.now.model.iter().map(|p| p.candidate).collect();
        if !self.is_seen {
            self.look()?;
        }
        let (search, now) = (&self.search, &self.now);
        let sets = search.beam(&self.points, self.largest);
        let promising = if self.is_seen { 1 } else { PROMISING };
        if search.add_optima(&now.linearized, &now.model, &sets, promising, &mut self.points) {
            return Ok(search.beam(&self.points, self.largest));
        }
        Ok(sets)
    }

    /// Chooses candidates, and the points at which sets of them are compared.
    fn look(&mut self) -> Result<(), ModelError> {
        let Self { search, now, null_hyper, among, refuted, .. } = self;
        let (problem, is_first) = (search.problem, self.round == 1);
        let is_open = |c: usize| among.as_ref().is_none_or(|among| among.contains(&c)) && !refuted.contains(&c);
        search.shortlist(&now.linearized, &now.model, (null_hyper, &now.hyper), &is_open);
        let chosen = &search.chosen;
        let wanted = |c: usize, m: &Member| chosen.contains(&c) && !(is_first && problem.at_first(c, m));
        let known = std::mem::take(&mut now.linearized);
        now.linearized = problem.linearized((&now.model, &now.hyper), Slope::Secant, &wanted, known)?;
        self.points = search.points(&now.linearized, null_hyper, &now.hyper);
        Ok(())
    }

    fn is_same_as(&self, set: &Found) -> bool {
        let model = &self.now.model;
        model.len() == set.causes.len() && model.iter().all(|p| set.causes.contains(&p.candidate))
    }

    /// Hyper-parameters of the point that suits a set best.
    fn best_hyper(&self, set: &Found) -> Vec<f64> {
        self.points[self.search.judge(&self.points, &set.causes, &set.classes).1].hyper.clone()
    }

    /// Estimates the best set.
    fn estimated(&mut self, best: &Found) -> Result<Next, ModelError> {
        let (search, now) = (&self.search, &self.now);
        let same = self.is_same_as(best);
        self.again = if same { self.again + 1 } else { 0 };
        let (estimate, deviations) = search.estimate(&self.points, best);
        let start = self.best_hyper(best);
        let scanned = || search.scanned(&now.linearized, (&now.model, estimate), best, &start);
        let Some(from) = (if same { Some(now.model.clone()) } else { scanned()? }) else {
            // Another stiffness may keep what this one's column promised.
            let news = best.causes.iter().filter(|c| now.model.iter().all(|p| p.candidate != **c));
            let stiffnesses: Vec<usize> = news.copied().filter(|c| self.is_elastic(*c)).collect();
            let known = std::mem::take(&mut self.now.linearized);
            self.now.linearized =
                search.problem.linearized((&self.now.model, &self.now.hyper), Slope::Secant, &|_, _| false, known)?;
            self.refuted.extend(stiffnesses);
            self.is_seen = false;
            return Ok(Next::Another);
        };
        let model = search.polished(&now.linearized, from, best, &start)?;
        let still = Search::stands_still(&now.model, &model, &deviations) || self.again >= AGAIN;
        // A set that was left for another and comes back would go on so for ever: it is taken.
        let comes_back = !same && !self.visited.insert(key(best));
        let is_whole = comes_back || best.causes.len() < self.largest || self.largest + 1 == SIZES.len();
        if (still && is_whole) || comes_back || self.round >= ROUNDS {
            return Ok(Next::End(model));
        }
        self.is_seen = still;
        Ok(if still { Next::Larger(model) } else { Next::About(model) })
    }

    /// Goes on with one cause in the place of two that do together what it does, where that is more probable. About the two, its column
    /// does not tell: what it does need not be in proportion.
    fn does_with_fewer(&mut self) -> Result<bool, ModelError> {
        let (problem, model) = (self.search.problem, self.now.model.clone());
        let is_law = |c: usize| problem.candidates[c].is_law;
        let causes: Vec<usize> = model.iter().map(|p| p.candidate).filter(|c| !is_law(*c)).collect();
        let pairs = (1..causes.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
        for two in pairs.map(|(a, b)| [causes[a], causes[b]]) {
            for (candidate, coordinates) in problem.acting_alike(&self.now.linearized, &self.now.hyper, &model, &two)? {
                let mut fewer: Vec<Present> = model.iter().filter(|p| !two.contains(&p.candidate)).cloned().collect();
                fewer.push(Present { candidate, coordinates });
                let set = self.search.set_of(&fewer);
                if !self.visited.insert(key(&set)) {
                    continue;
                }
                let known = self.known_about(&fewer);
                let about = self.search.about(fewer, &set, &self.now.hyper, known)?;
                if about.log_posterior > self.now.log_posterior {
                    self.take(about, &set)?;
                    (self.again, self.is_seen) = (0, false);
                    return Ok(true);
                }
                self.come_back(about)?;
            }
        }
        Ok(false)
    }

    fn go_on_to_larger(&mut self, model: Vec<Present>) {
        (self.now.model, self.largest, self.again) = (model, self.largest + 1, 0);
    }

    fn standing<'s>(&'s self, set: &'s Found, model: &'s [Present]) -> Standing<'s> {
        let Self { search, points, now: About { linearized, hyper, .. }, .. } = self;
        Standing { search, points, linearized, hyper, set, model }
    }

    /// Linearizes about a model of the best set.
    fn linearized(&mut self, model: Vec<Present>, best: &Found) -> Result<About, ModelError> {
        let (start, known) = (self.best_hyper(best), self.known_about(&model));
        self.search.about(model, best, &start, known)
    }

    /// Columns that are as good about another model as about the present one.
    fn known_about(&mut self, model: &[Present]) -> Linearized {
        let all = std::mem::take(&mut self.now.linearized);
        self.search.problem.of_causes(all, !self.gives_way(model) && !self.gives_way(&self.now.model))
    }

    /// Goes on with the best set, linearized about its model.
    fn take(&mut self, next: About, best: &Found) -> Result<(), ModelError> {
        let same = self.is_same_as(best);
        let news = self.search.like_news(best, &self.now.model);
        if news.iter().any(|c| self.is_elastic(*c)) && next.log_posterior < self.now.log_posterior {
            // What a soft drive does is far from proportional: its column promised what the drive itself does not keep.
            self.refuted.extend(news);
            self.visited.remove(&key(best));
            return self.come_back(next);
        }
        self.now = next;
        let now = &mut self.now;
        if !same {
            self.refuted.clear();
            self.search.note_identical(&now.linearized, &now.hyper, &now.model)?;
        }
        now.model = self.search.polished(&now.linearized, std::mem::take(&mut now.model), best, &now.hyper)?;
        Ok(())
    }

    /// Linearizes about the present model again, after another one.
    fn come_back(&mut self, from: About) -> Result<(), ModelError> {
        let About { model, hyper, .. } = &self.now;
        let present = |c: usize, _: &Member| model.iter().any(|p| p.candidate == c);
        let problem = self.search.problem;
        let known = problem.of_causes(from.linearized, !self.gives_way(model) && !self.gives_way(&from.model));
        self.now.linearized = problem.linearized((model, hyper), Slope::Secant, &present, known)?;
        Ok(())
    }

    /// Whether a drive of a model gives way.
    fn gives_way(&self, model: &[Present]) -> bool {
        model.iter().any(|p| self.is_elastic(p.candidate))
    }

    fn is_elastic(&self, candidate: usize) -> bool {
        self.search.problem.candidates[candidate].is_elastic(&self.search.problem.plant)
    }

    /// What a model says in a line.
    fn names(&self, model: &[Present]) -> String {
        self.search.names(model)
    }

    /// What the search came to.
    fn ended(self, sets: Vec<Found>, model: Vec<Present>) -> Result<Searched<'a>, ModelError> {
        let (best, about) = (&sets[0], &self.now.linearized);
        let known = |of| self.search.known(about, (&model, best), (&self.best_hyper(best), of));
        let estimate =
            self.search.posterior(&self.points, best).map(|(in_secants, _)| known(in_secants)).transpose()?;
        let Self { search, points, now: About { hyper, linearized, .. }, .. } = self;
        Ok(Searched { search, points, sets: probabilities(sets), model, estimate, hyper, linearized })
    }
}

/// A set's candidates, whatever their order.
fn key(set: &Found) -> Vec<usize> {
    let mut key = set.causes.clone();
    key.sort_unstable();
    key
}

impl Search<'_> {
    /// The set of a model's causes, each in the class in which its coordinates are most probable.
    fn set_of(&self, model: &[Present]) -> Found {
        let likeliest = |p: &Present| {
            let own = &self.problem.candidates[p.candidate];
            let density = |class: usize| -> f64 {
                let of = |(i, value): (usize, &f64)| {
                    let (mean, sd) = own.prior_in(class, i);
                    -0.5 * ((value - mean) / sd).powi(2) - sd.ln()
                };
                p.coordinates.iter().take(own.size).enumerate().map(of).sum()
            };
            (0..own.classes()).max_by(|a, b| density(*a).total_cmp(&density(*b))).unwrap_or(0)
        };
        Found {
            causes: model.iter().map(|p| p.candidate).collect(),
            classes: model.iter().map(likeliest).collect(),
            log_likelihood: 0.0,
            log_posterior: 0.0,
        }
    }

    /// Linearizes about a model of a set; what is known of columns of causes that it does not have stays.
    fn about(&self, model: Vec<Present>, set: &Found, start: &[f64], known: Linearized) -> Result<About, ModelError> {
        let present = |c: usize, _: &Member| model.iter().any(|p| p.candidate == c);
        let linearized = self.problem.linearized((&model, start), Slope::Secant, &present, known)?;
        let (hyper, log_posterior) = self.optimum(&linearized, set, start);
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
}
