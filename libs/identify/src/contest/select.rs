//! Which causes to take: forward by contest, checked on left-out runs, then backward.

use super::screen::Screened;
use super::{Contest, Refined};
use crate::normal::Normal;
use crate::tolerance::unsaid;
use fss_multibody::ModelError;
use fss_plant::Effect;
use nalgebra::DVector;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Causes taken at most.
pub(crate) const MOST_CAUSES: usize = 4;
/// Contestants that are refitted with the real simulation, and those that look much like the best of them.
const CONTESTANTS: usize = 8;
const MOST_CONTESTANTS: usize = 14;
/// The same where each refit is dear, because every window's motion must be fitted anew.
const CONTESTANTS_IF_CHAOTIC: usize = 6;
const ALIKE: f64 = 0.8;
/// What a cause must gain (fall of the sum of squares, in units of what noise and everything unexplained make of one degree
/// of freedom) before anybody is told of it.
const LEAST_GAIN: f64 = 60.0;
/// More where its beginning was chosen too.
const LEAST_GAIN_OF_ONSET: f64 = 100.0;
/// A cause within so many of the deviations that go without saying is not worth a name.
const WORTH_SAYING: f64 = 3.0;
/// And the share of what is still unexplained.
const LEAST_SHARE: f64 = 0.12;
const LEAST_SHARE_OF_ONSET: f64 = 0.4;
/// Mean square up to which nothing counts as unexplained there.
const NEARLY_ALL: f64 = 1.25;
/// What a left-out run must keep of the gain.
const LEAST_KEPT: f64 = 0.3;
/// Mean square by which whitened rows may move before everything is linearized anew.
const FAR: f64 = 2.0;
/// So many of the best in the screen are asked anew then; what the others would do is taken to be as before.
const ASKED_ANEW: usize = 50;
/// How many of its standard deviations one of several causes must be away from nothing.
const LEAST_CLEARNESS: f64 = 3.0;
/// Correlation of residuals that no model has: differences of sums of squares count for so many times less.
const TEMPER: f64 = 4.0;

/// A cause that was taken, and what else it could be.
#[derive(Clone)]
pub(crate) struct Taken {
    pub(crate) effect: Effect,
    /// Standard deviations of its parameters.
    pub(crate) std: Vec<f64>,
    pub(crate) probability: f64,
    /// What it gains over leaving it out, in units of noise.
    pub(crate) gain: f64,
    /// Share of its gain that runs left out of the fit keep.
    pub(crate) kept: f64,
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
    /// Takes causes as long as the data insist, at most so many.
    pub(crate) fn select(&mut self, most: usize, say: &(dyn Fn(&str) + Sync)) -> Result<Selection, ModelError> {
        let before = self.nothing()?;
        let mut centre = before.clone();
        let mut after = before.clone();
        let mut rivals: Vec<Vec<Refined>> = Vec::new();
        let mut screened = Vec::new();
        while after.hypotheses.len() < most {
            say(&format!("contest for cause {}", after.hypotheses.len() + 1));
            let screen = self.screen(&after.residuals, &after.hypotheses);
            let contest = self.contest(&after, &screen)?;
            if screened.is_empty() {
                screened = screen;
            }
            let Some(best) = contest.iter().find(|next| self.insists(&after, next)) else { break };
            after = best.clone();
            rivals.push(contest);
            if self.is_far(&centre, &after) {
                say("fitting the windows anew");
                let near = self.screen(&after.residuals, &after.hypotheses).into_iter().take(ASKED_ANEW);
                let mut asked: Vec<usize> = near.map(|s| s.hypothesis).chain(after.hypotheses.clone()).collect();
                asked.sort_unstable();
                asked.dedup();
                self.centre(&after.effects, &asked)?;
                after = self.refine(&after.hypotheses, &after.effects)?;
                centre = after.clone();
                rivals.clear();
            }
        }
        say("weighing the alternatives");
        let mut after = self.without_idle(after)?;
        let mut others = self.all_rivals(&after, &rivals)?;
        // A cause taken early may have stood for one that fits better beside those taken later.
        for _ in 0..2 {
            let better = others.iter().flatten().min_by(|a, b| Self::cost(a).total_cmp(&Self::cost(b)));
            match better.filter(|r| Self::cost(r) < Self::cost(&after) - unit(&after)) {
                Some(better) => after = better.clone(),
                None => break,
            }
            others = self.all_rivals(&after, &[])?;
        }
        while let Some(vague) = self.vaguest(&after) {
            after = self.refine_without(&after, vague)?;
            others = self.all_rivals(&after, &[])?;
        }
        let taken = self.weigh(&after, &others)?;
        Ok(Selection { before, after, taken, screened })
    }

    /// Whether the rows have moved so far that what was linear around `centre` is so no more.
    fn is_far(&self, centre: &Refined, now: &Refined) -> bool {
        let moved: f64 = centre.residuals.iter().zip(&now.residuals).map(|(a, b)| (a - b).norm_squared()).sum();
        !self.is_chaotic() && moved > FAR * now.freedom
    }

    /// The best of the screen, each refitted beside the causes taken already; best first.
    fn contest(&self, taken: &Refined, screen: &[Screened]) -> Result<Vec<Refined>, ModelError> {
        let noise = unit(taken);
        let (contestants, most) = if self.is_chaotic() {
            (CONTESTANTS_IF_CHAOTIC, CONTESTANTS_IF_CHAOTIC)
        } else {
            (CONTESTANTS, MOST_CONTESTANTS)
        };
        let worth = |s: &&Screened| s.gain / noise > 0.5 * LEAST_GAIN && !taken.hypotheses.contains(&s.hypothesis);
        let mut chosen: Vec<&Screened> = screen.iter().filter(worth).take(contestants).collect();
        if let Some(best) = chosen.first().copied() {
            let near: Vec<&Screened> = screen.iter().filter(worth).skip(contestants).take(40).collect();
            let all: Vec<usize> = std::iter::once(best).chain(near.iter().copied()).map(|s| s.hypothesis).collect();
            let cosines = self.confusability(&all);
            let alike = near.iter().enumerate().filter(|(i, _)| cosines[(0, i + 1)] > ALIKE).map(|(_, s)| *s);
            chosen.extend(alike.take(most - contestants));
        }
        let refit = |s: &&Screened| -> Result<Option<Refined>, ModelError> {
            let mut hypotheses = taken.hypotheses.clone();
            hypotheses.push(s.hypothesis);
            let mut effects = taken.effects.clone();
            effects.push(s.effect.clone());
            // A start that no plant can have is a contestant that loses.
            let Ok(mut refined) = self.refine(&hypotheses, &effects) else { return Ok(None) };
            if s.effect.onset_s().is_some() {
                refined = self.refine_onset(&refined, effects.len() - 1)?;
            }
            Ok(Some(refined))
        };
        let all: Result<Vec<_>, _> = chosen.par_iter().map(refit).collect();
        let mut all: Vec<Refined> = all?.into_iter().flatten().collect();
        all.sort_by(|a, b| Self::cost(a).total_cmp(&Self::cost(b)));
        Ok(all)
    }

    /// Sum of squares and what each parameter costs: of two causes that fit alike, the one with fewer parameters.
    fn cost(refined: &Refined) -> f64 {
        let count: usize = refined.effects.iter().map(|e| e.values().len() + usize::from(e.onset_s().is_some())).sum();
        refined.chi2 + 12.0 * count as f64 * unit(refined)
    }

    /// Whether the data insist on the last cause of `next`.
    fn insists(&self, now: &Refined, next: &Refined) -> bool {
        let gain = now.chi2 - next.chi2;
        // Where nearly all is explained, a small share of the rest is worth telling too.
        let excess = now.chi2 - NEARLY_ALL * now.freedom;
        let share = if excess > 0.0 { gain / excess } else { 1.0 };
        let last = next.effects.len() - 1;
        let idle = self.hypotheses[next.hypotheses[last]].is_idle(&next.effects[last]);
        let (least, least_share) = match next.effects[last].onset_s() {
            Some(_) => (LEAST_GAIN_OF_ONSET, LEAST_SHARE_OF_ONSET),
            None => (LEAST_GAIN, LEAST_SHARE),
        };
        !idle
            && self.sides_agree(next, last)
            && self.is_worth_saying(next, last)
            && gain / unit(next) > least
            && share > least_share
            && self.kept(next, last) > LEAST_KEPT
    }

    /// Whether a cause is beyond what every laboratory is off by.
    fn is_worth_saying(&self, refined: &Refined, which: usize) -> bool {
        let hypothesis = &self.hypotheses[refined.hypotheses[which]];
        let Some(sds) = unsaid(hypothesis, &self.trial.plant) else { return true };
        let (values, nominal) = (refined.effects[which].values(), hypothesis.nominal.values());
        if hypothesis.is_compliance() {
            return 1.0 / values[0] > WORTH_SAYING * sds[0];
        }
        values.iter().zip(nominal).zip(&sds).any(|((v, n), sd)| (v - n).abs() > WORTH_SAYING * sd)
    }

    /// Leaves out what the causes taken later have made idle.
    fn without_idle(&self, mut after: Refined) -> Result<Refined, ModelError> {
        while after.hypotheses.len() > 1 {
            let mut dropped = None;
            for i in 0..after.hypotheses.len() {
                let without = self.refine_without(&after, i)?;
                if without.chi2 - after.chi2 < LEAST_GAIN * unit(&after) {
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

    fn refine_without(&self, from: &Refined, which: usize) -> Result<Refined, ModelError> {
        let keep = |i: &usize| *i != which;
        let hypotheses: Vec<usize> = (0..from.hypotheses.len()).filter(keep).map(|i| from.hypotheses[i]).collect();
        let effects: Vec<Effect> = (0..from.effects.len()).filter(keep).map(|i| from.effects[i].clone()).collect();
        if hypotheses.is_empty() { self.nothing() } else { self.refine(&hypotheses, &effects) }
    }

    /// A cause among several whose size is not known well enough to say that it is there; windows that disagree about it
    /// make it so.
    fn vaguest(&self, after: &Refined) -> Option<usize> {
        if after.hypotheses.len() < 2 {
            return None;
        }
        let spread = self.spread(after);
        let mut at = 0;
        let mut worst: Option<(usize, f64)> = None;
        for (i, (h, effect)) in after.hypotheses.iter().zip(&after.effects).enumerate() {
            let hypothesis = &self.hypotheses[*h];
            if hypothesis.is_discrete {
                continue;
            }
            let (values, nominal) = (effect.values(), hypothesis.nominal.values());
            // The first parameter of an effect with a shape is its strength; the others are sizes themselves.
            let counted = if hypothesis.has_shape { 1 } else { values.len() };
            let away = |k: usize| {
                let off = if hypothesis.is_compliance() { 1.0 / values[k] } else { values[k] - nominal[k] };
                off.abs() / spread[at + k].max(1e-300)
            };
            let clearest = (0..counted).map(away).fold(0.0, f64::max);
            if clearest < LEAST_CLEARNESS && worst.is_none_or(|(_, w)| clearest < w) {
                worst = Some((i, clearest));
            }
            at += values.len();
        }
        worst.map(|(i, _)| i)
    }

    /// The rivals of each cause taken.
    fn all_rivals(&self, after: &Refined, contests: &[Vec<Refined>]) -> Result<Vec<Vec<Refined>>, ModelError> {
        (0..after.hypotheses.len())
            .map(|i| {
                let without = self.refine_without(after, i)?;
                self.rivals_of(after, i, &without, contests)
            })
            .collect()
    }

    /// Each taken cause with its standard deviations, its rivals and its probability among them.
    fn weigh(&self, after: &Refined, rivals: &[Vec<Refined>]) -> Result<Vec<Taken>, ModelError> {
        let spread = self.spread(after);
        let mut taken = Vec::new();
        let mut at = 0;
        for (i, (h, effect)) in after.hypotheses.iter().zip(&after.effects).enumerate() {
            let count = if self.hypotheses[*h].is_discrete { 0 } else { effect.values().len() };
            let mut std: Vec<f64> = (at..at + count).map(|k| spread[k]).collect();
            if self.hypotheses[*h].is_compliance() {
                // Fitted by its inverse.
                std[0] *= effect.values()[0].powi(2);
            }
            at += count;
            let without = self.refine_without(after, i)?;
            let others = &rivals[i];
            let scale = 2.0 * TEMPER * unit(after).max(1.0);
            let weight = |r: &Refined| (-(Self::cost(r) - Self::cost(after)) / scale).exp();
            let total = 1.0 + others.iter().map(weight).sum::<f64>();
            let mut alternatives: Vec<Alternative> = others
                .iter()
                .map(|r| Alternative { effect: r.effects[i].clone(), probability: weight(r) / total })
                .collect();
            alternatives.sort_by(|a, b| b.probability.total_cmp(&a.probability));
            alternatives.retain(|a| a.probability > 1e-3);
            alternatives.truncate(6);
            taken.push(Taken {
                effect: effect.clone(),
                std,
                probability: (1.0 / total).min(0.995),
                gain: (without.chi2 - after.chi2) / unit(after),
                kept: self.kept(after, i),
                alternatives,
            });
        }
        taken.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        Ok(taken)
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
        for s in
            self.screen(&without.residuals, &others).into_iter().take(if self.is_chaotic() { 3 } else { CONTESTANTS })
        {
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

    /// Standard deviations of all parameters: the larger of what white rows and of what the scatter of the cells' own
    /// gradients gives (clustered by window, since residuals are correlated within one).
    fn spread(&self, after: &Refined) -> Vec<f64> {
        let p = after.columns.len();
        let left = self.unexplained(&after.residuals, &after.nuisance);
        let mut scatter = nalgebra::DMatrix::<f64>::zeros(p, p);
        for (i, residual) in left.iter().enumerate() {
            let gradient = DVector::from_fn(p, |k, _| after.clear[k][i].dot(residual));
            scatter += &gradient * gradient.transpose();
        }
        let clustered = &after.covariance * scatter * &after.covariance;
        let floor = unit(after);
        (0..p).map(|k| (after.covariance[(k, k)] * floor).max(clustered[(k, k)]).max(0.0).sqrt()).collect()
    }

    /// Share of the gain of cause `which` that runs keep which were left out of the fit of its parameters. Where one run alone
    /// shows it, its windows by turns.
    fn kept(&self, refined: &Refined, which: usize) -> f64 {
        let counts: Vec<usize> = refined
            .hypotheses
            .iter()
            .zip(&refined.effects)
            .map(|(h, e)| if self.hypotheses[*h].is_discrete { 0 } else { e.values().len() })
            .collect();
        if counts[which] == 0 {
            return 1.0; // nothing of it is fitted
        }
        let first: usize = counts[..which].iter().sum();
        let own: Vec<usize> = (first..first + counts[which]).collect();
        let left = self.unexplained(&refined.residuals, &refined.nuisance);
        let normals: Vec<Normal> = (0..left.len())
            .map(|i| Normal {
                g: nalgebra::DMatrix::from_fn(own.len(), own.len(), |a, b| {
                    refined.clear[own[a]][i].dot(&refined.clear[own[b]][i])
                }),
                b: DVector::from_fn(own.len(), |a, _| refined.clear[own[a]][i].dot(&left[i])),
                c: 0.0,
                freedom: 0.0,
            })
            .collect();
        let strength = |n: &Normal| n.g.trace();
        let runs = self.evidence.records.len();
        let of_run = |r: usize| -> f64 {
            normals.iter().zip(&self.evidence.cells).filter(|(_, c)| c.record == r).map(|(n, _)| strength(n)).sum()
        };
        let total: f64 = normals.iter().map(strength).sum();
        let by_run = (0..runs).filter(|r| of_run(*r) > 0.1 * total).count() >= 2;
        let fold = |i: usize| if by_run { self.evidence.cells[i].record } else { i % 4 };
        let folds: BTreeSet<usize> = (0..normals.len()).map(fold).collect();
        let hypothesis = &self.hypotheses[refined.hypotheses[which]];
        let nominal = hypothesis.nominal.values();
        // From the solution back to nominal, along the columns.
        let away = DVector::from_fn(own.len(), |k, _| nominal[k] - refined.effects[which].values()[k]);
        let (mut kept, mut whole) = (0.0, 0.0);
        for f in folds {
            let rest =
                Normal::sum(own.len(), normals.iter().enumerate().filter(|(i, _)| fold(*i) != f).map(|(_, n)| n));
            let out = Normal::sum(own.len(), normals.iter().enumerate().filter(|(i, _)| fold(*i) == f).map(|(_, n)| n));
            let columns: Vec<usize> = (0..own.len()).collect();
            let value = rest.fit(&columns).value;
            let nothing = out.change(&columns, &away);
            kept += nothing - out.change(&columns, &value);
            whole += nothing;
        }
        if whole > 0.0 { kept / whole } else { 0.0 }
    }
}

/// What noise and everything unexplained make of one degree of freedom.
pub(super) fn unit(refined: &Refined) -> f64 {
    (refined.chi2 / refined.freedom.max(1.0)).max(0.8)
}
