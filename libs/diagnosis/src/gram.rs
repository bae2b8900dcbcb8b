//! Gram matrices of the whitened columns, by run and summed, and the cache of those that were computed last.

use crate::problem::{Column, Linearized, Member, Problem};
use fss_estimation::Columns;
use fss_estimation::evidence::Gram;
use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::{Arc, Mutex};

/// The data and some parameters' columns of a block: those that are not 0 throughout, and which each is: 0 is the data, i + 1 the i-th
/// parameter that was asked for.
pub(crate) fn acting<'c>(columns: &'c [Column], parameters: &[usize]) -> (Vec<&'c [f32]>, Vec<usize>) {
    let all = std::iter::once(0).chain(parameters.iter().map(|p| p + 1));
    let placed = all.enumerate().map(|(place, column)| (columns[column].as_slice(), place));
    placed.filter(|(own, place)| *place == 0 || own.iter().any(|v| *v != 0.0)).unzip()
}

/// The same side by side.
struct Prepared {
    columns: Columns,
    places: Vec<usize>,
}

impl Prepared {
    /// From all columns of the block.
    fn new(columns: &[Column], parameters: &[usize]) -> Self {
        let (acting, places) = acting(columns, parameters);
        Self { columns: Columns::of(&acting), places }
    }
}

impl Problem {
    /// The Gram matrix of some parameters at values of the hyper-parameters, the variation of causes of these sizes from run to run
    /// integrated out.
    pub(crate) fn gram(
        &self,
        (linearized, size): (&Linearized, &[f64]),
        hyper: &[f64],
        parameters: &[usize],
        cache: &GramCache,
    ) -> Option<Gram> {
        let runs = self.constant_grams(linearized, hyper, parameters, cache);
        varied_about_mean(&runs, &variation(size, hyper, parameters)?)
    }

    /// The same of each run that has any block, alone.
    pub(crate) fn grams_of_runs(
        &self,
        linearized: &Linearized,
        hyper: &[f64],
        parameters: &[usize],
        cache: &GramCache,
    ) -> Option<Vec<Gram>> {
        let sd = variation(&linearized.size, hyper, parameters)?;
        self.constant_grams(linearized, hyper, parameters, cache).into_iter().map(|own| varied(own, &sd)).collect()
    }

    /// The same without variation from run to run.
    fn constant_grams(
        &self,
        linearized: &Linearized,
        hyper: &[f64],
        parameters: &[usize],
        cache: &GramCache,
    ) -> Vec<Gram> {
        let of_member = |(k, (member, columns)): (usize, (&Member, &Vec<Column>))| {
            let own = self.hyper_of(member, hyper);
            let gram = cache.get(k, own, || {
                let prepared = cache.prepared(k, || Prepared::new(columns, parameters));
                let mut white = cache.scratch();
                white.copy_from(&prepared.columns);
                let log_det = member.block.whiten(self.hyper_of(member, hyper), &mut white);
                let mut products = DMatrix::zeros(parameters.len() + 1, parameters.len() + 1);
                let (own, width) = (white.products(), white.width());
                for (i, to_row) in prepared.places.iter().enumerate() {
                    let to = prepared.places.iter().enumerate();
                    to.for_each(|(j, to)| products[(*to_row, *to)] = own[i * width + j]);
                }
                cache.give_back(white);
                Gram { products, log_det }
            });
            (member.run, gram)
        };
        let all: Vec<(usize, Arc<Gram>)> =
            self.members.par_iter().zip(&linearized.columns).enumerate().map(of_member).collect();
        let n = parameters.len() + 1;
        let mut out = Vec::new();
        for run in (0..self.runs).filter(|run| all.iter().any(|(of, _)| of == run)) {
            let mut own = Gram { products: DMatrix::zeros(n, n), log_det: 0.0 };
            for (_, gram) in all.iter().filter(|(of, _)| *of == run) {
                own.products += &gram.products;
                own.log_det += gram.log_det;
            }
            out.push(own);
        }
        out
    }
}

/// Standard deviation by which each parameter varies from run to run.
fn variation(size: &[f64], hyper: &[f64], parameters: &[usize]) -> Option<Vec<f64>> {
    let share = *hyper.last()?;
    Some(parameters.iter().map(|p| share * size[*p]).collect())
}

/// The Gram matrix of all runs where some parameters, from 0, have a value of their own in each. Of the first run they stay where they
/// are; those of the others follow behind all, run by run.
pub(crate) fn of_own_sizes(runs: &[Gram], own: &[usize]) -> Option<Gram> {
    let n = runs.first()?.products.ncols();
    let place = |run: usize, column: usize| match own.iter().position(|p| p + 1 == column) {
        Some(i) if run > 0 => n + (run - 1) * own.len() + i,
        _ => column,
    };
    let all = n + (runs.len() - 1) * own.len();
    let mut sum = Gram { products: DMatrix::zeros(all, all), log_det: 0.0 };
    for (run, gram) in runs.iter().enumerate() {
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            sum.products[(place(run, i), place(run, j))] += gram.products[(i, j)];
        }
        sum.log_det += gram.log_det;
    }
    Some(sum)
}

/// What is kept of a linearization and a choice of parameters: each block's columns, and its Gram matrices that were asked for
/// last, by its own hyper-parameters: those of one family do not move the others'.
#[derive(Default)]
pub(crate) struct GramCache {
    columns: Mutex<HashMap<usize, Arc<Prepared>>>,
    grams: Mutex<HashMap<usize, Kept>>,
    /// Memory to whiten in.
    scratch: Mutex<Vec<Columns>>,
}

/// Hyper-parameters and the Gram matrix at them.
type Kept = Vec<(Vec<f64>, Arc<Gram>)>;

/// Enough for the best point and the one being tried.
const CACHED: usize = 3;

impl GramCache {
    fn scratch(&self) -> Columns {
        self.scratch.lock().unwrap_or_else(std::sync::PoisonError::into_inner).pop().unwrap_or_default()
    }

    fn give_back(&self, scratch: Columns) {
        self.scratch.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(scratch);
    }

    fn prepared(&self, block: usize, make: impl FnOnce() -> Prepared) -> Arc<Prepared> {
        let lock = || self.columns.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some(known) = lock().get(&block) {
            return known.clone();
        }
        let own = Arc::new(make());
        lock().insert(block, own.clone());
        own
    }

    fn get(&self, block: usize, hyper: &[f64], make: impl FnOnce() -> Gram) -> Arc<Gram> {
        let lock = || self.grams.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((_, gram)) = lock().entry(block).or_default().iter().find(|(own, _)| own == hyper) {
            return gram.clone();
        }
        let gram = Arc::new(make());
        let mut all = lock();
        let own = all.entry(block).or_default();
        if own.len() == CACHED {
            own.remove(0);
        }
        own.push((hyper.to_vec(), gram.clone()));
        gram
    }
}

/// A run's Gram matrix after its own perturbation of every parameter, of these standard deviations, is integrated out.
fn varied(gram: Gram, sd: &[f64]) -> Option<Gram> {
    let active: Vec<usize> = (0..sd.len()).filter(|i| sd[*i] > 0.0).collect();
    let (k, n) = (active.len(), gram.products.ncols());
    let of = |a: usize, b: usize| sd[active[a]] * gram.products[(active[a] + 1, active[b] + 1)] * sd[active[b]];
    let own = DMatrix::from_fn(k, k, of);
    let across = DMatrix::from_fn(k, n, |a, j| sd[active[a]] * gram.products[(active[a] + 1, j)]);
    integrated_out(gram, own, across)
}

/// The sum of runs' Gram matrices after perturbations of every parameter in each run, of these standard deviations, are integrated
/// out. A parameter is its mean over the runs: perturbations add up to 0, or together they could stand for the mean.
fn varied_about_mean(runs: &[Gram], sd: &[f64]) -> Option<Gram> {
    let mut sum = runs.first()?.clone();
    for own in &runs[1..] {
        sum.products += &own.products;
        sum.log_det += own.log_det;
    }
    let active: Vec<usize> = (0..sd.len()).filter(|i| sd[*i] > 0.0).collect();
    // Orthonormal contrasts between runs (Helmert): the c-th is between run c + 1 and all before it.
    let contrast = |c: usize, run: usize| {
        let before = (c + 1) as f64;
        let size = (before * (before + 1.0)).sqrt();
        if run <= c {
            1.0 / size
        } else if run == c + 1 {
            -before / size
        } else {
            0.0
        }
    };
    let places: Vec<(usize, usize)> =
        (0..runs.len() - 1).flat_map(|c| active.iter().map(move |parameter| (c, *parameter))).collect();
    let over_runs = |value: &dyn Fn(usize) -> f64| (0..runs.len()).map(value).sum::<f64>();
    let own = DMatrix::from_fn(places.len(), places.len(), |i, j| {
        let ((c, a), (d, b)) = (places[i], places[j]);
        sd[a] * sd[b] * over_runs(&|r| contrast(c, r) * contrast(d, r) * runs[r].products[(a + 1, b + 1)])
    });
    let across = DMatrix::from_fn(places.len(), sum.products.ncols(), |i, j| {
        let (c, a) = places[i];
        sd[a] * over_runs(&|r| contrast(c, r) * runs[r].products[(a + 1, j)])
    });
    integrated_out(sum, own, across)
}

/// A Gram matrix after more columns with standard normal coefficients are integrated out: their Gram matrix, and their products with
/// all others.
fn integrated_out(mut gram: Gram, mut own: DMatrix<f64>, mut across: DMatrix<f64>) -> Option<Gram> {
    let count = own.nrows();
    if count == 0 {
        return Some(gram);
    }
    (0..count).for_each(|i| own[(i, i)] += 1.0);
    let cholesky = Cholesky::new(own)?;
    cholesky.l_dirty().solve_lower_triangular_mut(&mut across);
    gram.products -= across.tr_mul(&across);
    gram.log_det += 2.0 * (0..count).map(|i| cholesky.l_dirty()[(i, i)].ln()).sum::<f64>();
    Some(gram)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use fss_estimation::evidence::SpikePosterior;

    /// Runs of one number each, of unit noise, that a parameter adds to: data in the first row.
    fn runs(data: &[f64]) -> Vec<Gram> {
        let of = |y: &f64| Gram { products: DMatrix::from_row_slice(2, 2, &[y * y, *y, *y, 1.0]), log_det: 0.0 };
        data.iter().map(of).collect()
    }

    #[test]
    fn what_varies_from_run_to_run_leaves_the_mean_alone() {
        // The mean of the runs has the same likelihood as without variation; deviations from it are worth less.
        let data = [3.0, 5.0, 4.0];
        let (constant, varying) =
            (varied_about_mean(&runs(&data), &[0.0]).unwrap(), varied_about_mean(&runs(&data), &[2.0]).unwrap());
        for at in [(0, 1), (1, 0), (1, 1)] {
            assert!((constant.products[at] - varying.products[at]).abs() < 1e-12);
        }
        // Closed form: contrasts have the variance 1 + 4.
        let (mean_square, scatter) = (3.0 * 16.0, 2.0);
        assert!((varying.products[(0, 0)] - (mean_square + scatter / 5.0)).abs() < 1e-12);
        assert!((varying.log_det - 2.0 * 5.0_f64.ln()).abs() < 1e-12);
    }

    #[test]
    fn runs_with_sizes_of_their_own_are_as_likely_as_each_alone() {
        let data = [3.0, -1.0, 0.5];
        let evidence = |gram: &Gram| {
            let parameters = gram.products.ncols() - 1;
            SpikePosterior::new(gram, &vec![2.0; parameters]).unwrap().log_evidence
        };
        let alone: f64 = runs(&data).iter().map(evidence).sum();
        let together = of_own_sizes(&runs(&data), &[0]).unwrap();
        assert!((evidence(&together) - alone).abs() < 1e-12);
        let one = of_own_sizes(&runs(&data), &[]).unwrap();
        assert!((one.products[(0, 1)] - 2.5).abs() < 1e-12 && one.products.ncols() == 2);
    }
}
