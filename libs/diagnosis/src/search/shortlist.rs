//! The candidates that a round of the search looks at.

use super::space::Search;
use crate::problem::{Linearized, Present, is_same};
use fss_estimation::evidence::Slab;
use fss_plant::{Response, SLAB_WIDTHS};
use std::collections::HashMap;

/// Strengths that all candidates are looked at first, and how many of them the search goes on with; of a law, so many shapes.
const SCREENED_AT: [f64; 3] = [1.0, 0.1, 5e-3];
const SHORTLIST: usize = 28;
const SHAPES: usize = 3;
const OF_A_KIND: usize = 8;

impl Search<'_> {
    /// Chooses the candidates among some that explain most beside the present model, at some strength of the discrepancy.
    pub(super) fn shortlist(
        &mut self,
        linearized: &Linearized,
        model: &[Present],
        (null, present): (&[f64], &[f64]),
        is_among: &dyn Fn(usize) -> bool,
    ) {
        let problem = self.problem;
        let of_model = |p: &Present| -> Vec<(usize, f64)> {
            let typical = &problem.candidates[p.candidate].prior.typical;
            let widest = SLAB_WIDTHS[SLAB_WIDTHS.len() - 1];
            problem.parameters_of(p.candidate).zip(typical).map(|(at, size)| (at, widest * size.max(1e-6))).collect()
        };
        let (base, sd): (Vec<usize>, Vec<f64>) =
            model.iter().flat_map(of_model).chain(problem.uncertain_parameters().map(|at| (at, 1.0))).unzip();
        let slabs = |candidate: usize| -> Vec<Vec<Slab>> {
            let local: Vec<Option<usize>> = (0..problem.parameters())
                .map(|p| problem.parameters_of(candidate).contains(&p).then(|| p - problem.first[candidate]))
                .collect();
            (0..self.classes(candidate)).filter_map(|class| self.slabs(&[candidate], &[class], &local)).collect()
        };
        let ladders =
            SCREENED_AT.iter().flat_map(|by| [0, 1].map(|family| self.scaled(null, present, family, |_| *by)));
        let mut hypers = vec![present.to_vec()];
        for hyper in ladders {
            if !hypers.contains(&hyper) {
                hypers.push(hyper);
            }
        }
        let mut best = vec![f64::NEG_INFINITY; problem.candidates.len()];
        for (hyper, products) in hypers.iter().zip(problem.products(linearized, &hypers, &base)) {
            let Some(values) = problem.screened(&products, (&base, &sd), &slabs) else { continue };
            let prior = self.log_prior_of(hyper);
            best.iter_mut().zip(values).for_each(|(b, value)| *b = b.max(value + prior));
        }
        let value = |c: usize| best[c] + self.log_prior[c];
        let mut order: Vec<usize> = (0..best.len()).filter(|c| is_among(*c) && best[*c] > f64::NEG_INFINITY).collect();
        order.sort_by(|a, b| value(*b).total_cmp(&value(*a)).then(a.cmp(b)));
        // Of an effect's columns at several sizes the one that explains most.
        let is_sized_otherwise = |c: usize, chosen: &[usize]| {
            let own = &problem.candidates[c];
            let is_same = |o: &usize| is_same(&problem.candidates[*o].nominal, &own.nominal);
            own.prior.response == Response::Linear && chosen.iter().any(is_same)
        };
        let mut chosen: Vec<usize> = model.iter().map(|p| p.candidate).collect();
        let mut of_kind: HashMap<&str, usize> = HashMap::new();
        for c in order {
            let shapes = of_kind.entry(&problem.candidates[c].kind).or_default();
            let room = if problem.candidates[c].is_law { SHAPES } else { OF_A_KIND };
            if chosen.len() < SHORTLIST && !chosen.contains(&c) && *shapes < room && !is_sized_otherwise(c, &chosen) {
                *shapes += 1;
                chosen.push(c);
            }
        }
        chosen.sort_unstable();
        (self.parameters, self.position) = self.parameters_with(&chosen);
        self.chosen = chosen;
    }
}
