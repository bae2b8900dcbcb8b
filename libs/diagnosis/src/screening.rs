//! A first look at all candidates, one at a time beside the present model: which are worth searching with.

use crate::gram::acting;
use crate::problem::{Column, Linearized, Member, Problem};
use fss_estimation::Columns;
use fss_estimation::evidence::{Gram, Slab, SpikePosterior};
use nalgebra::{Cholesky, DMatrix};
use rayon::prelude::*;
use std::sync::Arc;

/// Rows that are multiplied at once, so that their columns stay near.
const TOGETHER: usize = 128;

/// Sums over all blocks: products of the data and the base columns with all columns, and those of each candidate's own.
#[derive(Clone, Default)]
pub(crate) struct Products {
    pub(crate) with_base: DMatrix<f64>,
    pub(crate) own: Vec<DMatrix<f64>>,
    log_det: f64,
}

impl Problem {
    /// Logarithm of the marginal likelihood with each candidate, the parameters of `base` present with normal priors of the
    /// standard deviations `base_sd`. `slabs` gives the priors of a candidate's own parameters, counted from 0, one set a
    /// class. The variation from run to run is left out.
    pub(crate) fn screened(
        &self,
        sum: &Products,
        (base, base_sd): (&[usize], &[f64]),
        slabs: &(dyn Fn(usize) -> Vec<Vec<Slab>> + Sync),
    ) -> Option<Vec<f64>> {
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

    /// Products of all columns, with those of `base`, at some values of the hyper-parameters.
    pub(crate) fn products(&self, linearized: &Linearized, hypers: &[Vec<f64>], base: &[usize]) -> Vec<Products> {
        let all: Vec<usize> = (0..self.parameters()).collect();
        let of_member = |(member, columns): (&Member, &Vec<Column>)| -> Vec<Arc<Products>> {
            let (acting, places) = acting(columns, &all);
            let mut white = Columns::default();
            // Hyper-parameters of one family do not move the others' blocks.
            let mut known: Vec<(&[f64], Arc<Products>)> = Vec::new();
            let mut out = Vec::new();
            for own in hypers.iter().map(|hyper| self.hyper_of(member, hyper)) {
                if known.iter().all(|(hyper, _)| *hyper != own) {
                    white.fill_from(&acting);
                    let log_det = member.block.whiten(own, &mut white);
                    known.push((own, Arc::new(self.products_of(&white, &places, base, log_det))));
                }
                out.extend(known.iter().find(|(hyper, _)| *hyper == own).map(|(_, products)| products.clone()));
            }
            out
        };
        let all: Vec<Vec<Arc<Products>>> = self.members.par_iter().zip(&linearized.columns).map(of_member).collect();
        let sum = |k: usize| {
            let mut of_members = all.iter().map(|own| &own[k]);
            let first = of_members.next().map_or_else(Products::default, |first| Products::clone(first));
            of_members.fold(first, |mut sum, own| {
                sum.with_base += &own.with_base;
                sum.own.iter_mut().zip(&own.own).for_each(|(a, b)| *a += b);
                sum.log_det += own.log_det;
                sum
            })
        };
        (0..hypers.len()).map(sum).collect()
    }

    /// Those of a block's whitened columns, whose parameters are in these places.
    fn products_of(&self, white: &Columns, places: &[usize], base: &[usize], log_det: f64) -> Products {
        let count = self.parameters() + 1;
        let mut row_of = vec![None; count];
        places.iter().enumerate().for_each(|(row, place)| row_of[*place] = Some(row));
        let bases: Vec<Option<usize>> =
            std::iter::once(0).chain(base.iter().map(|p| p + 1)).map(|p| row_of[p]).collect();
        let known: Vec<usize> = bases.iter().flatten().copied().collect();
        let mut products = DMatrix::zeros(known.len(), white.width());
        let empty = |c: usize| DMatrix::zeros(self.parameters_of(c).len(), self.parameters_of(c).len());
        let mut own: Vec<DMatrix<f64>> = (0..self.candidates.len()).map(empty).collect();
        for rows in white.values().chunks(TOGETHER * white.width()) {
            let columns = DMatrix::from_row_slice(rows.len() / white.width(), white.width(), rows);
            products += columns.select_columns(&known).transpose() * &columns;
            for (c, own) in own.iter_mut().enumerate() {
                let column = |p: usize| row_of[p + 1].map(|row| columns.column(row));
                let all: Vec<_> = self.parameters_of(c).map(column).collect();
                let product = |i: usize, j: usize| all[i].zip(all[j]).map_or(0.0, |(a, b)| a.dot(&b));
                *own += DMatrix::from_fn(all.len(), all.len(), product);
            }
        }
        let mut with_base = DMatrix::zeros(bases.len(), count);
        let rows_of_base = (0..bases.len()).filter(|i| bases[*i].is_some());
        for (from, to) in rows_of_base.enumerate() {
            places.iter().enumerate().for_each(|(row, place)| with_base[(to, *place)] = products[(from, row)]);
        }
        Products { with_base, own, log_det }
    }
}
