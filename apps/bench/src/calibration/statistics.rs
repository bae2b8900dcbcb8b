//! Statistics over all cases: ranks of true values, reliability of probabilities, counts.

use super::case::{Assertion, Case};
use serde::Serialize;

/// Bins of ranks, and of probabilities.
const BINS: usize = 10;
/// Terms of the Kolmogorov distribution's series, and the argument below which it is 1 to seven digits.
const TERMS: i32 = 100;
const SURELY_UNIFORM: f64 = 0.25;

/// Of all cases.
#[derive(Serialize)]
pub(super) struct Statistics {
    /// How many.
    pub cases: usize,
    /// Causes that were drawn.
    pub drawn: usize,
    /// Those of them that were asserted, by name or as an alternative.
    pub recovered: usize,
    /// Those of them of which no inclusion probability was told.
    pub drawn_untold: usize,
    /// Causes that were asserted, laws included.
    pub asserted: usize,
    /// Those of them that act, or cannot be told from one that does.
    pub right_by_name: usize,
    /// Those of them in whose place an alternative acts.
    pub right_as_alternative: usize,
    /// All others.
    pub wrong: usize,
    /// Cases in which nothing was hidden.
    pub null_cases: usize,
    /// Those of them in which something was asserted.
    pub null_cases_with_name: usize,
    /// Ranks of true values.
    pub ranks: Ranks,
    /// Inclusion probabilities against how often the cause acted.
    pub reliability: Vec<Bin>,
    /// Mean, over the inclusion probabilities beyond the first bin, of the distance between mean probability and frequency in
    /// their bin.
    pub expected_calibration_error: Option<f64>,
}

/// Ranks of true values in their posteriors.
#[derive(Serialize)]
pub(super) struct Ranks {
    /// How many.
    pub count: usize,
    /// How many in each bin of equal width.
    pub histogram: [usize; BINS],
    /// Largest distance of the ranks' distribution from the uniform one.
    pub kolmogorov_smirnov_d: Option<f64>,
    /// Its p-value, if the ranks were independent.
    pub p_value: Option<f64>,
    /// Share of the true values within the central 90 % of their posteriors.
    pub coverage_90: Option<f64>,
}

/// Inclusion probabilities between two values.
#[derive(Serialize)]
pub(super) struct Bin {
    /// The lower one.
    pub from: f64,
    /// The upper one.
    pub to: f64,
    /// How many.
    pub count: usize,
    /// Their mean.
    pub mean_probability: Option<f64>,
    /// Share of these causes that acted.
    pub frequency: Option<f64>,
}

impl Statistics {
    /// Of these cases.
    pub(super) fn of(cases: &[Case]) -> Self {
        let sum = |count: fn(&Case) -> usize| cases.iter().map(count).sum::<usize>();
        let judged = |as_what: Assertion| cases.iter().flat_map(|c| &c.asserted).filter(|a| **a == as_what).count();
        let told: Vec<(f64, bool)> = cases.iter().flat_map(|case| case.inclusion.iter().copied()).collect();
        let reliability: Vec<Bin> = (0..BINS).map(|i| Bin::of(i, &told)).collect();
        let nulls = || cases.iter().filter(|case| case.drawn == 0);
        Self {
            cases: cases.len(),
            drawn: sum(|case| case.drawn),
            recovered: sum(|case| case.recovered),
            drawn_untold: sum(|case| case.untold),
            asserted: sum(|case| case.asserted.len()),
            right_by_name: judged(Assertion::ByName),
            right_as_alternative: judged(Assertion::AsAlternative),
            wrong: judged(Assertion::Wrong),
            null_cases: nulls().count(),
            null_cases_with_name: nulls().filter(|case| !case.asserted.is_empty()).count(),
            ranks: Ranks::of(cases.iter().flat_map(|case| case.ranks.iter().copied()).collect()),
            expected_calibration_error: expected_error(&reliability[1..]),
            reliability,
        }
    }
}

impl Ranks {
    fn of(mut ranks: Vec<f64>) -> Self {
        ranks.sort_by(f64::total_cmp);
        let n = ranks.len();
        let mut histogram = [0; BINS];
        for rank in &ranks {
            histogram[bin_of(*rank)] += 1;
        }
        let distance = |(i, rank): (usize, &f64)| ((i + 1) as f64 / n as f64 - rank).max(rank - i as f64 / n as f64);
        let d = (n > 0).then(|| ranks.iter().enumerate().map(distance).fold(0.0, f64::max));
        let covered = ranks.iter().filter(|rank| (0.05..=0.95).contains(*rank)).count();
        Self {
            count: n,
            histogram,
            kolmogorov_smirnov_d: d,
            p_value: d.map(|d| p_value(d, n)),
            coverage_90: mean(covered as f64, n),
        }
    }
}

impl Bin {
    fn of(bin: usize, told: &[(f64, bool)]) -> Self {
        let own: Vec<&(f64, bool)> = told.iter().filter(|(p, _)| bin_of(*p) == bin).collect();
        let acting = own.iter().filter(|(_, acts)| *acts).count();
        Self {
            from: bin as f64 / BINS as f64,
            to: (bin + 1) as f64 / BINS as f64,
            count: own.len(),
            mean_probability: mean(own.iter().map(|(p, _)| p).sum(), own.len()),
            frequency: mean(acting as f64, own.len()),
        }
    }

    /// Distance of mean probability and frequency, times the count.
    fn error(&self) -> f64 {
        let both = self.mean_probability.zip(self.frequency);
        both.map_or(0.0, |(p, frequency)| self.count as f64 * (p - frequency).abs())
    }
}

fn expected_error(bins: &[Bin]) -> Option<f64> {
    mean(bins.iter().map(Bin::error).sum(), bins.iter().map(|bin| bin.count).sum())
}

/// Probability that so many independent uniform values are at least as far from uniform, of the Kolmogorov-Smirnov distance
/// (Stephens' approximation for few values).
fn p_value(distance: f64, count: usize) -> f64 {
    let root = (count as f64).sqrt();
    let x = (root + 0.12 + 0.11 / root) * distance;
    if x < SURELY_UNIFORM {
        return 1.0;
    }
    let term = |k: i32| {
        let sign = if k % 2 == 1 { 1.0 } else { -1.0 };
        2.0 * sign * (-2.0 * (f64::from(k) * x).powi(2)).exp()
    };
    (1..=TERMS).map(term).sum::<f64>().clamp(0.0, 1.0)
}

fn bin_of(value: f64) -> usize {
    ((value * BINS as f64) as usize).min(BINS - 1)
}

fn mean(sum: f64, count: usize) -> Option<f64> {
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_p_value_is_that_of_the_tables() {
        // Critical values of n = 20: 0.294 at 5 %, 0.352 at 1 %.
        assert!((p_value(0.294, 20) - 0.05).abs() < 0.003, "{}", p_value(0.294, 20));
        assert!((p_value(0.352, 20) - 0.01).abs() < 0.002, "{}", p_value(0.352, 20));
    }

    #[test]
    fn uniform_ranks_are_uniform_and_narrow_posteriors_are_not() {
        let uniform = Ranks::of((0..200).map(|i| (f64::from(i) + 0.5) / 200.0).collect());
        assert!(uniform.p_value.is_some_and(|p| p > 0.99));
        assert_eq!(uniform.histogram, [20; BINS]);
        assert_eq!(uniform.coverage_90, Some(0.9));
        let narrow = Ranks::of((0..200).map(|i| if i % 2 == 0 { 0.01 } else { 0.99 }).collect());
        assert!(narrow.p_value.is_some_and(|p| p < 1e-6));
        assert!(Ranks::of(Vec::new()).p_value.is_none());
    }
}
