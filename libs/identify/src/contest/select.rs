//! Which causes to take: forward by contest, checked on left-out runs, then backward.

use super::rules::{DOUBTFUL, LEAST_GAIN, least_gain, unit};
use super::screen::Screened;
use super::{Contest, Refined};
use fss_multibody::ModelError;
use fss_plant::Effect;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Causes taken at most.
const MOST_CAUSES: usize = 4;
/// Contestants that are refitted with the real simulation, and those that look much like the best of them.
const CONTESTANTS: usize = 8;
const MOST_CONTESTANTS: usize = 14;
/// A contestant that has gained this share of what the best has by then is worth fitting to the end.
const WORTH_FITTING: f64 = 0.5;
/// Of these at most so many of one kind at one place.
const MOST_OF_A_KIND: usize = 2;
const ALIKE: f64 = 0.8;
/// How many of its standard deviations one of several causes must be away from nothing. The deviations take residuals for independent
/// between windows, which those of a wrong model are not.
const LEAST_CLEARNESS: f64 = 6.0;

/// A cause that was taken, and what else it could be.
#[derive(Clone)]
pub(crate) struct Taken {
    pub(crate) effect: Effect,
    /// Standard deviations of its parameters.
    pub(crate) std: Vec<f64>,
    pub(crate) probability: f64,
    /// What it gains over leaving it out, in units of noise.
    pub(crate) gain: f64,
    /// Others in its place: hypothesis, effect, probability, cosine.
    pub(crate) alternatives: Vec<Alternative>,
}

/// Another cause in the place of one that was taken.
#[derive(Clone)]
pub(crate) struct Alternative {
    pub(crate) effect: Effect,
    pub(crate) probability: f64,
}

/// What the contest came to.
pub(crate) struct Selection {
    pub(crate) before: Refined,
    pub(crate) after: Refined,
    pub(crate) taken: Vec<Taken>,
    /// The screen at the start, best first.
    pub(crate) screened: Vec<Screened>,
}

impl Contest {
    /// Takes causes as long as the data insist.
    pub(crate) fn select(&mut self, say: &(dyn Fn(&str) + Sync)) -> Result<Selection, ModelError> {
        let selection = self.select_once(say)?;
        let left = selection.after.mean_square();
        if left > DOUBTFUL {
            // Where no cause explains all, the rows are noisier than the sensors: priors must be weighed against that.
            self.set_unit(left);
            return self.select_once(say);
        }
        Ok(selection)
    }

    fn select_once(&mut self, say: &(dyn Fn(&str) + Sync)) -> Result<Selection, ModelError> {
        let before = self.nothing()?;
        let mut after = before.clone();
        let mut screened = Vec::new();
        let mut centre = after.clone();
        let mut rivals: Vec<Vec<Refined>> = Vec::new();
        while after.hypotheses.len() < MOST_CAUSES {
            say(&format!("contest for cause {}", after.hypotheses.len() + 1));
            let screen = self.screen(&after.residuals, &after.hypotheses);
            let contest = self.contest(&after, &screen)?;
            if screened.is_empty() {
                screened = screen;
            }
            let Some((next, is_linear)) = self.first_that_holds(&after, &contest, &mut centre, say)? else { break };
            after = next;
            if is_linear {
                rivals.push(contest);
            } else {
                rivals.clear();
            }
        }
        say("weighing the alternatives");
        let mut after = self.without_idle(after)?;
        let mut without = self.without_each(&after)?;
        let mut others = self.all_rivals(&after, &without, &rivals)?;
        // A cause taken early may have stood for one that fits better beside those taken later.
        for _ in 0..2 {
            let better = others.iter().flatten().min_by(|a, b| Self::cost(a).total_cmp(&Self::cost(b)));
            match better.filter(|r| Self::cost(r) < Self::cost(&after) - unit(&after)) {
                Some(better) => after = better.clone(),
                None => break,
            }
            without = self.without_each(&after)?;
            others = self.all_rivals(&after, &without, &[])?;
        }
        let told = after.hypotheses.len();
        while let Some(vague) = self.vaguest(&after) {
            after = self.refine_without(&after, vague)?;
        }
        if after.hypotheses.len() < told {
            without = self.without_each(&after)?;
            others = self.all_rivals(&after, &without, &[])?;
        }
        let taken = self.weigh(&after, &without, &others);
        Ok(Selection { before, after, taken, screened })
    }

    /// The best of the screen, each refitted beside the causes taken already; best first.
    fn contest(&self, taken: &Refined, screen: &[Screened]) -> Result<Vec<Refined>, ModelError> {
        let noise = unit(taken);
        let worth = |s: &&Screened| {
            s.gain / noise > 0.5 * least_gain(&s.effect)
                && !taken.hypotheses.iter().any(|h| self.hypotheses[*h].is_same_cause(&self.hypotheses[s.hypothesis]))
                && self.is_worth_saying(s.hypothesis, &s.effect)
        };
        // A kind that is tried at several shapes does not crowd out the others.
        let mut seen = Vec::new();
        let is_new = |s: &&Screened| {
            let kind = (s.effect.id(), s.effect.index(), s.effect.channel().map(str::to_owned));
            let count = seen.iter().filter(|other| **other == kind).count();
            seen.push(kind);
            count < MOST_OF_A_KIND
        };
        let mut chosen: Vec<&Screened> = screen.iter().filter(worth).filter(is_new).take(CONTESTANTS).collect();
        if let Some(best) = chosen.first().copied() {
            let near: Vec<&Screened> = screen.iter().filter(worth).skip(CONTESTANTS).take(40).collect();
            let all: Vec<usize> = std::iter::once(best).chain(near.iter().copied()).map(|s| s.hypothesis).collect();
            let cosines = self.confusability(&all);
            let alike = near.iter().enumerate().filter(|(i, _)| cosines[(0, i + 1)] > ALIKE).map(|(_, s)| *s);
            chosen.extend(alike.take(MOST_CONTESTANTS - CONTESTANTS));
        }
        let clock = self.clock_of_links(taken, &chosen, screen);
        chosen.extend(clock.as_ref());
        let begin = |s: &&Screened| -> Option<Refined> {
            let mut hypotheses = taken.hypotheses.clone();
            hypotheses.push(s.hypothesis);
            let mut effects = taken.effects.clone();
            effects.push(s.effect.clone());
            // A start that no plant can have is a contestant that loses.
            self.refine_at_first(&hypotheses, &effects).ok()
        };
        let begun: Vec<Refined> = chosen.par_iter().filter_map(begin).collect();
        let mut all = self.fitted_to_the_end(begun, taken.chi2)?;
        all.sort_by(|a, b| Self::cost(a).total_cmp(&Self::cost(b)));
        Ok(all)
    }

    /// The clock of all links' telemetry, where one of them seems late and the clock is not tried already: so far from where it
    /// does nothing, what it gains is not in proportion, and links that are late one by one would be taken for it.
    fn clock_of_links(&self, taken: &Refined, chosen: &[&Screened], screen: &[Screened]) -> Option<Screened> {
        let is_clock = |e: &Effect| e.id() == "clock_offset" && e.channel() == Some("joints");
        let late = chosen.iter().find(|s| s.effect.id() == "link_latency")?;
        if chosen.iter().map(|s| &s.effect).chain(&taken.effects).any(is_clock) {
            return None;
        }
        let clock = screen.iter().find(|s| is_clock(&s.effect))?;
        let offset_s = late.effect.values()[0] - self.hypotheses[late.hypothesis].nominal.values()[0];
        Some(Screened { effect: clock.effect.clone().with(&[offset_s]), ..clock.clone() })
    }

    /// Contestants, those that may win fitted to the end; `chi2` is what is left without any.
    fn fitted_to_the_end(&self, begun: Vec<Refined>, chi2: f64) -> Result<Vec<Refined>, ModelError> {
        let most = begun.iter().map(|r| chi2 - r.chi2).fold(0.0, f64::max);
        let end = |begun: Refined| -> Result<Refined, ModelError> {
            let (last, is_onset) =
                (begun.effects.len() - 1, begun.effects.last().is_some_and(|e| e.onset_s().is_some()));
            let is_behind = chi2 - begun.chi2 < WORTH_FITTING * most;
            // How much an onset gains hangs on when it is: each is timed.
            if !is_onset && (begun.is_settled || is_behind) {
                return Ok(begun);
            }
            // A step to where no plant is leaves it where it was.
            let end = if begun.is_settled { None } else { self.refine(&begun.hypotheses, &begun.effects).ok() };
            let fitted = end.unwrap_or(begun);
            if !is_onset {
                return Ok(fitted);
            }
            let timed = self.refine_onset(&fitted, last)?;
            // Far from where it was asked, a linear answer is often best from some time on; the real one need not be.
            let mut effects = timed.effects.clone();
            effects[last] = self.hypotheses[timed.hypotheses[last]].with(effects[last].values());
            let always = self.refine(&timed.hypotheses, &effects).ok();
            Ok(always.filter(|a| Self::cost(a) < Self::cost(&timed)).unwrap_or(timed))
        };
        begun.into_par_iter().map(end).collect()
    }

    /// Leaves out what the causes taken later have made idle.
    fn without_idle(&self, mut after: Refined) -> Result<Refined, ModelError> {
        while after.hypotheses.len() > 1 {
            let mut dropped = None;
            for i in 0..after.hypotheses.len() {
                let without = self.refine_without(&after, i)?;
                if without.chi2 - after.chi2 < least_gain(&after.effects[i]) * unit(&after) {
                    dropped = Some(without);
                    break;
                }
            }
            match dropped {
                Some(fewer) => after = fewer,
                None => break,
            }
        }
        Ok(after)
    }

    /// Some of the causes taken, the others gone.
    pub(crate) fn only(&self, taken: &Refined, is_kept: impl Fn(usize) -> bool) -> Result<Refined, ModelError> {
        let all = taken.hypotheses.iter().zip(&taken.effects).enumerate();
        let kept = all.filter(|(i, _)| is_kept(*i)).map(|(_, (h, effect))| (*h, effect.clone()));
        let (hypotheses, effects): (Vec<usize>, Vec<Effect>) = kept.unzip();
        if hypotheses.is_empty() { self.nothing() } else { self.refine(&hypotheses, &effects) }
    }

    fn refine_without(&self, from: &Refined, which: usize) -> Result<Refined, ModelError> {
        self.only(from, |i| i != which)
    }

    /// A cause among several whose size is not known well enough to say that it is there; windows that disagree about it
    /// make it so.
    fn vaguest(&self, after: &Refined) -> Option<usize> {
        if after.hypotheses.len() < 2 {
            return None;
        }
        let clearness = self.clearness(after).into_iter().enumerate();
        clearness.filter(|(_, clear)| *clear < LEAST_CLEARNESS).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
    }

    /// What is left without each cause taken, the others fitted anew.
    fn without_each(&self, after: &Refined) -> Result<Vec<Refined>, ModelError> {
        (0..after.hypotheses.len()).into_par_iter().map(|i| self.refine_without(after, i)).collect()
    }

    /// The rivals of each cause taken.
    fn all_rivals(
        &self,
        after: &Refined,
        without: &[Refined],
        contests: &[Vec<Refined>],
    ) -> Result<Vec<Vec<Refined>>, ModelError> {
        (0..after.hypotheses.len())
            .map(|i| {
                let mut rivals = self.rivals_of(after, i, &without[i], contests)?;
                rivals.retain(|r| self.may_be_told(r, i));
                Ok(rivals)
            })
            .collect()
    }

    /// Other causes in the place of cause `i`, refitted beside the other causes taken.
    fn rivals_of(
        &self,
        after: &Refined,
        i: usize,
        without: &Refined,
        rivals: &[Vec<Refined>],
    ) -> Result<Vec<Refined>, ModelError> {
        let noise = unit(after);
        let mut tried: BTreeSet<usize> = after.hypotheses.iter().copied().collect();
        let mut starts: Vec<(usize, Effect)> = Vec::new();
        let others: Vec<usize> =
            after.hypotheses.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, h)| *h).collect();
        for s in self.screen(&without.residuals, &others).into_iter().take(CONTESTANTS) {
            // What a linear fit puts far behind stays there.
            if s.gain > 0.4 * (without.chi2 - after.chi2) && s.gain > LEAST_GAIN * noise && tried.insert(s.hypothesis) {
                starts.push((s.hypothesis, s.effect));
            }
        }
        if after.hypotheses.len() == 1
            && let Some(first) = rivals.first()
        {
            let again = first.iter().filter(|r| r.hypotheses != after.hypotheses);
            let mut found: Vec<Refined> = again.cloned().collect();
            let known: BTreeSet<usize> = found.iter().map(|r| r.hypotheses[0]).collect();
            starts.retain(|(h, _)| !known.contains(h));
            found.extend(self.replaced(after, i, &starts)?);
            return Ok(found);
        }
        self.replaced(after, i, &starts)
    }

    fn replaced(&self, after: &Refined, i: usize, starts: &[(usize, Effect)]) -> Result<Vec<Refined>, ModelError> {
        let refit = |(h, effect): &(usize, Effect)| -> Result<Option<Refined>, ModelError> {
            let (mut hypotheses, mut effects) = (after.hypotheses.clone(), after.effects.clone());
            hypotheses[i] = *h;
            effects[i] = effect.clone();
            Ok(self.refine(&hypotheses, &effects).ok())
        };
        Ok(starts.par_iter().map(refit).collect::<Result<Vec<_>, ModelError>>()?.into_iter().flatten().collect())
    }
}
