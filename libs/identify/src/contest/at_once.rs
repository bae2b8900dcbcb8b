//! Everything that could be wrong with an arm, fitted at once.
//!
//! Where small errors are far from small in what they do, a question about one cause is fair only near the truth: far from it a
//! linear answer points anywhere, and uncertain values that were settled first hide what they took up. So everything moves at
//! once, however far it wants to. Where that leads to the noise, the fewest causes are looked for that leave no more.

use super::Contest;
use super::settle::{Descent, Start};
use crate::hypothesis::Hypothesis;
use crate::uncertain::as_cause;
use fss_multibody::ModelError;
use fss_plant::{Effect, Plant};
use nalgebra::{DMatrix, DVector};

/// Weights of what is known beforehand, one descent after the other: valleys in which several values do alike are long, and the
/// way along their bottom is the shorter the more these weigh. Where that leads astray, without.
const UNITS: [&[f64]; 2] = [&[100.0, 10.0, 1.0], &[1.0, 1.0]];
/// How far an uncertain value may go: where it is the cause, as far as it must.
const AS_FAR_AS_NEEDED: f64 = 1e3;
/// Mean square up to which the motion is fitted near enough for its linear answer to hold.
const NEAR: f64 = 2.0;
/// Causes taken at most: three of one arm are more likely one that was not found.
pub(crate) const MOST_AT_ONCE: usize = 2;
/// Share of what a lone cause takes off that another in its place must take off, as far as what is linear here tells, to be
/// tried there; and how many of them are.
const WORTH_TRYING: f64 = 0.25;
const MOST_INSTEAD: usize = 3;
/// Weight of what holds a parameter where it is nothing, over what the data weigh.
const PINNED: f64 = 1e9;

impl Contest {
    /// The fewest causes that leave as little as everything together; where that is one, others that might stand in its place
    /// after it. None where not even everything fits. The plant is left where everything put it.
    pub(crate) fn at_once(&mut self, file: &Plant) -> Result<Vec<Start>, ModelError> {
        let own: Vec<usize> = (0..self.hypotheses.len()).filter(|h| self.is_loose(&self.hypotheses[*h])).collect();
        let nominal: Vec<Effect> = own.iter().map(|h| self.hypotheses[*h].nominal.clone()).collect();
        let scales = |(h, e): (&usize, &Effect)| {
            e.about().parameters.iter().take(self.hypotheses[*h].parameters()).map(|p| p.scale)
        };
        let loose: Vec<f64> = own.iter().zip(&nominal).flat_map(scales).collect();
        let descent = Descent { hypotheses: &own, loose: &loose, farthest: AS_FAR_AS_NEEDED };
        let Some(effects) = self.descended(&descent, &nominal, file)? else { return Ok(Vec::new()) };
        let point = self.point_here(&effects)?;
        let (normal, right) = self.pull_of_data(&own, &point)?;
        let off = self.off_nominal(&own, &effects);
        let mut away: Vec<f64> = self.moved.iter().take(self.uncertain.len()).copied().collect();
        away.extend(off);
        let all = Linear { normal, right, away, uncertain: self.uncertain.len(), unit: self.unit };
        Ok(self.fewest(&all, &own, file))
    }

    /// Where everything fits, beginning at the file; `None` where it does not.
    fn descended(
        &mut self,
        descent: &Descent,
        nominal: &[Effect],
        file: &Plant,
    ) -> Result<Option<Vec<Effect>>, ModelError> {
        let freedom: f64 = self.evidence.cells.iter().map(|c| c.freedom).sum();
        for units in UNITS {
            self.begin_at(file, &[], nominal)?;
            let mut effects = nominal.to_vec();
            for unit in units {
                self.set_unit(*unit);
                effects = self.descend(descent, &effects)?;
            }
            let left: f64 = self.point_here(&effects)?.residuals.iter().map(DVector::norm_squared).sum();
            if left < NEAR * freedom {
                return Ok(Some(effects));
            }
        }
        Ok(None)
    }

    /// Causes whose parameters may move freely: those with a size of their own, which no uncertain value stands for.
    fn is_loose(&self, hypothesis: &Hypothesis) -> bool {
        let is_uncertain =
            self.uncertain.iter().any(|u| as_cause(u, &self.trial.plant, 0.0).is_some_and(|e| hypothesis.is_of(&e)));
        let has_size = !hypothesis.has_shape || hypothesis.nominal.id() == "joint_spring";
        has_size && !hypothesis.is_discrete && !is_uncertain
    }

    /// Causes taken one after the other, each the one that leaves least, while that is worth a name.
    fn fewest(&self, all: &Linear, own: &[usize], file: &Plant) -> Vec<Start> {
        let first = |k: usize| -> usize { own[..k].iter().map(|h| self.hypotheses[*h].size()).sum() };
        let coordinates = |candidate: usize| -> Vec<usize> {
            if candidate < all.uncertain {
                return vec![candidate];
            }
            let k = candidate - all.uncertain;
            (first(k)..first(k) + self.hypotheses[own[k]].size()).map(|i| all.uncertain + i).collect()
        };
        let cause = |candidate: usize, at: &[f64]| -> Option<(usize, Effect)> {
            let (hypothesis, effect) = if candidate < all.uncertain {
                let effect = as_cause(&self.uncertain[candidate], file, at[candidate])?;
                (self.hypotheses.iter().position(|h| h.is_of(&effect))?, effect)
            } else {
                let hypothesis = &self.hypotheses[own[candidate - all.uncertain]];
                let values = hypothesis.nominal.values().iter().zip(coordinates(candidate));
                let values: Vec<f64> = values.map(|(nominal, i)| nominal + at[i]).collect();
                let effect = hypothesis.with(&values);
                // Where a linear answer is no value that the effect can have, it is no answer.
                if effect.values()[..values.len()] != values {
                    return None;
                }
                (own[candidate - all.uncertain], effect)
            };
            self.is_worth_saying(hypothesis, &effect).then_some((hypothesis, effect))
        };
        // Where these causes alone put everything, and what they leave.
        let with = |taken: &[usize]| -> Option<(f64, Start)> {
            let free: Vec<usize> = taken.iter().flat_map(|c| coordinates(*c)).collect();
            let (left, at) = all.least(&free)?;
            let causes: Option<Vec<(usize, Effect)>> = taken.iter().map(|c| cause(*c, &at)).collect();
            let (hypotheses, effects) = causes?.into_iter().unzip();
            // What became a cause stands where its file has it.
            let off_file = (0..all.uncertain).map(|i| if taken.contains(&i) { 0.0 } else { at[i] }).collect();
            Some((left, Start { hypotheses, effects, off_file }))
        };
        let candidates = 0..all.uncertain + own.len();
        let Some((nothing, mut start)) = with(&[]) else { return Vec::new() };
        let (mut taken, mut left) = (Vec::new(), nothing);
        while taken.len() < MOST_AT_ONCE {
            let beside = |candidate: usize| {
                let more: Vec<usize> = taken.iter().copied().chain([candidate]).collect();
                let (less, start) = with(&more)?;
                let insists = left - less > self.least_gain(start.effects.last()?) * self.unit;
                insists.then_some((less, start, more))
            };
            let more = candidates.clone().filter(|c| !taken.contains(c)).filter_map(beside);
            let Some(best) = more.min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            (left, start, taken) = best;
        }
        if taken.len() != 1 {
            return if taken.is_empty() { Vec::new() } else { vec![start] };
        }
        let others = candidates.filter(|c| !taken.contains(c)).filter_map(|c| with(&[c]));
        let mut instead: Vec<(f64, Start)> =
            others.filter(|(less, _)| nothing - less > WORTH_TRYING * (nothing - left)).collect();
        instead.sort_by(|a, b| a.0.total_cmp(&b.0));
        std::iter::once(start).chain(instead.into_iter().take(MOST_INSTEAD).map(|(_, start)| start)).collect()
    }
}

/// A sum of squares around a point, in uncertain values and causes' parameters.
struct Linear {
    normal: DMatrix<f64>,
    right: DVector<f64>,
    /// Where the point is: of uncertain values in standard deviations from their file, of parameters from where they are nothing.
    away: Vec<f64>,
    /// How many of them, the first ones, are uncertain values.
    uncertain: usize,
    unit: f64,
}

impl Linear {
    /// The least that is left where these coordinates are free, uncertain values cost what they are away and the others are
    /// nothing, but for a constant; and where everything is then.
    fn least(&self, free: &[usize]) -> Option<(f64, Vec<f64>)> {
        let heaviest = self.normal.diagonal().max();
        let weight = |i: usize| match i {
            _ if free.contains(&i) => 0.0,
            _ if i < self.uncertain => self.unit,
            _ => PINNED * heaviest,
        };
        let size = self.away.len();
        let (mut normal, mut right) = (self.normal.clone(), self.right.clone());
        for i in 0..size {
            normal[(i, i)] += weight(i);
            right[i] -= weight(i) * self.away[i];
        }
        let step = normal.cholesky()?.solve(&right);
        let at: Vec<f64> = self.away.iter().zip(step.iter()).map(|(away, step)| away + step).collect();
        let squares = (&self.normal * &step).dot(&step) - 2.0 * self.right.dot(&step);
        let cost: f64 = at.iter().enumerate().map(|(i, at)| weight(i) * at * at).sum();
        Some((squares + cost, at))
    }
}
