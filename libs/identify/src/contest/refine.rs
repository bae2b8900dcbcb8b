//! A few causes at once, refitted with the real simulation.

use super::{Contest, Reduced};
use crate::evidence::Cell;
use crate::normal::Fit;
use crate::sensitivity::Column;
use crate::trial::Trial;
use fss_multibody::ModelError;
use fss_plant::Effect;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Rounds of Gauss-Newton, and of a contestant of which nobody knows yet whether it is worth them.
const ROUNDS: usize = 6;
const ROUNDS_AT_FIRST: usize = 2;
/// A step that gains less was the last.
const LEAST_STEP: f64 = 0.5;
/// A last step that gains less than this share of that is not worth taking. One that gains half of it is: where priors alone tell two
/// clocks of a millisecond apart, that is half a millisecond.
const IDLE_STEP: f64 = 0.05;

/// Share of a drive's stiffness over which what it does is differenced: from a few times this on, swings are no matter of proportion.
const COMPLIANCE_STEP: f64 = 2e-3;

/// Causes with the values that fit best.
#[derive(Clone)]
pub(crate) struct Refined {
    /// Index of each in the contest's hypotheses.
    pub(crate) hypotheses: Vec<usize>,
    pub(crate) effects: Vec<Effect>,
    /// How many parameters of each are fitted: none of an exchange.
    pub(crate) fitted: Vec<usize>,
    /// Sum of squares, what the nuisances absorb taken out.
    pub(crate) chi2: f64,
    pub(crate) freedom: f64,
    /// Covariance of all parameters, in order, where the rows are white.
    pub(crate) covariance: DMatrix<f64>,
    /// What the nuisances have absorbed.
    pub(crate) nuisance: DVector<f64>,
    /// Residuals of the cells.
    pub(crate) residuals: Vec<DVector<f64>>,
    /// Columns of the parameters at the solution.
    pub(crate) columns: Vec<Column>,
    /// The same with what the nuisances absorb of them taken off.
    pub(crate) clear: Vec<Column>,
    /// What the nuisances would take of each column.
    pub(crate) by_column: DMatrix<f64>,
    /// Whether more rounds would gain nothing.
    pub(super) is_settled: bool,
}

impl Refined {
    /// What is left, in units of what noise leaves.
    pub(crate) fn mean_square(&self) -> f64 {
        self.chi2 / self.freedom.max(1.0)
    }

    /// Which of the columns are a cause's own.
    pub(super) fn columns_of(&self, which: usize) -> Range<usize> {
        let first: usize = self.fitted[..which].iter().sum();
        first..first + self.fitted[which]
    }
}

/// Effects, and what they leave.
pub(super) struct Point {
    pub(super) effects: Vec<Effect>,
    pub(super) cells: Vec<Cell>,
    pub(super) residuals: Vec<DVector<f64>>,
}

impl Contest {
    /// The plant as it is, no cause taken.
    pub(crate) fn nothing(&self) -> Result<Refined, ModelError> {
        let residuals = self.evidence.residuals(&self.trial, &self.evidence.cells)?;
        let Reduced { normal, nuisance, .. } = self.reduce(&residuals, &[]);
        Ok(Refined {
            hypotheses: Vec::new(),
            effects: Vec::new(),
            fitted: Vec::new(),
            chi2: normal.c,
            freedom: normal.freedom,
            covariance: DMatrix::zeros(0, 0),
            nuisance,
            residuals,
            columns: Vec::new(),
            clear: Vec::new(),
            by_column: DMatrix::zeros(0, 0),
            is_settled: true,
        })
    }

    /// Fits the parameters of `effects`, beginning at their values.
    pub(crate) fn refine(&self, hypotheses: &[usize], effects: &[Effect]) -> Result<Refined, ModelError> {
        self.refine_from(self.walk(hypotheses, self.point(effects)?, 0)?, hypotheses, ROUNDS)
    }

    /// The same for as few rounds as tell whether the last of the causes is worth more; of soft drives, its own alone is looked for.
    pub(super) fn refine_at_first(&self, hypotheses: &[usize], effects: &[Effect]) -> Result<Refined, ModelError> {
        let last = hypotheses.len().saturating_sub(1);
        let begun =
            self.refine_from(self.walk(hypotheses, self.point(effects)?, last)?, hypotheses, ROUNDS_AT_FIRST)?;
        let others_swing = (0..last).any(|i| self.swings(hypotheses[i], &begun.effects[i]));
        Ok(Refined { is_settled: begun.is_settled && !others_swing, ..begun })
    }

    fn refine_from(&self, start: Point, hypotheses: &[usize], rounds: usize) -> Result<Refined, ModelError> {
        let mut now = start;
        let mut is_settled = false;
        let mut columns = self.columns_at(hypotheses, &now)?;
        let mut reduced = self.reduce(&now.residuals, &columns);
        for _ in 0..rounds {
            is_settled = true; // wherever this round ends before its own step counted
            let all: Vec<usize> = (0..columns.len()).collect();
            let fit = reduced.normal.fit(&all);
            if fit.gain < IDLE_STEP * LEAST_STEP {
                break;
            }
            let Some((next, better)) = self.step(hypotheses, &now, &fit, reduced.normal.c) else { break };
            let is_last = reduced.normal.c - better < LEAST_STEP;
            now = next;
            if !is_last {
                columns = self.columns_at(hypotheses, &now)?;
            }
            reduced = self.reduce(&now.residuals, &columns);
            if is_last {
                break;
            }
            is_settled = false;
        }
        let all: Vec<usize> = (0..columns.len()).collect();
        let covariance = reduced.normal.fit(&all).covariance;
        let clear = self.clear_of(&columns, &reduced.by_column);
        let fitted = hypotheses.iter().map(|h| self.hypotheses[*h].parameters()).collect();
        Ok(Refined {
            hypotheses: hypotheses.to_vec(),
            effects: now.effects,
            fitted,
            chi2: reduced.normal.c,
            freedom: reduced.normal.freedom,
            covariance,
            nuisance: reduced.nuisance,
            residuals: now.residuals,
            columns,
            clear,
            by_column: reduced.by_column,
            is_settled,
        })
    }

    pub(super) fn point(&self, effects: &[Effect]) -> Result<Point, ModelError> {
        let cells = self.evidence.under(&self.trial_with(effects), &self.evidence.cells)?;
        let residuals = cells.iter().map(|c| c.residual.clone()).collect();
        Ok(Point { effects: effects.to_vec(), cells, residuals })
    }

    /// The plant as it is with these effects too.
    pub(crate) fn trial_with(&self, effects: &[Effect]) -> Trial {
        let mut trial = self.trial.clone();
        trial.effects.extend(effects.iter().cloned());
        trial
    }

    /// A step along the fit that makes the sum of squares smaller, shortened until it does; `None` where none does.
    fn step(&self, hypotheses: &[usize], now: &Point, fit: &Fit, chi2: f64) -> Option<(Point, f64)> {
        let mut length = 1.0;
        for _ in 0..4 {
            let effects = self.moved_by(hypotheses, &now.effects, &(length * &fit.value));
            if let Ok(next) = self.point(&effects) {
                let better = self.reduce(&next.residuals, &[]).normal.c;
                if better < chi2 {
                    return Some((next, better));
                }
            }
            length *= 0.3;
        }
        None
    }

    /// Effects whose fitted parameters have moved by so much, one after the other.
    fn moved_by(&self, hypotheses: &[usize], effects: &[Effect], step: &DVector<f64>) -> Vec<Effect> {
        let mut steps = step.iter();
        let moved = |(h, effect): (&usize, &Effect)| {
            let hypothesis = &self.hypotheses[*h];
            let with = |(v, by): (&f64, &f64)| {
                // A stiffness is fitted by its inverse.
                if hypothesis.is_compliance() { 1.0 / (1.0 / v + by).max(1e-6) } else { v + by }
            };
            let values: Vec<f64> =
                effect.values()[..hypothesis.parameters()].iter().zip(steps.by_ref()).map(with).collect();
            let moved = hypothesis.with(&values);
            match effect.onset_s() {
                Some(onset_s) => moved.from_onset(onset_s),
                None => moved,
            }
        };
        hypotheses.iter().zip(effects).map(moved).collect()
    }

    /// Columns of every parameter at the effects' values.
    fn columns_at(&self, hypotheses: &[usize], at: &Point) -> Result<Vec<Column>, ModelError> {
        let mut columns = Vec::new();
        for (k, (h, effect)) in hypotheses.iter().zip(&at.effects).enumerate() {
            let hypothesis = &self.hypotheses[*h];
            for i in 0..hypothesis.parameters() {
                let about = &effect.about().parameters[i];
                let value = effect.values()[i];
                let mut step = (0.02 * about.scale)
                    .min(0.05 * (value - hypothesis.nominal.values()[i]).abs().max(1e-4 * about.scale));
                if hypothesis.is_compliance() {
                    step = COMPLIANCE_STEP * value;
                } else if value + step > about.upper {
                    step = -step;
                }
                let mut values = effect.values().to_vec();
                values[i] += step;
                let mut effects = at.effects.clone();
                effects[k] = effect.clone().with(&values);
                let after = self.evidence.residuals(&self.trial_with(&effects), &at.cells)?;
                let by = if hypothesis.is_compliance() { 1.0 / (value + step) - 1.0 / value } else { step };
                columns.push(at.residuals.iter().zip(after).map(|(before, after)| (before - after) / by).collect());
            }
        }
        Ok(columns)
    }

    /// Moves the onset of effect `which` to where it fits best, between the windows around it.
    pub(crate) fn refine_onset(&self, from: &Refined, which: usize) -> Result<Refined, ModelError> {
        let Some(onset_s) = from.effects[which].onset_s() else { return Ok(from.clone()) };
        let width_s = self.evidence.cells.first().map_or(1.0, |c| c.to_s - c.from_s);
        let latest_s = self.latest_onset_s();
        let chi2 = |t_s: f64| -> Result<f64, ModelError> {
            let mut effects = from.effects.clone();
            effects[which] = effects[which].clone().from_onset(t_s);
            Ok(self.reduce(&self.point(&effects)?.residuals, &[]).normal.c)
        };
        let mut best = (onset_s, from.chi2);
        let mut reach_s = width_s;
        for _ in 0..4 {
            let middle = best.0;
            for k in [-1.0, -0.5, 0.5, 1.0] {
                let t_s = middle + k * reach_s;
                if t_s > 0.0 && t_s <= latest_s {
                    let now = chi2(t_s)?;
                    if now < best.1 {
                        best = (t_s, now);
                    }
                }
            }
            reach_s *= 0.35;
        }
        let mut effects = from.effects.clone();
        effects[which] = effects[which].clone().from_onset(best.0);
        self.refine(&from.hypotheses, &effects)
    }
}
