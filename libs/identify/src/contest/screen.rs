//! The screen: what a linear fit of each cause would gain, for all causes at once.

use super::Contest;
use crate::normal::Normal;
use crate::sensitivity::Column;
use fss_plant::Effect;
use nalgebra::{DMatrix, DVector};

/// A cause as the screen sees it.
#[derive(Clone, Debug)]
pub(crate) struct Screened {
    pub(crate) hypothesis: usize,
    /// Fall of the sum of squares, beyond what is taken already.
    pub(crate) gain: f64,
    pub(crate) effect: Effect,
}

/// An onset has to gain this much, and this share, over being there from the start.
const ONSET_GAIN: f64 = 40.0;
const ONSET_SHARE: f64 = 0.1;

impl Contest {
    /// All causes beside those `taken`, best first, where `residuals` is what is left now.
    pub(crate) fn screen(&self, residuals: &[DVector<f64>], taken: &[usize]) -> Vec<Screened> {
        let always = self.screen_from(residuals, taken, 0.0);
        let mut best = always;
        for onset_s in self.onsets_s() {
            for (own, late) in best.iter_mut().zip(self.screen_from(residuals, taken, onset_s)) {
                let enough = own.gain + (ONSET_GAIN * self.unit).max(ONSET_SHARE * own.gain);
                if late.gain > enough && own.effect.onset_s().is_none_or(|_| late.gain > own.gain) {
                    *own = late;
                }
            }
        }
        best.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        best
    }

    /// Times at which something could have begun: where windows begin, but the last ones.
    fn onsets_s(&self) -> Vec<f64> {
        let mut starts: Vec<f64> = self.evidence.cells.iter().map(|c| c.from_s).filter(|t| *t > 1.0).collect();
        let latest_s = self.latest_onset_s();
        starts.retain(|t| *t <= latest_s);
        starts.sort_by(f64::total_cmp);
        starts.dedup_by(|a, b| (*a - *b).abs() < 1.0);
        let stride = starts.len().div_ceil(12).max(1);
        starts.into_iter().step_by(stride).collect()
    }

    /// What begins must be seen for two windows, or what the arm does in the end of every run would be an onset.
    pub(super) fn latest_onset_s(&self) -> f64 {
        let ends_s = self.evidence.cells.iter().map(|c| c.to_s).fold(0.0, f64::max);
        let longest_s = self.evidence.cells.iter().map(|c| c.to_s - c.from_s).fold(0.0, f64::max);
        ends_s - 2.0 * longest_s + 1e-3
    }

    /// The screen with all causes beginning at `onset_s`.
    fn screen_from(&self, residuals: &[DVector<f64>], taken: &[usize], onset_s: f64) -> Vec<Screened> {
        let (width, n) = (self.width(), self.nuisance_count);
        let mut sum = Normal::zero(width);
        for (i, cell) in self.screen.iter().enumerate() {
            let late = self.evidence.cells[i].from_s < onset_s - 1e-6;
            if late {
                // Only the nuisances act here.
                let mut own = sum.g.view_mut((0, 0), (n, n));
                own += cell.g.view((0, 0), (n, n));
                let mut right = sum.b.rows_mut(0, n);
                right += self.columns[i].columns(0, n).tr_mul(&residuals[i]);
            } else {
                sum.g += &cell.g;
                sum.b += self.columns[i].tr_mul(&residuals[i]);
            }
            sum.c += residuals[i].norm_squared();
            sum.freedom += cell.freedom;
        }
        let absorbed = sum.absorbed(n, self.unit);
        let own: Vec<usize> = taken.iter().flat_map(|h| self.columns_of(*h)).collect();
        let before = absorbed.fit(&own).gain;
        (0..self.hypotheses.len())
            .map(|h| {
                let mut columns = own.clone();
                let new = self.columns_of(h);
                columns.extend(new.iter().filter(|c| !own.contains(c)));
                let fit = absorbed.fit(&columns);
                let value: Vec<f64> =
                    columns.iter().zip(fit.value.iter()).filter(|(c, _)| new.contains(c)).map(|(_, v)| *v).collect();
                let (gain, effect) = self.within_bounds(h, &value, fit.gain - before, &absorbed);
                let effect = if onset_s > 0.0 { effect.from_onset(onset_s) } else { effect };
                Screened { hypothesis: h, gain, effect }
            })
            .collect()
    }

    /// The effect within its bounds, and what is left of its gain there.
    fn within_bounds(&self, h: usize, value: &[f64], gain: f64, absorbed: &Normal) -> (f64, Effect) {
        let hypothesis = &self.hypotheses[h];
        let effect = hypothesis.at(value);
        if hypothesis.is_discrete {
            // There or not there: all of it.
            let columns = self.columns_of(h);
            return (-absorbed.change(&columns, &DVector::from_element(1, 1.0)), effect);
        }
        if hypothesis.has_shape {
            let possible = value[0] > 0.0 || hypothesis.nominal.about().parameters[0].lower < 0.0;
            return (if possible { gain } else { 0.0 }, effect);
        }
        if hypothesis.is_compliance() {
            return (if value[0] > 0.0 { gain } else { 0.0 }, effect);
        }
        let possible: Vec<f64> =
            effect.values().iter().zip(hypothesis.nominal.values()).take(value.len()).map(|(v, n)| v - n).collect();
        if possible.iter().zip(value).all(|(a, b)| (a - b).abs() < 1e-12 + 1e-9 * b.abs()) {
            return (gain, effect);
        }
        let inside: Vec<usize> =
            (0..value.len()).filter(|i| (possible[*i] - value[*i]).abs() < 1e-12 + 1e-9 * value[*i].abs()).collect();
        let (at_bound, there) = at_bound(&absorbed.of(&self.columns_of(h)), &possible, &inside);
        (gain.min(at_bound), hypothesis.at(&there))
    }

    /// Cosines between what is left of any two causes once the nuisances have absorbed theirs: the largest between their
    /// coordinates' spaces. 1 is two causes that these data cannot tell apart.
    pub(crate) fn confusability(&self, causes: &[usize]) -> DMatrix<f64> {
        let total = Normal::sum(self.width(), self.screen.iter()).absorbed(self.nuisance_count, self.unit);
        DMatrix::from_fn(causes.len(), causes.len(), |i, j| {
            if i == j { 1.0 } else { cosine(&total.g, &self.columns_of(causes[i]), &self.columns_of(causes[j])) }
        })
    }
}

/// What coordinates gain where some have reached a bound and stay there, and the others, `inside`, follow; and where they are.
/// What counts is the bound itself, not nothing: a motor without torque, a thruster without thrust are at one.
fn at_bound(own: &Normal, possible: &[f64], inside: &[usize]) -> (f64, Vec<f64>) {
    let held = |i: usize| if inside.contains(&i) { 0.0 } else { possible[i] };
    let mut there = DVector::from_fn(possible.len(), |i, _| held(i));
    let beside = Normal { b: &own.b - &own.g * &there, ..own.clone() };
    for (i, v) in inside.iter().zip(beside.fit(inside).value.iter()) {
        there[*i] = *v;
    }
    let all: Vec<usize> = (0..possible.len()).collect();
    (-own.change(&all, &there), there.as_slice().to_vec())
}

/// The same between what some columns can do together and what some others can.
pub(super) fn likeness(columns: &[Column], some: &[usize], others: &[usize]) -> f64 {
    let dot = |a: &Column, b: &Column| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
    let products = DMatrix::from_fn(columns.len(), columns.len(), |i, j| dot(&columns[i], &columns[j]));
    cosine(&products, some, others)
}

/// Largest cosine between a direction of `a` and the space of `b`, whose products are given.
fn cosine(products: &DMatrix<f64>, a: &[usize], b: &[usize]) -> f64 {
    let block = |x: &[usize], y: &[usize]| DMatrix::from_fn(x.len(), y.len(), |i, j| products[(x[i], y[j])]);
    let root = |m: DMatrix<f64>| {
        let eigen = m.symmetric_eigen();
        let floor = 1e-9 * eigen.eigenvalues.max();
        let scale = eigen.eigenvalues.map(|v| if v > floor && v > 0.0 { 1.0 / v.sqrt() } else { 0.0 });
        &eigen.eigenvectors * DMatrix::from_diagonal(&scale) * eigen.eigenvectors.transpose()
    };
    let between = root(block(a, a)) * block(a, b) * root(block(b, b));
    between.singular_values().max().min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_whose_best_size_is_beyond_its_bound_gains_what_the_bound_gains() {
        // Best at -1.25, no further than -1: 25/4 is nearly kept. A second coordinate follows to where it is best then.
        let mut own = Normal::zero(2);
        own.g.copy_from(&DMatrix::from_row_slice(2, 2, &[4.0, 0.0, 0.0, 1.0]));
        own.b.copy_from(&DVector::from_row_slice(&[-5.0, 2.0]));
        let (gain, there) = at_bound(&own, &[-1.0, 2.0], &[1]);
        assert!((gain - (6.0 + 4.0)).abs() < 1e-9, "{gain}");
        assert_eq!(there, [-1.0, 2.0]);
    }
}
