//! Gram matrices of the whitened columns, by run and summed, and the cache of those that were computed last.

use crate::problem::{Linearized, Member, Problem};
use fss_estimation::Columns;
use fss_estimation::evidence::Gram;
use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::{Arc, Mutex};

/// The data and some parameters' columns of a block side by side: those that are not 0 throughout.
pub(crate) struct Prepared {
    columns: Columns,
    /// Which each is: 0 is the data, i + 1 the i-th parameter that was asked for.
    pub(crate) places: Vec<usize>,
}

impl Prepared {
    /// From all columns of the block.
    pub(crate) fn new(columns: &[Vec<f64>], parameters: &[usize]) -> Self {
        let all: Vec<usize> = std::iter::once(0).chain(parameters.iter().map(|p| p + 1)).collect();
        let acts = |place: &usize| *place == 0 || columns[*place].iter().any(|v| *v != 0.0);
        let places: Vec<usize> = (0..all.len()).filter(|i| acts(&all[*i])).collect();
        let chosen: Vec<&[f64]> = places.iter().map(|i| columns[all[*i]].as_slice()).collect();
        Self { columns: Columns::of(&chosen), places }
    }
}

/// The same, whitened.
pub(crate) struct Whitened {
    /// A column of the block in each row.
    pub(crate) rows: DMatrix<f64>,
    pub(crate) log_det: f64,
}

impl Problem {
    /// The data and some parameters' columns of a block, whitened, and the logarithm of the noise's determinant.
    pub(crate) fn whitened(&self, member: &Member, prepared: &Prepared, hyper: &[f64]) -> Whitened {
        let mut white = prepared.columns.clone();
        let log_det = member.block.whiten(self.hyper_of(member, hyper), &mut white);
        // Row by row is the transpose column by column.
        Whitened { rows: DMatrix::from_column_slice(white.width(), white.rows(), white.values()), log_det }
    }

    /// The Gram matrix of some parameters at values of the hyper-parameters, the variation from run to run integrated out.
    pub(crate) fn gram(
        &self,
        linearized: &Linearized,
        hyper: &[f64],
        parameters: &[usize],
        cache: &GramCache,
    ) -> Option<Gram> {
        let mut sum: Option<Gram> = None;
        for own in self.grams_of_runs(linearized, hyper, parameters, cache)? {
            match &mut sum {
                None => sum = Some(own),
                Some(sum) => {
                    sum.products += own.products;
                    sum.log_det += own.log_det;
                }
            }
        }
        sum
    }

    /// The same of each run that has any block.
    pub(crate) fn grams_of_runs(
        &self,
        linearized: &Linearized,
        hyper: &[f64],
        parameters: &[usize],
        cache: &GramCache,
    ) -> Option<Vec<Gram>> {
        let of_member = |(k, (member, columns)): (usize, (&Member, &Vec<Vec<f64>>))| {
            let own = self.hyper_of(member, hyper);
            let gram = cache.get(k, own, || {
                let prepared = cache.prepared(k, || Prepared::new(columns, parameters));
                let white = self.whitened(member, &prepared, hyper);
                let mut products = DMatrix::zeros(parameters.len() + 1, parameters.len() + 1);
                let own = &white.rows * white.rows.transpose();
                for (i, to_row) in prepared.places.iter().enumerate() {
                    prepared.places.iter().enumerate().for_each(|(j, to)| products[(*to_row, *to)] = own[(i, j)]);
                }
                Gram { products, log_det: white.log_det }
            });
            (member.run, gram)
        };
        let all: Vec<(usize, Arc<Gram>)> =
            self.members.par_iter().zip(&linearized.columns).enumerate().map(of_member).collect();
        let n = parameters.len() + 1;
        let kappa = *hyper.last()?;
        let sd: Vec<f64> = parameters.iter().map(|p| kappa * linearized.size[*p]).collect();
        let mut out = Vec::new();
        for run in (0..self.runs).filter(|run| all.iter().any(|(of, _)| of == run)) {
            let mut own = Gram { products: DMatrix::zeros(n, n), log_det: 0.0 };
            for (_, gram) in all.iter().filter(|(of, _)| *of == run) {
                own.products += &gram.products;
                own.log_det += gram.log_det;
            }
            out.push(varied(own, &sd)?);
        }
        Some(out)
    }
}

/// What is kept of a linearization and a choice of parameters: each block's columns, and its Gram matrices that were asked for
/// last, by its own hyper-parameters: those of one family do not move the others'.
#[derive(Default)]
pub(crate) struct GramCache {
    columns: Mutex<HashMap<usize, Arc<Prepared>>>,
    grams: Mutex<HashMap<usize, Kept>>,
}

/// Hyper-parameters and the Gram matrix at them.
type Kept = Vec<(Vec<f64>, Arc<Gram>)>;

/// Enough for the best point and the one being tried.
const CACHED: usize = 3;

impl GramCache {
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
fn varied(mut gram: Gram, sd: &[f64]) -> Option<Gram> {
    let active: Vec<usize> = (0..sd.len()).filter(|i| sd[*i] > 0.0).collect();
    if active.is_empty() {
        return Some(gram);
    }
    let k = active.len();
    let of = |a: usize, b: usize| gram.products[(active[a] + 1, active[b] + 1)];
    let scaled = DMatrix::from_fn(k, k, |a, b| sd[active[a]] * of(a, b) * sd[active[b]] + f64::from(u8::from(a == b)));
    let cholesky = Cholesky::new(scaled)?;
    let n = gram.products.ncols();
    let mut rows = DMatrix::from_fn(k, n, |a, j| sd[active[a]] * gram.products[(active[a] + 1, j)]);
    cholesky.l_dirty().solve_lower_triangular_mut(&mut rows);
    gram.products -= rows.tr_mul(&rows);
    gram.log_det += 2.0 * (0..k).map(|i| cholesky.l_dirty()[(i, i)].ln()).sum::<f64>();
    Some(gram)
}
