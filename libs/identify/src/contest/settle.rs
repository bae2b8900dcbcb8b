//! Uncertain values settled where their influence is far from linear.
//!
//! A pendulum's period differs by a tenth of a percent where its mass sits half a millimetre elsewhere, and encoders see a
//! hundred times less than that makes in seconds. So the plant moves to where its uncertain values fit best, and is linearized
//! anew there; how far it has come from its file still costs what it did.

use super::refine::Point;
use super::{Contest, Order, Refined};
use crate::evidence::Cell;
use crate::hypothesis::hypotheses;
use crate::trial::Trial;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Plant};
use nalgebra::{DMatrix, DVector};

/// Moves of the plant.
const ROUNDS: usize = 12;
/// What is tried of Levenberg's damping, in units of the normal matrix's diagonal.
const DAMPING: [f64; 6] = [0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0];
/// A move that leaves more than this share of the sum of squares was the last.
const NO_BETTER: f64 = 0.999;
/// How often a descent begins at the plant file again, with the causes where the last one left them.
const DESCENTS: usize = 4;
/// A cause whose parameters all move by a smaller share stays where it is.
const ALIKE: f64 = 0.01;
/// Farther than this from its file no value is moved, standard deviations: beyond it would be a cause of its own.
pub(super) const FARTHEST: f64 = 4.0;

/// Where a plant was moved to, with the windows' own unknowns there.
#[derive(Clone)]
pub(crate) struct Place {
    trial: Trial,
    cells: Vec<Cell>,
    moved: DVector<f64>,
}

/// What a descent may move beside the uncertain values, and how far.
pub(super) struct Descent<'a> {
    /// Causes.
    pub(super) hypotheses: &'a [usize],
    /// Standard deviations of their parameters about where they do nothing; empty where they are free.
    pub(super) loose: &'a [f64],
    /// How far from its file an uncertain value may be moved, standard deviations.
    pub(super) farthest: f64,
}

impl<'a> Descent<'a> {
    fn beside(hypotheses: &'a [usize]) -> Self {
        Self { hypotheses, loose: &[], farthest: FARTHEST }
    }
}

/// Causes, and where a descent beside them begins.
#[derive(Clone)]
pub(crate) struct Start {
    pub(crate) hypotheses: Vec<usize>,
    pub(crate) effects: Vec<Effect>,
    /// How far from their file uncertain values are, standard deviations.
    pub(super) off_file: Vec<f64>,
}

impl Contest {
    /// Moves the plant to where its uncertain values fit, as far as that lowers the sum of squares.
    pub(super) fn settle(&mut self, runs: &[Run]) -> Result<(), ModelError> {
        self.descend(&Descent::beside(&[]), &[])?;
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
        for _ in 0..DESCENTS {
            self.begin_at(file, &[], &effects)?;
            let before = std::mem::take(&mut effects);
            effects = self.descend(&Descent::beside(hypotheses), &before)?;
            if are_alike(&effects, &before) {
                break;
            }
        }
        self.evidence.settle(&self.trial)?;
        self.linearize_all(runs)?;
        Ok(effects)
    }

    /// The same from a start that is near.
    pub(crate) fn settle_from(&mut self, start: &Start, file: &Plant, runs: &[Run]) -> Result<Refined, ModelError> {
        self.begin_at(file, &start.off_file, &start.effects)?;
        let effects = self.descend(&Descent::beside(&start.hypotheses), &start.effects)?;
        self.evidence.settle(&self.trial)?;
        self.linearize_all(runs)?;
        self.centre(&effects, &[])?;
        self.refine(&start.hypotheses, &effects)
    }

    /// The plant with its uncertain values so far from its file, standard deviations; of those that are not told, none.
    pub(super) fn begin_at(&mut self, file: &Plant, off_file: &[f64], effects: &[Effect]) -> Result<(), ModelError> {
        self.trial.plant.clone_from(file);
        self.moved.fill(0.0);
        for (k, (uncertain, off)) in self.uncertain.iter().zip(off_file).enumerate() {
            self.moved[k] = off.clamp(-FARTHEST, FARTHEST);
            self.trial.plant = uncertain.moved(&self.trial.plant, self.moved[k]);
        }
        self.evidence.settle(&self.trial_with(effects))?;
        self.linearize(effects, &[])
    }

    /// Moves uncertain values and the effects' parameters downhill.
    pub(super) fn descend(&mut self, descent: &Descent, effects: &[Effect]) -> Result<Vec<Effect>, ModelError> {
        let mut effects = effects.to_vec();
        let mut cost = self.cost_here(descent, &effects)?;
        for _ in 0..ROUNDS {
            let Some((now, next)) = self.lower(descent, &effects, cost)? else { break };
            effects = next;
            self.linearize(&effects, &[])?;
            let was = std::mem::replace(&mut cost, now);
            if now > NO_BETTER * was {
                break;
            }
        }
        Ok(effects)
    }

    /// A step to where less than `cost` is left, and the effects there; `None` where none leads there, and nothing is moved then.
    fn lower(
        &mut self,
        descent: &Descent,
        effects: &[Effect],
        cost: f64,
    ) -> Result<Option<(f64, Vec<Effect>)>, ModelError> {
        let equations = self.pull(descent, effects)?;
        let from = self.place();
        for damping in DAMPING {
            match self.step_along(&equations, descent, effects, damping)? {
                Some((now, next)) if now < cost => return Ok(Some((now, next))),
                Some(_) => self.put(from.clone()),
                None => {}
            }
        }
        Ok(None)
    }

    /// Moves as the equations ask for; what is left then, and the effects.
    fn step_along(
        &mut self,
        (normal, right): &(DMatrix<f64>, DVector<f64>),
        descent: &Descent,
        effects: &[Effect],
        damping: f64,
    ) -> Result<Option<(f64, Vec<Effect>)>, ModelError> {
        let Some(step) = self.damped(normal, right, damping, descent.farthest) else { return Ok(None) };
        let own = step.rows(self.uncertain.len(), step.len() - self.uncertain.len()).into_owned();
        let next = self.moved_by(descent.hypotheses, effects, &own);
        let cells = self.evidence.cells.clone();
        self.move_by(&step, &next, &cells)?;
        Ok(Some((self.cost_here(descent, &next)?, next)))
    }

    /// Normal equations of the uncertain values, and after them of what causes have for parameters, with what is known of them.
    fn pull(&self, descent: &Descent, effects: &[Effect]) -> Result<(DMatrix<f64>, DVector<f64>), ModelError> {
        let n = self.uncertain.len();
        let (mut normal, mut right) = self.pull_of_data(descent.hypotheses, &self.point_here(effects)?)?;
        for k in 0..n {
            normal[(k, k)] += self.unit;
            right[k] -= self.unit * self.moved[k];
        }
        for (k, (off, sd)) in self.off_nominal(descent.hypotheses, effects).iter().zip(descent.loose).enumerate() {
            normal[(n + k, n + k)] += self.unit / sd.powi(2);
            right[n + k] -= self.unit * off / sd.powi(2);
        }
        Ok((normal, right))
    }

    /// The same of the data alone.
    pub(super) fn pull_of_data(
        &self,
        hypotheses: &[usize],
        point: &Point,
    ) -> Result<(DMatrix<f64>, DVector<f64>), ModelError> {
        let n = self.uncertain.len();
        let own = self.columns_at(hypotheses, point)?;
        let size = n + own.len();
        let (mut normal, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
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

    /// How far the causes' parameters are from where they do nothing.
    pub(super) fn off_nominal(&self, hypotheses: &[usize], effects: &[Effect]) -> Vec<f64> {
        let off = |(h, effect): (&usize, &Effect)| -> Vec<f64> {
            let hypothesis = &self.hypotheses[*h];
            let both = effect.values().iter().zip(hypothesis.nominal.values());
            both.take(hypothesis.parameters()).map(|(v, nominal)| v - nominal).collect()
        };
        hypotheses.iter().zip(effects).flat_map(off).collect()
    }

    /// The step that they ask for, no uncertain value farther from its file than it may be.
    fn damped(&self, normal: &DMatrix<f64>, right: &DVector<f64>, damping: f64, farthest: f64) -> Option<DVector<f64>> {
        let mut damped = normal.clone();
        for i in 0..right.len() {
            damped[(i, i)] *= 1.0 + damping;
        }
        let mut step = damped.cholesky()?.solve(right);
        for (step, moved) in step.iter_mut().zip(self.moved.iter().take(self.uncertain.len())) {
            *step = (*moved + *step).clamp(-farthest, farthest) - *moved;
        }
        Some(step)
    }

    /// Residuals with causes acting, the windows' own unknowns as they are.
    pub(super) fn point_here(&self, effects: &[Effect]) -> Result<Point, ModelError> {
        let cells = self.evidence.cells.clone();
        let residuals = self.evidence.residuals(&self.trial_with(effects), &cells)?;
        Ok(Point { effects: effects.to_vec(), cells, residuals })
    }

    /// The sum of squares of the residuals as they are, and of how far plant and causes were moved.
    fn cost_here(&self, descent: &Descent, effects: &[Effect]) -> Result<f64, ModelError> {
        let left: f64 = self.point_here(effects)?.residuals.iter().map(DVector::norm_squared).sum();
        let off = self.off_nominal(descent.hypotheses, effects);
        let causes: f64 = off.iter().zip(descent.loose).map(|(off, sd)| (off / sd).powi(2)).sum();
        Ok(left + self.unit * (self.moved.norm_squared() + causes))
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

    /// Where the plant is.
    pub(crate) fn place(&self) -> Place {
        Place { trial: self.trial.clone(), cells: self.evidence.cells.clone(), moved: self.moved.clone() }
    }

    /// Has the plant where it was, and asks there beside these effects.
    pub(crate) fn go_back(&mut self, place: Place, effects: &[Effect], runs: &[Run]) -> Result<(), ModelError> {
        self.put(place);
        self.linearize_all(runs)?;
        let all: Vec<usize> = (0..self.hypotheses.len()).collect();
        if effects.is_empty() { Ok(()) } else { self.centre(effects, &all) }
    }

    fn put(&mut self, place: Place) {
        (self.trial, self.evidence.cells, self.moved) = (place.trial, place.cells, place.moved);
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
