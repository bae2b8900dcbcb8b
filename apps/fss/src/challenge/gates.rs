//! The table of the gates: how often the answers were right, over many seeds.

use super::hidden::{HiddenEffect, Kind};
use super::play::Played;
use super::score::VISIBLE_DOSE;
use super::story;
use serde::Serialize;

/// Doses that count as about 1, and from which an effect must be found.
const ABOUT_ONE: std::ops::Range<f64> = 0.7..1.4;
const CLEAR_DOSE: f64 = 2.0;
/// Bins of the probabilities' calibration.
const BINS: usize = 5;

/// One gate: what was reached, and what must be.
#[derive(Clone, Debug, Serialize)]
pub struct Gate {
    /// What is measured.
    pub name: &'static str,
    /// The figure: a share, or a ratio.
    pub value: Option<f64>,
    /// Cases that count, and the 90 % interval of the share (Wilson).
    pub cases: usize,
    /// See `cases`.
    pub interval: Option<(f64, f64)>,
    /// What must be reached.
    #[serde(rename = "gate")]
    pub pass: f64,
    /// What would be fine.
    pub stretch: f64,
    /// `short`, `PASS`, `stretch`, or `-` without a case.
    pub mark: &'static str,
    #[serde(skip)]
    is_share: bool,
}

impl Gate {
    fn share(name: &'static str, cases: impl Iterator<Item = bool>, gate: f64, stretch: f64) -> Self {
        let cases: Vec<bool> = cases.collect();
        let (n, hits) = (cases.len(), cases.iter().filter(|hit| **hit).count());
        let value = (n > 0).then(|| hits as f64 / n as f64);
        Self { interval: (n > 0).then(|| wilson(hits, n)), ..Self::figure(name, value, n, gate, stretch) }.in_percent()
    }

    fn in_percent(mut self) -> Self {
        self.is_share = true;
        self
    }

    fn figure(name: &'static str, value: Option<f64>, cases: usize, gate: f64, stretch: f64) -> Self {
        // Where more is better, the stretch lies above the gate.
        let reaches = |value: f64, goal: f64| if stretch > gate { value >= goal } else { value <= goal };
        let mark = match value {
            None => "-",
            Some(value) if reaches(value, stretch) => "stretch",
            Some(value) if reaches(value, gate) => "PASS",
            Some(_) => "short",
        };
        Self { name, value, cases, interval: None, pass: gate, stretch, mark, is_share: false }
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
pub fn table(played: &[&Played]) -> Vec<Gate> {
    let dose = |p: &Played| p.hidden.effects.iter().map(HiddenEffect::clear_dose).fold(0.0, f64::max);
    let least = |p: &Played| p.hidden.effects.iter().map(HiddenEffect::clear_dose).fold(f64::INFINITY, f64::min);
    let of = |kind: Kind| played.iter().copied().filter(move |p| p.hidden.kind == kind);
    let catalogued = || played.iter().copied().filter(|p| matches!(p.hidden.kind, Kind::One | Kind::Two));
    let clear_one = || of(Kind::One).filter(|p| dose(p) >= CLEAR_DOSE);
    let right = || catalogued().filter(|p| dose(p) >= CLEAR_DOSE);
    let errors: Vec<f64> = right().flat_map(|p| p.score.errors.iter().copied()).collect();
    let ratios: Vec<f64> = right().filter(|p| p.score.first_is_right).map(|p| p.said.ratio_after).collect();
    let claims: Vec<(f64, bool)> = played.iter().flat_map(|p| p.score.claims.iter().copied()).collect();
    let named = || {
        let wrong = |p: &Played| (0..p.score.named).map(|i| i < p.score.named_wrongly).collect::<Vec<_>>();
        played.iter().flat_map(move |p| wrong(p))
    };
    let covered = right().flat_map(|p| p.score.covered.iter().copied());
    let mut coverage = Gate::share("90 % interval holds the value, d >= 2", covered, 0.85, 0.88);
    if coverage.value.is_some_and(|value| value > 0.95) && coverage.cases >= 20 {
        coverage.mark = "short";
    }
    vec![
        Gate::share("false alarms where nothing is hidden", of(Kind::None).map(|p| p.score.detected), 0.02, 0.01),
        Gate::share(
            "detected, d about 1",
            of(Kind::One).filter(|p| ABOUT_ONE.contains(&dose(p))).map(|p| p.score.detected),
            0.70,
            0.85,
        ),
        Gate::share("detected, d >= 2", clear_one().map(|p| p.score.detected), 0.97, 0.99),
        Gate::share(
            "right cause first, d >= 2, separable",
            clear_one()
                .filter(|p| p.hidden.effects.iter().all(|e| e.is_separable != Some(false)))
                .map(|p| p.score.first_is_right),
            0.90,
            0.97,
        ),
        Gate::share("wrong among those named", named(), 0.03, 0.01),
        Gate::figure("median parameter error, d >= 2", median(&errors), errors.len(), 0.10, 0.05).in_percent(),
        coverage,
        Gate::share(
            "two effects, both right, d >= 2",
            of(Kind::Two).filter(|p| least(p) >= CLEAR_DOSE).map(|p| p.score.all_are_right),
            0.70,
            0.85,
        ),
        Gate::share(
            "outside the catalogue, says so, d >= 2",
            of(Kind::Outside).filter(|p| dose(p) >= CLEAR_DOSE).map(|p| p.score.says_unexplained),
            0.80,
            0.95,
        ),
        Gate::share(
            "undecided: the set holds the truth, at most 3",
            right().filter_map(|p| p.score.set).map(|(holds, count)| holds && count <= 3),
            0.95,
            0.99,
        ),
        Gate::figure("median RMS over noise floor after extending", median(&ratios), ratios.len(), 1.3, 1.1),
        Gate::figure("calibration error of the probabilities", calibration(&claims), claims.len(), 0.05, 0.03),
    ]
}

fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied()
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

/// Prints the table and the misses.
pub fn print(played: &[&Played]) {
    say!("{} seeds\n", played.len());
    say!("{:<46} {:>8} {:>15} {:>6} {:>7} {:>8}", "", "reached", "90 % interval", "cases", "gate", "stretch");
    for gate in table(played) {
        let number = |value: f64| if gate.is_share { format!("{:.1} %", value * 100.0) } else { format!("{value:.2}") };
        let interval =
            gate.interval.map_or_else(String::new, |(a, b)| format!("{:.0} to {:.0} %", a * 100.0, b * 100.0));
        say!(
            "{:<46} {:>8} {:>15} {:>6} {:>7} {:>8}  {}",
            gate.name,
            gate.value.map_or_else(|| "-".to_owned(), number),
            interval,
            gate.cases,
            number(gate.pass),
            number(gate.stretch),
            gate.mark
        );
    }
    let misses: Vec<&&Played> = played.iter().filter(|p| is_miss(p)).collect();
    say!("\n{} misses", misses.len());
    for p in misses {
        let hidden: Vec<_> =
            p.hidden.effects.iter().map(|e| format!("{}, d {:.1}", e.record, e.clear_dose())).collect();
        let said: Vec<_> =
            p.said.causes.iter().map(|c| format!("{} {:.0} %", c.record, c.probability * 100.0)).collect();
        let or = |list: Vec<String>, none: &str| if list.is_empty() { none.to_owned() } else { list.join(" and ") };
        say!("  seed {:<5} hidden: {}", p.hidden.seed, or(hidden, "nothing"));
        say!("             said: {}, {}", p.said.verdict, or(said, "no cause"));
        say!("             {}", story::verdict(p));
    }
}

/// Whether the answer falls short of what could be asked for.
fn is_miss(p: &Played) -> bool {
    let dose = p.hidden.effects.iter().map(HiddenEffect::clear_dose).fold(0.0, f64::max);
    p.score.named_wrongly > 0
        || match p.hidden.kind {
            _ if dose < VISIBLE_DOSE => p.score.detected,
            _ if dose < CLEAR_DOSE => false,
            Kind::Outside => !p.score.says_unexplained,
            Kind::Two => !p.score.all_are_right,
            _ => !p.score.first_is_right,
        }
}
