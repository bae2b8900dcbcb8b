//! The contest of possible causes: screened all at once by what a linear fit would gain, the best refitted with the real
//! simulation, taken one after the other as long as the data insist.

mod noise;
mod refine;
mod rules;
mod screen;
mod select;
mod sides;
mod swing;
mod take;
mod weigh;

pub(crate) use noise::{GYRO, Shaken};
pub(crate) use refine::Refined;
pub(crate) use rules::DOUBTFUL;
pub(crate) use screen::Screened;
pub(crate) use select::Selection;

use crate::evidence::Evidence;
use crate::hypothesis::{Hypothesis, hypotheses};
use crate::normal::Normal;
use crate::sensitivity::{Column, normals};
use crate::tolerance::tolerance;
use crate::trial::Trial;
use fss_diagnosis::uncertain::{Uncertain, stated};
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Plant};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Farther than this from its file no value is moved, standard deviations: beyond it would be a cause of its own.
const FARTHEST: f64 = 4.0;

/// Everything that the contest is about.
pub(crate) struct Contest {
    pub(crate) trial: Trial,
    pub(crate) evidence: Evidence,
    pub(crate) uncertain: Vec<Uncertain>,
    pub(crate) hypotheses: Vec<Hypothesis>,
    order: Order,
    /// Of each cell: what may be absorbed (unit normal a priori), then the hypotheses' coordinates.
    screen: Vec<Normal>,
    columns: Vec<DMatrix<f64>>,
    nuisance_count: usize,
    /// Mean square that whitened rows have where the plant is as right as it can be: 1 where nothing but noise is left,
    /// more where no cause explains all. Priors are weighed against it, or they would count for nothing.
    pub(crate) unit: f64,
    /// A gyro that is shaken by what no cause explains.
    pub(crate) shaken: Option<Shaken>,
    /// Of the nuisances' normal matrix with their priors.
    factor: Option<Cholesky<f64, Dyn>>,
}

/// A sum of squares with what the nuisances absorb taken out.
#[derive(Clone, Debug)]
pub(crate) struct Reduced {
    /// What is left, and of which columns.
    pub(crate) normal: Normal,
    /// The nuisances at the solution without any column.
    pub(crate) nuisance: DVector<f64>,
    /// What the nuisances would take of each column.
    pub(crate) by_column: DMatrix<f64>,
}

impl Contest {
    /// Gathers the evidence of `runs` and how every cause would show in it.
    pub(crate) fn new(plant: &Plant, runs: &[Run]) -> Result<Self, ModelError> {
        let trial = Trial::of(plant);
        let evidence = Evidence::gather(&trial, runs)?;
        let uncertain = stated(plant);
        let hypotheses = hypotheses(plant, runs);
        let order = Order::new(plant, &uncertain, &hypotheses);
        let columns = evidence.cells.iter().map(|c| DMatrix::zeros(c.residual.len(), order.width)).collect();
        let nuisance_count = order.nuisance_count;
        let mut contest = Self {
            trial,
            evidence,
            uncertain,
            hypotheses,
            order,
            screen: Vec::new(),
            columns,
            nuisance_count,
            unit: 1.0,
            shaken: None,
            factor: None,
        };
        let all: Vec<usize> = (0..contest.hypotheses.len()).collect();
        contest.linearize(&[], &all)?;
        contest.loosen(runs)?;
        Ok(contest)
    }

    /// Asks about more causes, none of which goes without saying.
    fn ask_too(&mut self, more: Vec<Hypothesis>) -> Result<(), ModelError> {
        let known = self.hypotheses.len();
        self.hypotheses.extend(more);
        self.order = Order::new(&self.trial.plant, &self.uncertain, &self.hypotheses);
        for columns in &mut self.columns {
            columns.resize_horizontally_mut(self.order.width, 0.0);
        }
        let fresh: Vec<usize> = (known..self.hypotheses.len()).collect();
        self.linearize(&[], &fresh)
    }

    /// Fits the windows' own unknowns anew under the plant with these effects, and asks there how uncertain values and some
    /// of the hypotheses would show.
    pub(crate) fn centre(&mut self, effects: &[Effect], hypotheses: &[usize]) -> Result<(), ModelError> {
        self.evidence.settle(&self.trial_with(effects))?;
        self.linearize(effects, hypotheses)
    }

    /// Columns of uncertain values and some hypotheses, around the plant with these effects.
    fn linearize(&mut self, effects: &[Effect], hypotheses: &[usize]) -> Result<(), ModelError> {
        let asked: Vec<&Hypothesis> = hypotheses.iter().map(|h| &self.hypotheses[*h]).collect();
        let fresh = self.evidence.sensitivities(&self.trial_with(effects), &self.uncertain, &asked)?;
        let own =
            hypotheses.iter().flat_map(|h| (0..self.hypotheses[*h].size()).map(|i| self.order.coordinate[*h] + i));
        for (coordinate, column) in (0..self.uncertain.len()).chain(own).zip(fresh) {
            for (place, factor) in &self.order.places[coordinate] {
                for (matrix, rows) in self.columns.iter_mut().zip(&column) {
                    matrix.set_column(*place, &(rows * *factor));
                }
            }
        }
        self.sum_up();
        Ok(())
    }

    /// Normal equations of the columns.
    fn sum_up(&mut self) {
        self.screen = normals(&self.evidence.cells, &self.columns);
        self.set_unit(self.unit);
    }

    /// From now on whitened rows have mean square `unit` at best.
    pub(crate) fn set_unit(&mut self, unit: f64) {
        let n = self.nuisance_count;
        let mut own = unit * DMatrix::identity(n, n);
        for cell in &self.screen {
            own += cell.g.view((0, 0), (n, n));
        }
        self.unit = unit;
        self.factor = own.cholesky();
    }

    /// Number of columns in the screen.
    fn width(&self) -> usize {
        self.order.width
    }

    /// Columns of a hypothesis in the screen.
    pub(crate) fn columns_of(&self, hypothesis: usize) -> Vec<usize> {
        let first = self.order.first[hypothesis];
        (first..first + self.hypotheses[hypothesis].size()).collect()
    }

    /// Residuals of all cells and extra columns, what the nuisances absorb taken out.
    pub(crate) fn reduce(&self, residuals: &[DVector<f64>], extra: &[Column]) -> Reduced {
        let (n, p) = (self.nuisance_count, extra.len());
        let mut normal = Normal::zero(p);
        let mut right = DVector::zeros(n);
        let mut cross = DMatrix::zeros(n, p);
        for (i, residual) in residuals.iter().enumerate() {
            let own = self.columns[i].columns(0, n);
            right += own.tr_mul(residual);
            normal.c += residual.norm_squared();
            normal.freedom += self.evidence.cells[i].freedom;
            for (a, column) in extra.iter().enumerate() {
                let absorbed = own.tr_mul(&column[i]);
                let mut target = cross.column_mut(a);
                target += absorbed;
                normal.b[a] += column[i].dot(residual);
                for (b, other) in extra.iter().enumerate().take(a + 1) {
                    let dot = column[i].dot(&other[i]);
                    normal.g[(a, b)] += dot;
                    if a != b {
                        normal.g[(b, a)] += dot;
                    }
                }
            }
        }
        let (nuisance, by_column) = match &self.factor {
            Some(factor) => (factor.solve(&right), factor.solve(&cross)),
            None => (DVector::zeros(n), DMatrix::zeros(n, p)),
        };
        normal.c -= right.dot(&nuisance);
        normal.b -= cross.tr_mul(&nuisance);
        normal.g -= cross.tr_mul(&by_column);
        Reduced { normal, nuisance, by_column }
    }

    /// Columns with what the nuisances absorb of them taken off.
    fn clear_of(&self, columns: &[Column], by_column: &DMatrix<f64>) -> Vec<Column> {
        let n = self.nuisance_count;
        let clear = |(a, column): (usize, &Column)| {
            column.iter().zip(&self.columns).map(|(c, j)| c - j.columns(0, n) * by_column.column(a)).collect()
        };
        columns.iter().enumerate().map(clear).collect()
    }

    /// Residuals with what the nuisances explain taken off.
    pub(crate) fn unexplained(&self, residuals: &[DVector<f64>], nuisance: &DVector<f64>) -> Vec<DVector<f64>> {
        let n = self.nuisance_count;
        residuals.iter().zip(&self.columns).map(|(r, j)| r - j.columns(0, n) * nuisance).collect()
    }

    /// The plant with its uncertain values where the nuisances put them.
    pub(crate) fn settled(&self, nuisance: &DVector<f64>) -> Plant {
        let mut plant = self.trial.plant.clone();
        for (u, by) in self.uncertain.iter().zip(nuisance.iter()) {
            plant = u.moved(&plant, by.clamp(-FARTHEST, FARTHEST));
        }
        plant.effects.clone_from(&self.trial.effects);
        plant
    }
}

/// Where the columns of uncertain values and hypotheses stand in the screen, and times what.
struct Order {
    /// Of each uncertain value's or hypothesis' coordinate: its places.
    places: Vec<Vec<(usize, f64)>>,
    /// The first coordinate of each hypothesis among all.
    coordinate: Vec<usize>,
    /// The first column of each hypothesis in the screen.
    first: Vec<usize>,
    /// How many columns, the first ones, may absorb.
    nuisance_count: usize,
    width: usize,
}

impl Order {
    /// Uncertain values, tolerances, hypotheses.
    fn new(plant: &Plant, uncertain: &[Uncertain], hypotheses: &[Hypothesis]) -> Self {
        let mut places: Vec<Vec<(usize, f64)>> = (0..uncertain.len()).map(|i| vec![(i, 1.0)]).collect();
        let mut coordinate = Vec::with_capacity(hypotheses.len());
        let mut width = uncertain.len();
        for hypothesis in hypotheses {
            coordinate.push(places.len());
            let sds = tolerance(hypothesis, plant).unwrap_or_default();
            for i in 0..hypothesis.size() {
                let sd = sds.get(i).copied();
                places.push(sd.map(|sd| (width, sd)).into_iter().collect());
                width += usize::from(sd.is_some());
            }
        }
        let nuisance_count = width;
        let mut first = Vec::with_capacity(hypotheses.len());
        for (hypothesis, coordinate) in hypotheses.iter().zip(&coordinate) {
            first.push(width);
            for i in 0..hypothesis.size() {
                places[coordinate + i].push((width, 1.0));
                width += 1;
            }
        }
        Self { places, coordinate, first, nuisance_count, width }
    }
}
