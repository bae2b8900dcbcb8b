//! Uncertain values settled where their influence is far from linear.
//!
//! A pendulum's period differs by a tenth of a percent where its mass sits half a millimetre elsewhere, and encoders see a
//! hundred times less than that makes in seconds. So the plant moves to where its uncertain values fit best, and is linearized
//! anew there; how far it has come from its file still costs what it did.

use super::{Contest, Order, Refined};
use crate::evidence::Cell;
use crate::hypothesis::hypotheses;
use crate::measured::Run;
use fss_multibody::ModelError;
use nalgebra::{DMatrix, DVector};

/// Moves of the plant.
const ROUNDS: usize = 12;
/// What is tried of Levenberg's damping, in units of the normal matrix's diagonal.
const DAMPING: [f64; 6] = [0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0];
/// A move that leaves more than this share of the sum of squares was the last.
const NO_BETTER: f64 = 0.999;
/// Farther than this from its file no value is moved, standard deviations: beyond it would be a cause of its own.
const FARTHEST: f64 = 4.0;

impl Contest {
    /// Moves the plant to where its uncertain values fit, as far as that lowers the sum of squares.
    pub(super) fn settle(&mut self, runs: &[Run]) -> Result<(), ModelError> {
        let mut cost = self.cost_here(&self.nothing()?);
        for _ in 0..ROUNDS {
            let (normal, right) = self.pull()?;
            let from = (self.trial.clone(), self.evidence.cells.clone(), self.moved.clone());
            let mut better = None;
            for damping in DAMPING {
                let Some(step) = self.damped(&normal, &right, damping) else { continue };
                self.move_by(&step, &from.1)?;
                let now = self.cost_here(&self.nothing()?);
                if now < cost {
                    better = Some(now);
                    break;
                }
                (self.trial, self.evidence.cells, self.moved) = from.clone();
            }
            let Some(now) = better else { break };
            self.linearize(&[], &[])?;
            let was = std::mem::replace(&mut cost, now);
            if now > NO_BETTER * was {
                break;
            }
        }
        self.linearize_all(runs)
    }

    /// Normal equations of the uncertain values alone.
    fn pull(&self) -> Result<(DMatrix<f64>, DVector<f64>), ModelError> {
        let n = self.uncertain.len();
        let residuals = self.nothing()?.residuals;
        let mut normal = self.unit * DMatrix::identity(n, n);
        let mut right = -self.unit * self.moved.rows(0, n);
        for (columns, residual) in self.columns.iter().zip(&residuals) {
            let own = columns.columns(0, n);
            normal += own.tr_mul(&own);
            right += own.tr_mul(residual);
        }
        Ok((normal, right))
    }

    /// The step that they ask for, no value farther from its file than it may be.
    fn damped(&self, normal: &DMatrix<f64>, right: &DVector<f64>, damping: f64) -> Option<DVector<f64>> {
        let mut damped = normal.clone();
        for i in 0..right.len() {
            damped[(i, i)] *= 1.0 + damping;
        }
        let mut step = damped.cholesky()?.solve(right);
        for (step, moved) in step.iter_mut().zip(self.moved.iter()) {
            *step = (*moved + *step).clamp(-FARTHEST, FARTHEST) - *moved;
        }
        Some(step)
    }

    /// The sum of squares of the residuals as they are, and of how far the plant was moved.
    fn cost_here(&self, refined: &Refined) -> f64 {
        let left: f64 = refined.residuals.iter().map(DVector::norm_squared).sum();
        left + self.unit * self.moved.norm_squared()
    }

    fn move_by(&mut self, step: &DVector<f64>, cells: &[Cell]) -> Result<(), ModelError> {
        for (uncertain, by) in self.uncertain.iter().zip(step.iter()) {
            self.trial.plant = uncertain.moved(&self.trial.plant, *by);
        }
        let mut moved = self.moved.rows_mut(0, step.len());
        moved += step;
        self.evidence.cells = cells.to_vec();
        self.evidence.settle(&self.trial)
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
