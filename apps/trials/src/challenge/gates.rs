//! The table of the gates: how often the answers were right, over many seeds.

use super::play::Played;
use super::record::{CLEAR_EFFECT_SIZE, Kind};
use fss_estimation::statistics::median;
use serde::Serialize;
use std::ops::RangeInclusive;

/// Effect sizes that count as about 1.
const ABOUT_ONE: std::ops::Range<f64> = 0.7..1.4;
/// Most members of an undecided set.
const MOST_MEMBERS: usize = 3;
/// Bins of the probabilities' calibration.
const BINS: usize = 5;
/// Fewer values make no median, no coverage and no calibration.
const ENOUGH: usize = 20;

/// One gate: what was reached, and what must be.
#[derive(Clone, Debug, Serialize)]
#[allow(clippy::struct_field_names)]
pub(super) struct Gate {
    /// What is measured.
    pub name: &'static str,
    /// The figure: a share, or a ratio.
    pub value: Option<f64>,
    /// Cases that count.
    pub cases: usize,
    /// Fewer cases decide nothing: with fewer a single miss would.
    pub cases_needed: usize,
    /// The 90 % interval of a share (Wilson).
    pub interval: Option<(f64, f64)>,
    /// Least and largest value that pass.
    #[serde(rename = "gate")]
    pub passes: (f64, f64),
    /// `PASS`, `short`, or `too few` cases.
    pub mark: &'static str,
    #[serde(skip)]
    is_share: bool,
}

impl Gate {
    fn new(
        name: &'static str,
        value: Option<f64>,
        cases: usize,
        gate: RangeInclusive<f64>,
        cases_needed: usize,
    ) -> Self {
        let mark = match value {
            Some(value) if cases >= cases_needed => {
                if gate.contains(&value) {
                    "PASS"
                } else {
                    "short"
                }
            }
            _ => "too few",
        };
        let passes = gate.into_inner();
        Self { name, value, cases, cases_needed, interval: None, passes, mark, is_share: false }
    }

    /// The share of cases that are true.
    fn share(name: &'static str, cases: impl Iterator<Item = bool>, gate: RangeInclusive<f64>) -> Self {
        let cases: Vec<bool> = cases.collect();
        let (n, hits) = (cases.len(), cases.iter().filter(|hit| **hit).count());
        let value = (n > 0).then(|| hits as f64 / n as f64);
        // So many cases that the gate allows one miss.
        let misses = if *gate.start() > 0.0 { 1.0 - gate.start() } else { *gate.end() };
        let needed = (1.0 / misses - 1e-9).ceil() as usize;
        let is_two_sided = *gate.start() > 0.0 && *gate.end() < 1.0;
        let needed = if is_two_sided { needed.max(ENOUGH) } else { needed };
        Self { interval: (n > 0).then(|| wilson(hits, n)), ..Self::new(name, value, n, gate, needed) }.in_percent()
    }

    /// The median of values, which must not be larger than `most`.
    fn median(name: &'static str, values: &[f64], most: f64) -> Self {
        Self::new(name, median(&mut values.to_vec()), values.len(), 0.0..=most, ENOUGH)
    }

    fn in_percent(mut self) -> Self {
        self.is_share = true;
        self
    }

    fn number(&self, value: f64) -> String {
        if self.is_share { format!("{:.1} %", value * 100.0) } else { format!("{value:.2}") }
    }

    /// The gate in words.
    fn asked(&self) -> String {
        let (least, most) = self.passes;
        match (least > 0.0, self.is_share && most >= 1.0) {
            (true, true) => format!(">= {}", self.number(least)),
            (true, false) => format!("{:.0} to {:.0} %", least * 100.0, most * 100.0),
            _ => format!("<= {}", self.number(most)),
        }
    }
}

/// The 90 % interval of a share (Wilson, 1927).
fn wilson(hits: usize, n: usize) -> (f64, f64) {
    let (n, z) = (n as f64, 1.645);
    let share = hits as f64 / n;
    let middle = (share + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z / (1.0 + z * z / n) * (share * (1.0 - share) / n + z * z / (4.0 * n * n)).sqrt();
    ((middle - half).max(0.0), (middle + half).min(1.0))
}

/// The table of the seeds that were played.
pub(super) fn table(played: &[&Played]) -> Vec<Gate> {
    let of = |kind: Kind| played.iter().copied().filter(move |p| p.hidden.kind == kind);
    let has_clear_effect = |p: &&Played| p.hidden.largest_effect_size() >= CLEAR_EFFECT_SIZE;
    let clear_one = || of(Kind::One).filter(has_clear_effect);
    let separable = || clear_one().filter(|p| p.hidden.effects.iter().all(|e| e.is_separable != Some(false)));
    let clear =
        || played.iter().copied().filter(|p| matches!(p.hidden.kind, Kind::One | Kind::Two)).filter(has_clear_effect);
    let errors: Vec<f64> = clear().flat_map(|p| p.score.errors.iter().copied()).collect();
    let ratios: Vec<f64> = clear().filter(|p| p.score.first_is_right).filter_map(|p| p.said.ratio_after).collect();
    let claims: Vec<(f64, bool)> = played.iter().flat_map(|p| p.score.claims.iter().copied()).collect();
    let asserted = |p: &&Played| (0..p.score.asserted).map(|i| i < p.score.asserted_wrongly).collect::<Vec<_>>();
    let sets = clear().flat_map(|p| p.score.sets.iter().map(|(holds, count)| *holds && *count <= MOST_MEMBERS));
    let about_one = of(Kind::One).filter(|p| ABOUT_ONE.contains(&p.hidden.largest_effect_size()));
    let both = of(Kind::Two).filter(|p| p.hidden.smallest_effect_size() >= CLEAR_EFFECT_SIZE);
    vec![
        Gate::share("false alarms where nothing is hidden", of(Kind::None).map(|p| p.score.detected), 0.0..=0.01),
        Gate::share("detected, d about 1", about_one.map(|p| p.score.detected), 0.85..=1.0),
        Gate::share("detected, d >= 2", clear_one().map(|p| p.score.detected), 0.97..=1.0),
        Gate::share("right cause first, d >= 2, separable", separable().map(|p| p.score.first_is_right), 0.95..=1.0),
        Gate::share("wrong among all asserted", played.iter().flat_map(asserted), 0.0..=0.02),
        Gate::median("median parameter error, d >= 2", &errors, 0.05).in_percent(),
        Gate::share(
            "90 % interval holds the value, d >= 2",
            clear().flat_map(|p| p.score.covered.iter().copied()),
            0.86..=0.94,
        ),
        Gate::share("two effects, both right, d >= 2", both.map(|p| p.score.all_are_right), 0.85..=1.0),
        Gate::share(
            "outside the catalogue, says so, d >= 2",
            of(Kind::Outside).filter(has_clear_effect).map(|p| p.score.says_unexplained),
            0.95..=1.0,
        ),
        Gate::share("undecided: the set holds the truth, at most 3", sets, 0.95..=1.0),
        Gate::median("median RMS over noise floor after extending", &ratios, 1.1),
        Gate::new("calibration error of the probabilities", calibration(&claims), claims.len(), 0.0..=0.03, ENOUGH),
    ]
}

/// Expected calibration error: how far the share of right claims is from what was claimed, weighted by how often.
fn calibration(claims: &[(f64, bool)]) -> Option<f64> {
    let bin = |p: f64| ((p * BINS as f64) as usize).min(BINS - 1);
    let mut sums = [(0.0, 0.0); BINS];
    for (probability, is_right) in claims {
        let sum = &mut sums[bin(*probability)];
        sum.0 += probability;
        sum.1 += f64::from(u8::from(*is_right));
    }
    let apart: f64 = sums.iter().map(|(claimed, right)| (claimed - right).abs()).sum();
    (!claims.is_empty()).then(|| apart / claims.len() as f64)
}

/// Prints the table.
pub(super) fn print(played: &[&Played]) {
    let own = played.iter().filter(|p| p.hidden.is_own_vehicle).count();
    say!("{} seeds, {own} of them with the plant file's own vehicle\n", played.len());
    say!("{:<46} {:>8} {:>15} {:>6} {:>12}", "", "reached", "90 % interval", "cases", "gate");
    for gate in table(played) {
        let interval =
            gate.interval.map_or_else(String::new, |(a, b)| format!("{:.0} to {:.0} %", a * 100.0, b * 100.0));
        let reached = gate.value.map_or_else(|| "-".to_owned(), |value| gate.number(value));
        let mark = match gate.mark {
            "too few" => format!("too few: {} of {}", gate.cases, gate.cases_needed),
            mark => mark.to_owned(),
        };
        say!("{:<46} {reached:>8} {interval:>15} {:>6} {:>12}  {mark}", gate.name, gate.cases, gate.asked());
    }
    let mean = |of: fn(&Played) -> f64| played.iter().map(|p| of(p)).sum::<f64>() / played.len().max(1) as f64;
    say!(
        "\nA game took {:.1} s to draw, {:.1} s to fly and {:.1} s to diagnose.",
        mean(|p| p.drawn_in_s),
        mean(|p| p.flown_in_s),
        mean(|p| p.diagnosed_in_s)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gate_that_one_miss_would_decide_says_that_there_are_too_few_cases() {
        let share = |hits: usize, n: usize, gate| Gate::share("", (0..n).map(|i| i < hits), gate);
        assert_eq!(share(0, 99, 0.0..=0.01).mark, "too few");
        assert_eq!(share(1, 100, 0.0..=0.01).mark, "PASS");
        assert_eq!(share(2, 100, 0.0..=0.01).mark, "short");
        assert_eq!(share(33, 34, 0.97..=1.0).mark, "PASS");
        assert_eq!(share(33, 33, 0.97..=1.0).mark, "too few");
        assert_eq!(share(0, 0, 0.95..=1.0).mark, "too few");
    }

    #[test]
    fn intervals_that_hold_too_much_are_as_short_as_those_that_hold_too_little() {
        let coverage = |hits: usize| Gate::share("", (0..100).map(|i| i < hits), 0.86..=0.94).mark;
        assert_eq!([coverage(80), coverage(90), coverage(99)], ["short", "PASS", "short"]);
    }

    #[test]
    fn probabilities_that_come_true_as_often_as_they_say_are_calibrated() {
        let claims = |right: usize| (0..100).map(|i| (0.9, i < right)).collect::<Vec<_>>();
        assert!(calibration(&claims(90)).is_some_and(|error| error < 1e-9));
        assert!(calibration(&claims(60)).is_some_and(|error| (error - 0.3).abs() < 1e-9));
    }
}
