//! How the data would change with each uncertain value and each possible cause.

use crate::evidence::{Cell, Evidence};
use crate::hypothesis::{Hypothesis, with};
use crate::normal::Normal;
use crate::trial::Trial;
use fss_diagnosis::uncertain::Uncertain;
use fss_multibody::ModelError;
use fss_plant::Effect;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Step of an uncertain value, standard deviations.
const STEP: f64 = 0.5;
/// A step that changes the whitened rows by more than this (RMS) is too long to be taken for a derivative.
const LARGEST_CHANGE: f64 = 2.0;
/// And one that changes them by less drowns in rounding.
const SMALLEST_CHANGE: f64 = 1e-6;

/// One column: a vector a cell.
pub(crate) type Column = Vec<DVector<f64>>;

impl Evidence {
    /// Columns of a hypothesis around `trial`.
    pub(crate) fn columns_of(
        &self,
        trial: &Trial,
        cells: &[Cell],
        hypothesis: &Hypothesis,
    ) -> Result<Vec<Column>, ModelError> {
        hypothesis
            .differences()
            .iter()
            .map(|(from, to, step)| {
                let felt = Some(&hypothesis.nominal);
                let start = match from {
                    Some(effect) => Some(self.residuals_where(&with(trial, Some(effect)), cells, felt)?),
                    None => None,
                };
                if hypothesis.is_discrete {
                    return self.exchange(trial, cells, to);
                }
                if hypothesis.has_shape || hypothesis.is_compliance() {
                    return self.difference(trial, cells, start.as_ref(), to, *step, felt);
                }
                self.tuned(trial, cells, &hypothesis.nominal, to, *step)
            })
            .collect()
    }

    /// The column of what is there or not: so far away that the windows' own unknowns must follow.
    fn exchange(&self, trial: &Trial, cells: &[Cell], to: &Effect) -> Result<Column, ModelError> {
        let felt: Vec<Cell> = cells.iter().filter(|c| self.records[c.record].feels(to)).cloned().collect();
        let mut fresh = self.under(&trial.with(to), &felt)?.into_iter();
        let after = |c: &Cell| {
            let feels = self.records[c.record].feels(to);
            if feels {
                fresh.next().map_or_else(|| DVector::zeros(c.residual.len()), |f| &c.residual - &f.residual)
            } else {
                DVector::zeros(c.residual.len())
            }
        };
        Ok(cells.iter().map(after).collect())
    }

    /// A column whose step is made as long as the data can bear.
    fn tuned(
        &self,
        trial: &Trial,
        cells: &[Cell],
        from: &Effect,
        to: &Effect,
        step: f64,
    ) -> Result<Column, ModelError> {
        let (mut to, mut step) = (to.clone(), step);
        let mut column = Vec::new();
        for _ in 0..3 {
            column = self.difference(trial, cells, None, &to, step, Some(from))?;
            let change = largest_rms(&column) * step;
            if change == 0.0 || (SMALLEST_CHANGE..LARGEST_CHANGE).contains(&change) {
                break;
            }
            let factor = 0.1 / change;
            step *= factor;
            let values: Vec<f64> = from.values().iter().zip(to.values()).map(|(a, b)| a + (b - a) * factor).collect();
            to = to.with(&values);
        }
        Ok(column)
    }

    fn difference(
        &self,
        trial: &Trial,
        cells: &[Cell],
        start: Option<&Column>,
        to: &Effect,
        step: f64,
        felt: Option<&Effect>,
    ) -> Result<Column, ModelError> {
        let end = self.residuals_where(&trial.with(to), cells, felt)?;
        let before = |i: usize| start.map_or(&cells[i].residual, |s| &s[i]);
        Ok(end.into_iter().enumerate().map(|(i, after)| (before(i) - after) / step).collect())
    }

    /// Residuals of the cells whose run feels the effect; those of the others stay.
    fn residuals_where(&self, trial: &Trial, cells: &[Cell], felt: Option<&Effect>) -> Result<Column, ModelError> {
        let feels = |c: &Cell| felt.is_none_or(|e| self.records[c.record].feels(e));
        let some: Vec<Cell> = cells.iter().filter(|c| feels(c)).cloned().collect();
        let mut fresh = self.residuals(trial, &some)?.into_iter();
        Ok(cells
            .iter()
            .map(|c| if feels(c) { fresh.next().unwrap_or_else(|| c.residual.clone()) } else { c.residual.clone() })
            .collect())
    }

    /// Columns of all uncertain values (in standard deviations), then of all hypotheses.
    pub(crate) fn sensitivities(
        &self,
        trial: &Trial,
        uncertain: &[Uncertain],
        hypotheses: &[&Hypothesis],
    ) -> Result<Vec<Column>, ModelError> {
        let of_value = |u: &Uncertain| -> Result<Vec<Column>, ModelError> {
            let moved = Trial { plant: u.moved(&trial.plant, STEP), effects: trial.effects.clone() };
            let end = self.residuals(&moved, &self.cells)?;
            Ok(vec![self.cells.iter().zip(end).map(|(c, after)| (&c.residual - after) / STEP).collect()])
        };
        let mut all: Vec<Column> =
            uncertain.par_iter().map(of_value).collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect();
        let of_hypothesis = |h: &&Hypothesis| match trial.effects.iter().position(|e| !h.is_discrete && h.is_of(e)) {
            Some(acting) => {
                let mut rest = trial.clone();
                let effect = rest.effects.remove(acting);
                self.columns_of(&rest, &self.cells, &h.around(&effect))
            }
            None => self.columns_of(trial, &self.cells, h),
        };
        let of_hypotheses = hypotheses.par_iter().map(of_hypothesis);
        all.extend(of_hypotheses.collect::<Result<Vec<_>, _>>()?.into_iter().flatten());
        Ok(all)
    }
}

fn largest_rms(column: &Column) -> f64 {
    column.iter().map(|c| c.norm() / (c.len() as f64).sqrt()).fold(0.0, f64::max)
}

/// Normal equations of each cell.
pub(crate) fn normals(cells: &[Cell], columns: &[DMatrix<f64>]) -> Vec<Normal> {
    let of = |(cell, j): (&Cell, &DMatrix<f64>)| Normal {
        g: j.transpose() * j,
        b: j.tr_mul(&cell.residual),
        c: cell.residual.norm_squared(),
        freedom: cell.freedom,
    };
    cells.par_iter().zip(columns).map(of).collect()
}
