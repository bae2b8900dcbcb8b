//! A first look at all candidates, one at a time beside the present model: which are worth searching with.

use crate::gram::Prepared;
use crate::problem::{Linearized, Problem};
use fss_estimation::evidence::{Gram, Slab, SpikePosterior};
use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::Arc;

/// Sums over all blocks: products of the data and the base columns with all columns, and those of each candidate's own.
#[derive(Clone, Default)]
pub(crate) struct Products {
    pub(crate) with_base: DMatrix<f64>,
    pub(crate) own: Vec<DMatrix<f64>>,
    log_det: f64,
}

/// Those of blocks, by block and its hyper-parameters.
pub(crate) type KnownProducts = HashMap<(usize, Vec<u64>), Arc<Products>>;

impl Problem {
    /// Logarithm of the marginal likelihood with each candidate, the parameters of `base` present with normal priors of the
    /// standard deviations `base_sd`. `slabs` gives the priors of a candidate's own parameters, counted from 0, one set a
    /// class. The variation from run to run is left out.
    pub(crate) fn screened(
        &self,
        prepared: &[Prepared],
        (hyper, known): (&[f64], &mut KnownProducts),
        base: &[usize],
        base_sd: &[f64],
        slabs: &(dyn Fn(usize) -> Vec<Vec<Slab>> + Sync),
    ) -> Option<Vec<f64>> {
        let sum = self.products(prepared, hyper, base, known)?;
        let n = base.len();
        let prior = |i: usize, j: usize| if i == j { base_sd[i].powi(-2) } else { 0.0 };
        let among = DMatrix::from_fn(n, n, |i, j| sum.with_base[(i + 1, base[j] + 1)] + prior(i, j));
        let cholesky = Cholesky::new(among)?;
        let of_data = sum.with_base.view((1, 0), (n, 1)).into_owned();
        let pulled_data = cholesky.solve(&of_data);
        let log_det: f64 = (0..n).map(|i| 2.0 * (cholesky.l_dirty()[(i, i)] * base_sd[i]).ln()).sum();
        let evidence = |candidate: usize| {
            let range = self.parameters_of(candidate);
            let cross = sum.with_base.view((1, range.start + 1), (n, range.len())).into_owned();
            let b = sum.with_base.view((0, range.start + 1), (1, range.len())).transpose() - cross.tr_mul(&pulled_data);
            let a = &sum.own[candidate] - cross.tr_mul(&cholesky.solve(&cross));
            let c = sum.with_base[(0, 0)] - of_data.dot(&pulled_data);
            let size = range.len() + 1;
            let products = DMatrix::from_fn(size, size, |i, j| match (i, j) {
                (0, 0) => c,
                (0, k) | (k, 0) => b[k - 1],
                (i, j) => a[(i - 1, j - 1)],
            });
            let gram = Gram { products, log_det: sum.log_det + log_det };
            let alone = SpikePosterior::new(&gram, &self.spikes[range]);
            let sets = slabs(candidate).into_iter();
            let found = sets.filter_map(|set| alone.as_ref()?.of_set(&set)).map(|p| p.log_evidence);
            found.fold(f64::NEG_INFINITY, f64::max)
        };
        Some((0..self.candidates.len()).into_par_iter().map(evidence).collect())
    }

    /// All parameters' columns of every block.
    pub(crate) fn prepared(&self, linearized: &Linearized) -> Vec<Prepared> {
        let all: Vec<usize> = (0..self.parameters()).collect();
        linearized.columns.par_iter().map(|columns| Prepared::new(columns, &all)).collect()
    }

    pub(crate) fn products(
        &self,
        prepared: &[Prepared],
        hyper: &[f64],
        base: &[usize],
        known: &mut KnownProducts,
    ) -> Option<Products> {
        let count = self.parameters() + 1;
        let of_member = |(member, prepared): (&crate::problem::Member, &Prepared)| {
            let white = self.whitened(member, prepared, hyper);
            let mut row_of = vec![None; count];
            prepared.places.iter().enumerate().for_each(|(row, place)| row_of[*place] = Some(row));
            let bases: Vec<Option<usize>> =
                std::iter::once(0).chain(base.iter().map(|p| p + 1)).map(|p| row_of[p]).collect();
            let known: Vec<usize> = bases.iter().flatten().copied().collect();
            let columns = white.rows.transpose();
            let products = white.rows.select_rows(&known) * &columns;
            let mut with_base = DMatrix::zeros(bases.len(), count);
            let rows_of_base = (0..bases.len()).filter(|i| bases[*i].is_some());
            for (from, to) in rows_of_base.enumerate() {
                prepared
                    .places
                    .iter()
                    .enumerate()
                    .for_each(|(row, place)| with_base[(to, *place)] = products[(from, row)]);
            }
            let own = (0..self.candidates.len()).map(|c| {
                let range = self.parameters_of(c);
                let row = |i: usize| row_of[range.start + 1 + i].map(|row| columns.column(row));
                DMatrix::from_fn(range.len(), range.len(), |i, j| match (row(i), row(j)) {
                    (Some(a), Some(b)) => a.dot(&b),
                    _ => 0.0,
                })
            });
            Products { with_base, own: own.collect(), log_det: white.log_det }
        };
        // Hyper-parameters of one family do not move the others' blocks.
        let news: Vec<Option<Arc<Products>>> = (self.members.par_iter().zip(prepared).enumerate())
            .map(|(k, (member, prepared))| {
                let key = (k, self.hyper_of(member, hyper).iter().map(|h| h.to_bits()).collect());
                if known.contains_key(&key) { None } else { Some(Arc::new(of_member((member, prepared)))) }
            })
            .collect();
        let mut sum: Option<Products> = None;
        for (k, new) in news.into_iter().enumerate() {
            let key = (k, self.hyper_of(&self.members[k], hyper).iter().map(|h| h.to_bits()).collect());
            let own = known.entry(key).or_insert_with(|| new.unwrap_or_default());
            match &mut sum {
                None => sum = Some(Products::clone(own)),
                Some(sum) => {
                    sum.with_base += &own.with_base;
                    sum.own.iter_mut().zip(&own.own).for_each(|(a, b)| *a += b);
                    sum.log_det += own.log_det;
                }
            }
        }
        sum
    }
}
