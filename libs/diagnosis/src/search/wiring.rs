//! Which command opens which thruster, where no few causes explain the motion.
//!
//! With b_ij the whitened column of what command i does through thruster j, and e the whitened data without any command, a wiring w,
//! command i to thruster w(i), leaves
//!
//! ```text
//! chi2(w) = |e - sum_i b_i,w(i)|^2 = e'e - 2 sum_i e'b_i,w(i) + sum_i,k b_i,w(i)'b_k,w(k)
//! ```
//!
//! so that one Gram matrix has all wirings. The best is found by exchanging pairs, from the plant file's wiring and from that which the
//! least-squares solution over all b_ij is closest to. Its marginal likelihood, the noise inferred anew and no cause acting, is compared
//! with that of the best set of causes.

use super::hyper::Reach;
use super::no_cause::medians;
use super::searched::Searched;
use super::sets::{SIZES, log_sum};
use super::space::Search;
use crate::block::HyperParameter;
use crate::conclude::ASSERTED;
use crate::gram::GramCache;
use crate::problem::{Column, Linearized, Member, Problem, Slope, difference};
use fss_estimation::Columns;
use fss_multibody::ModelError;
use fss_plant::Effect;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Prior probability that more than single lines are exchanged: a harness is plugged in by hand, and tried before it flies.
const REWIRED: f64 = 1e-3;
/// Vehicles with more thrusters are not asked: columns grow with the square of their number.
const MOST_THRUSTERS: usize = 16;
/// Rounds of noise and wiring, each with the other as it is.
const ROUNDS: usize = 3;

/// What explains the data better than any set of causes.
pub(crate) enum Rewired {
    /// A wiring: exchanges that make it of the plant file's, one after the other, and its probability.
    By(Vec<Effect>, f64),
    /// That no command does anything.
    Silent,
}

/// What explains the data better than any set of causes; `None` where a set is as good.
pub(crate) fn rewired(searched: &Searched) -> Result<Option<Rewired>, ModelError> {
    let (search, problem) = (&searched.search, searched.search.problem);
    let count = problem.plant.thrusters.len();
    if !(2..=MOST_THRUSTERS).contains(&count) {
        return Ok(None);
    }
    let wanted = |c: usize, _: &Member| search.chosen.contains(&c);
    let nominal = problem.linearized((&[], &searched.hyper), Slope::Secant, &wanted, Linearized::default())?;
    let actions = Actions::new(problem, count)?;
    let without = actions.wired(&nominal, &vec![None; count]);
    let starts = [searched.hyper.clone(), searched.points[0].hyper.clone(), medians(problem)];
    let silent = search.log_evidence((&without, &starts), &actions).0;
    let as_in_plant_file: Vec<usize> = (0..count).collect();
    let mut best = (f64::NEG_INFINITY, as_in_plant_file.clone());
    for mut hyper in starts {
        for _ in 0..ROUNDS {
            let wiring = actions.most_likely(problem, &without, &hyper);
            if wiring == as_in_plant_file {
                break;
            }
            let linearized = actions.wired(&nominal, &wiring.iter().map(|j| Some(*j)).collect::<Vec<_>>());
            let (value, suited) = search.log_evidence((&linearized, &[hyper]), &actions);
            if value <= best.0 {
                break;
            }
            (best, hyper) = ((value, wiring), suited);
        }
    }
    let others: f64 = (2..=count).map(|k| (k as f64).ln()).sum();
    let prior = (REWIRED * SIZES[0]).ln();
    let (wired, silent) = (best.0 + prior - others, silent + prior);
    let log_odds = log_sum(&[wired, silent]) - searched.sets[0].0.log_posterior;
    let probability = 1.0 / (1.0 + (-log_odds).exp());
    let exchanges = exchanges(&best.1);
    Ok(match (probability >= ASSERTED, silent > wired) {
        (true, true) => Some(Rewired::Silent),
        (true, false) if !exchanges.is_empty() => Some(Rewired::By(exchanges, probability)),
        _ => None,
    })
}

impl Search<'_> {
    /// Logarithm of the marginal likelihood without causes at the hyper-parameters that suit it, sought from the likeliest of some,
    /// with their prior, and these. Only those of the blocks in which thrusters act depend on the wiring.
    fn log_evidence(&self, (linearized, starts): (&Linearized, &[Vec<f64>]), actions: &Actions) -> (f64, Vec<f64>) {
        let (parameters, _) = self.parameters_with(&[]);
        let value = |hyper: &[f64]| {
            let point = self.point(linearized, hyper, &parameters, &GramCache::default());
            point.and_then(|point| point.log_posterior(&[])).unwrap_or(f64::NEG_INFINITY)
        };
        let all = starts.iter().map(|start| (value(start), start));
        let Some((_, start)) = all.max_by(|a, b| a.0.total_cmp(&b.0)) else { return (f64::NEG_INFINITY, Vec::new()) };
        let moves = |family: usize, _: &HyperParameter| Some(family) == actions.family;
        let hyper = self.optimized(linearized, &[], &[], start, Reach::OF_MODEL, moves);
        (value(&hyper), hyper)
    }
}

/// What each command does through each thruster.
struct Actions {
    /// Columns b_ij of each block of the base, by command and then thruster; none of other blocks.
    columns: Vec<Vec<Column>>,
    /// The family of those blocks.
    family: Option<usize>,
    count: usize,
}

impl Actions {
    fn new(problem: &Problem, count: usize) -> Result<Self, ModelError> {
        let family = problem.members.iter().map(|m| m.family).min();
        let stuck = |j: usize| Effect::new("thruster_gain").ok().map(|e| e.at(j + 1).with(&[0.0]));
        let all_but = |only: Option<usize>| -> Vec<Effect> {
            let silenced = (0..count).filter(|j| Some(*j) != only).filter_map(stuck);
            problem.plant.effects.iter().cloned().chain(silenced).collect()
        };
        let of_member = |member: &Member| -> Result<Vec<Column>, ModelError> {
            if Some(member.family) != family {
                return Ok(Vec::new());
            }
            let silent = member.block.predict(&problem.plant, &all_but(None))?;
            let action = |(i, j): (usize, usize)| {
                let exchange = (i != j).then(|| exchange(i, j)).flatten();
                let effects: Vec<Effect> = all_but(Some(j)).into_iter().chain(exchange).collect();
                Ok(difference(&member.block.predict(&problem.plant, &effects)?, &silent, 1.0))
            };
            (0..count).flat_map(|i| (0..count).map(move |j| (i, j))).map(action).collect()
        };
        let columns = problem.members.par_iter().map(of_member).collect::<Result<_, _>>()?;
        Ok(Self { columns, family, count })
    }

    /// The data less what each command does through its thruster, instead of through that which the plant file says.
    fn wired(&self, nominal: &Linearized, thrusters: &[Option<usize>]) -> Linearized {
        let count = self.count;
        let of_member = |(columns, actions): (&Vec<Column>, &Vec<Column>)| {
            let mut columns = columns.clone();
            for (i, thruster) in thrusters.iter().enumerate().filter(|(i, j)| **j != Some(*i) && !actions.is_empty()) {
                let mut add =
                    |by: f32, column: &Column| columns[0].iter_mut().zip(column).for_each(|(d, c)| *d += by * c);
                add(1.0, &actions[i * count + i]);
                if let Some(j) = thruster {
                    add(-1.0, &actions[i * count + j]);
                }
            }
            columns
        };
        let columns = nominal.columns.iter().zip(&self.columns).map(of_member).collect();
        Linearized { columns, size: nominal.size.clone() }
    }

    /// The likeliest wiring at values of the hyper-parameters; `without` has the data without commands.
    fn most_likely(&self, problem: &Problem, without: &Linearized, hyper: &[f64]) -> Vec<usize> {
        let width = self.count * self.count + 1;
        let of_member = |((member, columns), actions): ((&Member, &Vec<Column>), &Vec<Column>)| {
            if actions.is_empty() {
                return DMatrix::zeros(width, width);
            }
            let all: Vec<&[f32]> = std::iter::once(&columns[0]).chain(actions).map(Vec::as_slice).collect();
            let mut white = Columns::of(&all);
            member.block.whiten(problem.hyper_of(member, hyper), &mut white);
            let rows = DMatrix::from_column_slice(white.width(), white.rows(), white.values());
            &rows * rows.transpose()
        };
        let members: Vec<_> = problem.members.iter().zip(&without.columns).zip(&self.columns).collect();
        // Summed in order, so that the answer does not hang on the threads.
        let grams: Vec<DMatrix<f64>> = members.into_par_iter().map(of_member).collect();
        let products = Products { gram: grams.into_iter().sum(), count: self.count };
        let [a, b] = [(0..self.count).collect(), products.closest()].map(|start| products.improved(start));
        if products.left(&b) < products.left(&a) { b } else { a }
    }
}

/// The exchange of two lines, counted from 0.
fn exchange(a: usize, b: usize) -> Option<Effect> {
    Some(Effect::new("valve_swap").ok()?.at(a.min(b) + 1).with(&[(a.max(b) + 1) as f64]))
}

/// Products of the whitened columns: the data without commands, then b_ij by command and thruster.
struct Products {
    gram: DMatrix<f64>,
    count: usize,
}

impl Products {
    fn column(&self, command: usize, thruster: usize) -> usize {
        1 + command * self.count + thruster
    }

    /// chi2 of a wiring.
    fn left(&self, wiring: &[usize]) -> f64 {
        let columns: Vec<usize> = wiring.iter().enumerate().map(|(i, j)| self.column(i, *j)).collect();
        let own = |a: &usize| columns.iter().map(|b| self.gram[(*a, *b)]).sum::<f64>() - 2.0 * self.gram[(0, *a)];
        self.gram[(0, 0)] + columns.iter().map(own).sum::<f64>()
    }

    /// The wiring that takes the largest coefficients of the least-squares solution over all columns, one after the other.
    fn closest(&self) -> Vec<usize> {
        let (size, count) = (self.count * self.count, self.count);
        let products = self.gram.view((1, 1), (size, size)).into_owned();
        let ridge = DMatrix::identity(size, size) * (1e-6 * products.trace() / size as f64 + f64::MIN_POSITIVE);
        let data = DVector::from_fn(size, |i, _| self.gram[(0, 1 + i)]);
        let solution = (products + ridge).cholesky().map_or_else(|| data.clone(), |c| c.solve(&data));
        let mut order: Vec<usize> = (0..size).collect();
        order.sort_by(|a, b| solution[*b].total_cmp(&solution[*a]));
        let mut wiring = vec![usize::MAX; count];
        for k in order {
            let (command, thruster) = (k / count, k % count);
            if wiring[command] == usize::MAX && !wiring.contains(&thruster) {
                wiring[command] = thruster;
            }
        }
        wiring
    }

    /// The wiring that no exchange of two makes better.
    fn improved(&self, mut wiring: Vec<usize>) -> Vec<usize> {
        let mut left = self.left(&wiring);
        loop {
            let before = left;
            for a in 0..self.count {
                for b in a + 1..self.count {
                    wiring.swap(a, b);
                    let now = self.left(&wiring);
                    // What no command tells apart stays as the plant file has it.
                    if now < left - 1e-9 * self.gram[(0, 0)] {
                        left = now;
                    } else {
                        wiring.swap(a, b);
                    }
                }
            }
            if left >= before {
                return wiring;
            }
        }
    }
}

/// Exchanges of lines that make a wiring of the plant file's, one after the other.
fn exchanges(wiring: &[usize]) -> Vec<Effect> {
    // Line of each thruster.
    let mut lines: Vec<usize> = (0..wiring.len()).collect();
    let mut all = Vec::new();
    for (command, thruster) in wiring.iter().enumerate() {
        let Some(now) = lines.iter().position(|line| *line == command).filter(|now| now != thruster) else { continue };
        lines.swap(now, *thruster);
        all.extend(exchange(now, *thruster));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns that are unit vectors but for one pair, and data that a wiring makes.
    fn products(wiring: &[usize]) -> Products {
        let count = wiring.len();
        let size = count * count;
        let column =
            |k: usize| DVector::from_fn(size, |i, _| f64::from(u8::from(i == k)) + 0.1 * ((i * k) as f64).sin());
        let columns: Vec<DVector<f64>> = (0..size).map(column).collect();
        let data: DVector<f64> = wiring.iter().enumerate().map(|(i, j)| &columns[i * count + j]).sum();
        let all: Vec<DVector<f64>> = std::iter::once(data).chain(columns).collect();
        let all = DMatrix::from_columns(&all);
        Products { gram: all.tr_mul(&all), count }
    }

    #[test]
    fn any_wiring_is_found_from_its_products() {
        for wiring in [vec![0, 1, 2, 3], vec![1, 0, 2, 3], vec![2, 0, 1, 3], vec![3, 2, 0, 1]] {
            let products = products(&wiring);
            assert!(products.left(&wiring).abs() < 1e-9);
            assert_eq!(products.improved(products.closest()), wiring);
        }
    }

    #[test]
    fn exchanges_one_after_the_other_make_the_wiring() {
        for wiring in [vec![0, 1, 2], vec![1, 2, 0, 3], vec![4, 0, 3, 2, 1]] {
            let mut lines: Vec<usize> = (0..wiring.len()).collect();
            for exchange in exchanges(&wiring) {
                lines.swap(exchange.index().unwrap_or(0) - 1, exchange.values()[0] as usize - 1);
            }
            let made: Vec<usize> =
                (0..wiring.len()).filter_map(|command| lines.iter().position(|line| *line == command)).collect();
            assert_eq!(made, wiring);
        }
    }
}
