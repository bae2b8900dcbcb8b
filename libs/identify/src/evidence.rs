//! What the data say about any number of small changes of the plant at once.
//!
//! Each window is a cell. Its own unknowns (initial state, the room's force with its prior) are projected out, so that
//! what remains of the whitened residual `r` and of each sensitivity `J_k` lies beside everything that they could absorb:
//! with `M` the projector, `J_i' M J_j` and `J_k' M r` hold all that a linear fit of any subset of changes needs. The
//! sums over windows or runs are then as cheap as they are small.

use crate::floating::Record;
use crate::trial::{Span, Trial};
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Rounds of Gauss-Newton for a window's own unknowns.
const ROUNDS: usize = 16;
/// Where another trial asks a window's own unknowns to move by more than this (square, in standard deviations), they do: what
/// is linear near by is not so far away.
const FAR: f64 = 25.0;
/// And at most so often.
const ROUNDS_FAR: usize = 3;

/// Share of a step that is taken back where it was too long.
const BACK: f64 = 0.7;
/// A step that leaves less than this share of the sum of squares was long enough to linearize anew.
const MUCH_BETTER: f64 = 0.5;

/// Residual rows of a window for each of several values of its own unknowns.
type Residuals<'a> = dyn Fn(&[Vec<f64>]) -> Vec<Vec<f64>> + 'a;

/// The runs of an experiment, ready to be simulated.
pub(crate) struct Evidence {
    pub(crate) records: Vec<Record>,
    /// One a window, over all runs.
    pub(crate) cells: Vec<Cell>,
}

/// One window, its own unknowns fitted under a trial.
#[derive(Clone)]
pub(crate) struct Cell {
    pub(crate) record: usize,
    pub(crate) window: usize,
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
    pub(crate) unknowns: Vec<f64>,
    /// Orthonormal columns: what the window's own unknowns can do to the whitened rows.
    absorbed: DMatrix<f64>,
    /// What these columns mean for the unknowns.
    to_unknowns: DMatrix<f64>,
    /// How much each row counts, once what the unknowns can do is taken off.
    weights: DVector<f64>,
    /// What is left of the whitened residual.
    pub(crate) residual: DVector<f64>,
    /// Degrees of freedom.
    pub(crate) freedom: f64,
}

impl Evidence {
    /// Cuts the runs into windows and fits each window's own unknowns under `trial`.
    pub(crate) fn gather(trial: &Trial, runs: &[Run]) -> Result<Self, ModelError> {
        let records = runs.iter().filter_map(|run| Record::new(trial, run).transpose());
        let records = records.collect::<Result<Vec<_>, _>>()?;
        let cells = cells(&records, trial, &[])?;
        Ok(Self { records, cells })
    }

    /// Fits each window's own unknowns anew under `trial`, from where they are.
    pub(crate) fn settle(&mut self, trial: &Trial) -> Result<(), ModelError> {
        self.cells = cells(&self.records, trial, &self.cells)?;
        Ok(())
    }

    /// The same cells under another trial, with the unknowns of before, or near them.
    pub(crate) fn under(&self, trial: &Trial, before: &[Cell]) -> Result<Vec<Cell>, ModelError> {
        let of_record = |r: usize| -> Result<Vec<Cell>, ModelError> {
            let flight = self.records[r].flight(trial)?;
            let spans = self.records[r].spans();
            let of = |cell: &Cell| {
                let rows =
                    |unknowns: &Vec<f64>| flight.residuals(cell.window, std::slice::from_ref(unknowns)).remove(0);
                cell.moved(&spans[cell.window], &rows)
            };
            Ok(before.par_iter().filter(|c| c.record == r).map(of).collect())
        };
        let parts: Result<Vec<_>, _> = (0..self.records.len()).into_par_iter().map(of_record).collect();
        Ok(parts?.into_iter().flatten().collect())
    }

    /// Projected residuals of all cells under a trial, the windows' own unknowns as in `cells`.
    pub(crate) fn residuals(&self, trial: &Trial, cells: &[Cell]) -> Result<Vec<DVector<f64>>, ModelError> {
        let of_record = |r: usize| -> Result<Vec<DVector<f64>>, ModelError> {
            if !cells.iter().any(|c| c.record == r) {
                return Ok(Vec::new());
            }
            let flight = self.records[r].flight(trial)?;
            let spans = self.records[r].spans();
            let of = |cell: &Cell| {
                let rows = flight.residuals(cell.window, std::slice::from_ref(&cell.unknowns)).remove(0);
                cell.project(&spans[cell.window], &rows)
            };
            Ok(cells.par_iter().filter(|c| c.record == r).map(of).collect())
        };
        let parts: Result<Vec<_>, _> = (0..self.records.len()).into_par_iter().map(of_record).collect();
        Ok(parts?.into_iter().flatten().collect())
    }
}

fn cells(records: &[Record], trial: &Trial, before: &[Cell]) -> Result<Vec<Cell>, ModelError> {
    let of_record = |r: usize| -> Result<Vec<Cell>, ModelError> {
        let flight = records[r].flight(trial)?;
        let spans = records[r].spans().par_iter().enumerate();
        Ok(spans
            .filter_map(|(w, span)| {
                let old = before.iter().find(|c| c.record == r && c.window == w);
                if !before.is_empty() && old.is_none() {
                    return None;
                }
                let of = |x: &[Vec<f64>]| flight.residuals(w, x);
                let start = old.map_or(&span.guess, |c| &c.unknowns);
                let mut fresh = Cell::fit((r, w), span, start, &of);
                if let (Some(cell), Some(old)) = (&mut fresh, old) {
                    cell.weigh(old.weights.clone());
                }
                // A cell that was there stays there, or sums over cells could not be compared.
                fresh.or_else(|| old.cloned())
            })
            .collect())
    };
    let parts: Result<Vec<_>, _> = (0..records.len()).into_par_iter().map(of_record).collect();
    Ok(parts?.into_iter().flatten().collect())
}

impl Cell {
    /// Fits a window's own unknowns by Gauss-Newton with differences; `None` where they are not determined.
    ///
    /// A floating base answers its initial state nearly linearly: a Jacobian serves until a step has changed much.
    fn fit((record, window): (usize, usize), span: &Span, guess: &[f64], residuals: &Residuals) -> Option<Self> {
        let n = guess.len();
        let mut unknowns = guess.to_vec();
        let mut cell: Option<Self> = None;
        let mut last = f64::INFINITY;
        let mut change = DVector::zeros(n);
        let mut jacobian = None;
        for _ in 0..ROUNDS {
            let here = whitened(span, &unknowns, &residuals(std::slice::from_ref(&unknowns))[0]);
            let now = here.norm_squared();
            if !now.is_finite() && cell.is_none() {
                return None;
            }
            if now.is_nan() || now > last {
                // Too far: most of the way back. Where dry friction holds a base, say, what is linear ends nearby.
                change *= BACK;
                unknowns.iter_mut().zip(change.iter()).for_each(|(u, c)| *u -= c);
                change *= 1.0 / BACK - 1.0;
                continue;
            }
            let is_near = now > MUCH_BETTER * last;
            let near = jacobian.take().filter(|_| is_near).map(|jacobian| (jacobian, here));
            let (known, residual) = near.unwrap_or_else(|| linearized(span, &unknowns, residuals));
            let jacobian = jacobian.insert(known);
            last = now;
            let (absorbed, to_unknowns) = basis(jacobian)?;
            let step = &to_unknowns * absorbed.tr_mul(&residual);
            let left = &residual - &absorbed * (absorbed.transpose() * &residual);
            let converged = now - left.norm_squared() < 1e-3 * now + 1e-3;
            cell = Some(Self::fitted((record, window), span, &unknowns, (absorbed, to_unknowns), left));
            if converged {
                break;
            }
            change = step;
            unknowns.iter_mut().zip(change.iter()).for_each(|(u, c)| *u += c);
        }
        cell
    }

    fn fitted(
        (record, window): (usize, usize),
        span: &Span,
        unknowns: &[f64],
        (absorbed, to_unknowns): (DMatrix<f64>, DMatrix<f64>),
        residual: DVector<f64>,
    ) -> Self {
        let weights = DVector::from_element(residual.len(), 1.0);
        let freedom = (residual.len() as f64 - unknowns.len() as f64).max(1.0);
        let (from_s, to_s, unknowns) = (span.from_s, span.to_s, unknowns.to_vec());
        Self { record, window, from_s, to_s, unknowns, absorbed, to_unknowns, weights, residual, freedom }
    }

    /// Expected square of a row's residual where nothing but noise is left.
    pub(crate) fn freedom_of(&self, row: usize) -> f64 {
        1.0 - self.absorbed.row(row).norm_squared()
    }

    /// From now on rows count for so much.
    pub(crate) fn weigh(&mut self, weights: DVector<f64>) {
        self.residual.component_mul_assign(&weights);
        self.weights = weights;
    }

    /// The cell where `rows` gives another trial's rows for its own unknowns: these move along, as the Jacobian says that was
    /// found when they were fitted.
    fn moved(&self, span: &Span, rows: &dyn Fn(&Vec<f64>) -> Vec<f64>) -> Self {
        let mut cell = self.clone();
        let mut all = whitened(span, &cell.unknowns, &rows(&cell.unknowns));
        let mut asked = cell.absorbed.tr_mul(&all);
        for _ in 0..ROUNDS_FAR {
            if asked.norm_squared() < FAR {
                break;
            }
            let step = &cell.to_unknowns * &asked;
            let unknowns: Vec<f64> = cell.unknowns.iter().zip(step.iter()).map(|(u, by)| u + by).collect();
            let there = whitened(span, &unknowns, &rows(&unknowns));
            let still = cell.absorbed.tr_mul(&there);
            // Where the Jacobian of before leads nowhere, the linear answer from there has to do.
            if !still.norm_squared().is_finite() || still.norm_squared() > 0.5 * asked.norm_squared() {
                break;
            }
            (cell.unknowns, all, asked) = (unknowns, there, still);
        }
        cell.residual = (all - &cell.absorbed * asked).component_mul(&cell.weights);
        cell
    }

    /// Whitens rows and takes off what the window's own unknowns absorb.
    pub(crate) fn project(&self, span: &Span, rows: &[f64]) -> DVector<f64> {
        let all = whitened(span, &self.unknowns, rows);
        let absorbed = self.absorbed.tr_mul(&all);
        (all - &self.absorbed * absorbed).component_mul(&self.weights)
    }
}

/// Whitened rows, and those of the priors below them: each such unknown, standard normal.
fn whitened(span: &Span, unknowns: &[f64], rows: &[f64]) -> DVector<f64> {
    let mut white = span.whiten(rows);
    white.extend(unknowns[unknowns.len() - span.prior_count..].iter().map(|u| -u));
    DVector::from_vec(white)
}

/// Whitened rows with those of the priors, and their negative derivatives by the window's own unknowns.
fn linearized(span: &Span, unknowns: &[f64], residuals: &Residuals) -> (DMatrix<f64>, DVector<f64>) {
    let n = unknowns.len();
    let mut points = vec![unknowns.to_vec()];
    for i in 0..n {
        let mut moved = unknowns.to_vec();
        moved[i] += span.steps[i];
        points.push(moved);
    }
    let rows: Vec<DVector<f64>> =
        points.iter().zip(residuals(&points)).map(|(point, rows)| whitened(span, point, &rows)).collect();
    let mut jacobian = DMatrix::zeros(rows[0].len(), n);
    for i in 0..n {
        jacobian.set_column(i, &((&rows[0] - &rows[i + 1]) / span.steps[i]));
    }
    let residual = rows.into_iter().next().unwrap_or_default();
    (jacobian, residual)
}

/// An orthonormal basis of the columns, and what it means for the unknowns; `None` without full rank.
fn basis(jacobian: &DMatrix<f64>) -> Option<(DMatrix<f64>, DMatrix<f64>)> {
    let n = jacobian.ncols();
    if n == 0 {
        return Some((DMatrix::zeros(jacobian.nrows(), 0), DMatrix::zeros(0, 0)));
    }
    let scale: Vec<f64> = jacobian.column_iter().map(|c| c.norm()).collect();
    if scale.iter().any(|s| !s.is_finite() || *s <= 0.0) {
        return None;
    }
    let mut scaled = jacobian.clone();
    for (mut column, s) in scaled.column_iter_mut().zip(&scale) {
        column /= *s;
    }
    let qr = scaled.qr();
    let (q, r) = (qr.q(), qr.r());
    let mut to_unknowns = DMatrix::identity(n, n);
    if !r.solve_upper_triangular_mut(&mut to_unknowns) {
        return None;
    }
    for (mut row, s) in to_unknowns.row_iter_mut().zip(&scale) {
        row /= *s;
    }
    Some((q, to_unknowns))
}
