//! Uncertain values settled where their influence is far from linear.
//!
//! A pendulum's period differs by a tenth of a percent where its mass sits half a millimetre elsewhere, and encoders see a
//! hundred times less than that makes in seconds. So the plant moves to where its uncertain values fit best, and is linearized
//! anew there; how far it has come from its file still costs what it did.

use super::refine::Point;
use super::{Contest, Order};
use crate::evidence::Cell;
use crate::hypothesis::hypotheses;
use crate::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Plant};
use nalgebra::{DMatrix, DVector};

/// Moves of the plant.
const ROUNDS: usize = 12;
/// What is tried of Levenberg's damping, in units of the normal matrix's diagonal.
const DAMPING: [f64; 6] = [0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0];
/// A move that leaves more than this share of the sum of squares was the last.
const NO_BETTER: f64 = 0.999;
/// How often a walk begins at the plant file again, with the causes where the last one left them.
const WALKS: usize = 4;
/// A cause whose parameters all move by a smaller share stays where it is.
const ALIKE: f64 = 0.01;
/// Farther than this from its file no value is moved, standard deviations: beyond it would be a cause of its own.
const FARTHEST: f64 = 4.0;

impl Contest {
    /// Moves the plant to where its uncertain values fit, as far as that lowers the sum of squares.
    pub(super) fn settle(&mut self, runs: &[Run]) -> Result<(), ModelError> {
        self.walk_beside(&[], &[])?;
        self.linearize_all(runs)
    }

    /// The same from the plant file anew, with causes acting whose parameters move along: what an uncertain value had to take up
    /// while its cause was not known it gives back. The effects as they fit best beside it.
    pub(crate) fn settle_anew(
        &mut self,
        hypotheses: &[usize],
        effects: &[Effect],
        file: &Plant,
        runs: &[Run],
    ) -> Result<Vec<Effect>, ModelError> {
        let mut effects = effects.to_vec();
        for _ in 0..WALKS {
            self.begin_at(file, &effects)?;
            let before = std::mem::take(&mut effects);
            effects = self.walk_beside(hypotheses, &before)?;
            if are_alike(&effects, &before) {
                break;
            }
        }
        self.evidence.settle(&self.trial)?;
        self.linearize_all(runs)?;
        Ok(effects)
    }

    fn begin_at(&mut self, file: &Plant, effects: &[Effect]) -> Result<(), ModelError> {
        self.trial.plant.clone_from(file);
        self.moved.fill(0.0);
        self.evidence.settle(&self.trial_with(effects))?;
        self.linearize(effects, &[])
    }

    /// Moves uncertain values and the effects' parameters downhill.
    fn walk_beside(&mut self, hypotheses: &[usize], effects: &[Effect]) -> Result<Vec<Effect>, ModelError> {
        let mut effects = effects.to_vec();
        let mut cost = self.cost_here(&effects)?;
        for _ in 0..ROUNDS {
            let (normal, right) = self.pull(hypotheses, &effects)?;
            let from = (self.trial.clone(), self.evidence.cells.clone(), self.moved.clone());
            let mut better = None;
            for damping in DAMPING {
                let Some(step) = self.damped(&normal, &right, damping) else { continue };
                let own = step.rows(self.uncertain.len(), step.len() - self.uncertain.len()).into_owned();
                let next = self.moved_by(hypotheses, &effects, &own);
                self.move_by(&step, &next, &from.1)?;
                let now = self.cost_here(&next)?;
                if now < cost {
                    better = Some((now, next));
                    break;
                }
                (self.trial, self.evidence.cells, self.moved) = from.clone();
            }
            let Some((now, next)) = better else { break };
            effects = next;
            self.linearize(&effects, &[])?;
            let was = std::mem::replace(&mut cost, now);
            if now > NO_BETTER * was {
                break;
            }
        }
        Ok(effects)
    }

    /// Normal equations of the uncertain values, and after them of what causes have for parameters.
    fn pull(&self, hypotheses: &[usize], effects: &[Effect]) -> Result<(DMatrix<f64>, DVector<f64>), ModelError> {
        let n = self.uncertain.len();
        let point = self.point_here(effects)?;
        let own = self.columns_at(hypotheses, &point)?;
        let size = n + own.len();
        let mut normal = DMatrix::zeros(size, size);
        let mut right = DVector::zeros(size);
        for k in 0..n {
            normal[(k, k)] = self.unit;
            right[k] = -self.unit * self.moved[k];
        }
        for (cell, residual) in point.residuals.iter().enumerate() {
            let mut columns = DMatrix::zeros(residual.len(), size);
            columns.columns_mut(0, n).copy_from(&self.columns[cell].columns(0, n));
            for (k, column) in own.iter().enumerate() {
                columns.set_column(n + k, &column[cell]);
            }
            normal += columns.tr_mul(&columns);
            right += columns.tr_mul(residual);
        }
        Ok((normal, right))
    }

    /// The step that they ask for, no uncertain value farther from its file than it may be.
    fn damped(&self, normal: &DMatrix<f64>, right: &DVector<f64>, damping: f64) -> Option<DVector<f64>> {
        let mut damped = normal.clone();
        for i in 0..right.len() {
            damped[(i, i)] *= 1.0 + damping;
        }
        let mut step = damped.cholesky()?.solve(right);
        for (step, moved) in step.iter_mut().zip(self.moved.iter().take(self.uncertain.len())) {
            *step = (*moved + *step).clamp(-FARTHEST, FARTHEST) - *moved;
        }
        Some(step)
    }

    /// Residuals with causes acting, the windows' own unknowns as they are.
    fn point_here(&self, effects: &[Effect]) -> Result<Point, ModelError> {
        let cells = self.evidence.cells.clone();
        let residuals = self.evidence.residuals(&self.trial_with(effects), &cells)?;
        Ok(Point { effects: effects.to_vec(), cells, residuals })
    }

    /// The sum of squares of the residuals as they are, and of how far the plant was moved.
    fn cost_here(&self, effects: &[Effect]) -> Result<f64, ModelError> {
        let left: f64 = self.point_here(effects)?.residuals.iter().map(DVector::norm_squared).sum();
        Ok(left + self.unit * self.moved.norm_squared())
    }

    fn move_by(&mut self, step: &DVector<f64>, effects: &[Effect], cells: &[Cell]) -> Result<(), ModelError> {
        let own = step.rows(0, self.uncertain.len());
        for (uncertain, by) in self.uncertain.iter().zip(own.iter()) {
            self.trial.plant = uncertain.moved(&self.trial.plant, *by);
        }
        let mut moved = self.moved.rows_mut(0, own.len());
        moved += own;
        self.evidence.cells = cells.to_vec();
        self.evidence.settle(&self.trial_with(effects))
    }

    fn linearize_all(&mut self, runs: &[Run]) -> Result<(), ModelError> {
        self.hypotheses = hypotheses(&self.trial.plant, runs);
        self.order = Order::new(&self.trial.plant, &self.uncertain, &self.hypotheses);
        let width = self.order.width;
        self.columns = self.evidence.cells.iter().map(|c| DMatrix::zeros(c.residual.len(), width)).collect();
        let all: Vec<usize> = (0..self.hypotheses.len()).collect();
        self.linearize(&[], &all)
    }
}

fn are_alike(some: &[Effect], others: &[Effect]) -> bool {
    let values = |effects: &[Effect]| effects.iter().flat_map(|e| e.values().to_vec()).collect::<Vec<_>>();
    let is_close = |(a, b): (f64, f64)| (a - b).abs() <= ALIKE * a.abs().max(b.abs());
    values(some).into_iter().zip(values(others)).all(is_close)
}
