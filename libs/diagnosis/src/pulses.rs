//! Single pulses that a thruster did not deliver.
//!
//! Beside what the causes do, the whitened data e are the sum of the columns b_k of the pulses that are missing, and noise. b_k is
//! the difference of the predictions without pulse k and with it. Every pulse is off by a share of standard deviation s, be it
//! delivered or not. The noise has thus the covariance C = I + s^2 B B', and a set S of missing pulses has against none the odds
//!
//! ```text
//! ln odds(S) = sum over k in S of (g_k + ln prior odds) - 1/2 sum over j, k in S of A_jk
//! A = B' C^-1 B = (I + s^2 B'B)^-1 B'B,   g = B' C^-1 e = (I + s^2 B'B)^-1 B'e
//! ```
//!
//! The most probable set is found by adding or removing one pulse at a time. A pulse's posterior probability is taken over the sets
//! with it and without it, each alone and with any one other pulse: a pulse that could stand in its place takes its share.

use crate::block::Block;
use crate::candidates::DISCRETE_SD;
use crate::conclude::ASSERTED;
use crate::diagnosis::MissingPulse;
use crate::problem::{Member, Problem};
use crate::search::{Searched, log_sum};
use fss_estimation::Columns;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Plant, Pulse};
use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

/// Prior probability that a pulse is not delivered. A thruster that fails more often is repaired before it flies.
const FAILS: f64 = 1e-3;
/// Missing pulses of a run at the most. More are no single pulses, and a cause is looked for in vain.
const MOST: usize = 20;

/// The pulses of the runs of `of` that are asserted to be missing, about the model that the search came to.
pub(crate) fn missing_pulses(searched: &Searched, of: &Problem, runs: &[Run]) -> Result<Vec<MissingPulse>, ModelError> {
    let problem = searched.search.problem;
    let plant = problem.settled(&searched.uncertain_means());
    let effects = problem.effects_of(&plant, &searched.model);
    let of_member = |member: &Member| -> Result<Vec<MissingPulse>, ModelError> {
        let hyper = of.hyper_of(member, &searched.hyper);
        let found = of_block(member.block.as_ref(), &plant, &effects, hyper)?;
        let last_s = member.block.time_of_row().last().copied().unwrap_or(0.0);
        let told = |(pulse, probability): (Pulse, f64)| MissingPulse {
            run: runs[member.run].name.clone(),
            thruster: pulse.thruster + 1,
            from_s: pulse.from_s,
            to_s: pulse.to_s.min(last_s),
            probability,
        };
        Ok(found.into_iter().map(told).collect())
    };
    let all: Vec<Vec<MissingPulse>> = of.members.par_iter().map(of_member).collect::<Result<_, _>>()?;
    Ok(all.into_iter().flatten().collect())
}

/// The missing pulses of a block in order of time, each with its probability.
fn of_block(
    block: &dyn Block,
    plant: &Plant,
    effects: &[Effect],
    hyper: &[f64],
) -> Result<Vec<(Pulse, f64)>, ModelError> {
    block.forget(hyper);
    let (pulses, mut columns): (Vec<Pulse>, Vec<Vec<f64>>) = block.missing_pulses(plant, effects)?.into_iter().unzip();
    if pulses.is_empty() {
        return Ok(Vec::new());
    }
    let predicted = block.predict(plant, effects)?;
    columns.push(block.measured().iter().zip(&predicted).map(|(y, p)| y - p).collect());
    let mut white = Columns::of(&columns);
    block.whiten(hyper, &mut white);
    // Row by row is the transpose column by column.
    let rows = DMatrix::from_column_slice(white.width(), white.rows(), white.values());
    let asked: Vec<usize> = (0..pulses.len()).filter(|k| would_show(rows.row(*k).norm_squared())).collect();
    if asked.is_empty() {
        return Ok(Vec::new());
    }
    let Some(evidence) = Evidence::new(&rows.select_rows(&asked), &rows.row(pulses.len()).transpose()) else {
        return Ok(Vec::new());
    };
    let set = evidence.most_probable();
    let probability = |k: &usize| (pulses[asked[*k]], evidence.probability(&set, *k));
    let mut found: Vec<(Pulse, f64)> = set.iter().map(probability).collect();
    found.retain(|(_, probability)| *probability >= ASSERTED);
    found.sort_by(|(a, _), (b, _)| a.from_s.total_cmp(&b.from_s));
    Ok(found)
}

fn log_prior_odds() -> f64 {
    (FAILS / (1.0 - FAILS)).ln()
}

/// Whether a pulse would be asserted to be missing, were it missing and the noise 0. What is weaker is not asked.
fn would_show(norm_squared: f64) -> bool {
    0.5 * norm_squared + log_prior_odds() > (ASSERTED / (1.0 - ASSERTED)).ln()
}

/// What the data say of the pulses of a run.
struct Evidence {
    /// g above.
    pull: DVector<f64>,
    /// A above.
    products: DMatrix<f64>,
}

impl Evidence {
    /// From whitened columns: the pulses', one in each row, and the data's. `None` where they are not finite.
    fn new(pulses: &DMatrix<f64>, data: &DVector<f64>) -> Option<Self> {
        let gram = pulses * pulses.transpose();
        let n = gram.nrows();
        let spread = &gram * (DISCRETE_SD * DISCRETE_SD) + DMatrix::identity(n, n);
        let cholesky = Cholesky::new(spread)?;
        let own = Self { pull: cholesky.solve(&(pulses * data)), products: cholesky.solve(&gram) };
        own.pull.iter().all(|g| g.is_finite()).then_some(own)
    }

    /// Logarithm of the odds of each pulse beside the others of a set.
    fn log_odds(&self, set: &[usize]) -> Vec<f64> {
        let of = |k: usize| {
            let others: f64 = set.iter().filter(|j| **j != k).map(|j| self.products[(k, *j)]).sum();
            self.pull[k] - 0.5 * self.products[(k, k)] - others + log_prior_odds()
        };
        (0..self.pull.len()).map(of).collect()
    }

    /// The most probable set, one pulse added or removed at a time.
    fn most_probable(&self) -> Vec<usize> {
        let mut set: Vec<usize> = Vec::new();
        // Each step makes the set more probable. The bound holds where rounding would go to and fro.
        for _ in 0..2 * MOST {
            let odds = self.log_odds(&set);
            let gain = |k: usize| if set.contains(&k) { -odds[k] } else { odds[k] };
            let best = (0..odds.len()).max_by(|a, b| gain(*a).total_cmp(&gain(*b)));
            let Some(best) = best.filter(|k| gain(*k) > 0.0) else { break };
            match set.iter().position(|k| *k == best) {
                Some(at) => _ = set.remove(at),
                None if set.len() < MOST => set.push(best),
                None => break,
            }
        }
        set
    }

    /// Posterior probability of a pulse of a set.
    fn probability(&self, set: &[usize], own: usize) -> f64 {
        let rest: Vec<usize> = set.iter().copied().filter(|k| *k != own).collect();
        let (with, without) = (self.log_odds(set), self.log_odds(&rest));
        // A set alone and with any one other pulse.
        let and_another = |odds: &[f64]| {
            let others = (0..odds.len()).filter(|k| !set.contains(k)).map(|k| odds[k]);
            log_sum(&std::iter::once(0.0).chain(others).collect::<Vec<_>>())
        };
        let log_odds = with[own] + and_another(&with) - and_another(&without);
        1.0 / (1.0 + (-log_odds).exp())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Pulses that act on one row each, with this strength over the noise.
    fn apart(strength: f64, data: &[f64]) -> Evidence {
        let n = data.len();
        let pulses = DMatrix::from_fn(n, n, |i, j| if i == j { strength } else { 0.0 });
        Evidence::new(&pulses, &DVector::from_column_slice(data)).unwrap()
    }

    #[test]
    fn a_pulse_that_the_data_lack_is_missing_and_the_others_are_not() {
        let evidence = apart(10.0, &[0.5, 9.5, -0.8, 10.4, 0.0]);
        let mut set = evidence.most_probable();
        set.sort_unstable();
        assert_eq!(set, [1, 3]);
        assert!(set.iter().all(|k| evidence.probability(&set, *k) > 0.999));
        assert!(apart(10.0, &[0.5, 0.9, -0.8]).most_probable().is_empty());
    }

    #[test]
    fn the_evidence_of_one_pulse_is_its_bayes_factor() {
        // Against each other: N(e; b, 1 + s^2 b^2) and N(e; 0, 1 + s^2 b^2).
        let (b, e) = (6.0, 4.4);
        let variance = 1.0 + (DISCRETE_SD * b).powi(2);
        let bayes = (0.5 * (e * e - (e - b) * (e - b)) / variance).exp();
        let odds = bayes * FAILS / (1.0 - FAILS);
        let found = apart(b, &[e]).probability(&[0], 0);
        assert!((found - odds / (1.0 + odds)).abs() < 1e-9, "{found}");
    }

    #[test]
    fn two_pulses_that_do_the_same_share_their_probability() {
        let pulses = DMatrix::from_row_slice(2, 2, &[10.0, 0.0, 10.0, 0.0]);
        let evidence = Evidence::new(&pulses, &DVector::from_column_slice(&[10.0, 0.0])).unwrap();
        let set = evidence.most_probable();
        assert_eq!(set.len(), 1);
        assert!((evidence.probability(&set, set[0]) - 0.5).abs() < 0.01);
    }

    #[test]
    fn a_pulse_that_is_lost_in_noise_is_not_asked() {
        assert!(would_show(100.0) && !would_show(10.0));
    }
}
