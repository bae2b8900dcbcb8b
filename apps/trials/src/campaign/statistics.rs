//! What a campaign has come to: how often the mission succeeds, and how its figures of merit are distributed.

use super::definition::Campaign;
use super::row::{FIGURES, Row};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Of all runs that were flown so far.
#[derive(Debug, Serialize)]
pub(super) struct Statistics {
    /// `fss-campaign-summary/1`.
    pub format: &'static str,
    /// The mission's name.
    pub mission: String,
    /// Runs of the campaign.
    pub runs: u64,
    /// How many were flown so far.
    pub flown: usize,
    /// How many of these succeeded.
    #[serde(flatten)]
    pub rate: Rate,
    /// Distribution of each figure of merit that a run has, over the runs that have it.
    pub figures: BTreeMap<&'static str, Distribution>,
    /// The same for each combination of swept values; empty without a sweep.
    pub points: Vec<Point>,
    /// Runs that did not succeed.
    pub failures: Vec<Failure>,
    /// Time that the runs took, added up, s.
    pub wall_time_s: f64,
}

/// How often.
#[allow(clippy::struct_field_names)] // as the summary's file has them, where nothing else says of what
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Rate {
    /// Runs that succeeded.
    pub succeeded: usize,
    /// Their share; `None` of no runs.
    pub success_rate: Option<f64>,
    /// Wilson's 95 % interval of the rate that more runs would show.
    pub success_interval: Option<[f64; 2]>,
}

/// Of one figure.
#[derive(Clone, Copy, Debug, Serialize)]
#[allow(missing_docs)]
pub(super) struct Distribution {
    pub count: usize,
    pub mean: f64,
    pub std: f64,
    pub min: f64,
    pub p5: f64,
    pub p50: f64,
    pub p95: f64,
    pub max: f64,
}

/// The runs of one combination of swept values.
#[derive(Debug, Serialize)]
pub(super) struct Point {
    /// The values.
    pub swept: BTreeMap<String, f64>,
    /// How many were flown so far.
    pub flown: usize,
    /// How many of these succeeded.
    #[serde(flatten)]
    pub rate: Rate,
    /// Distributions over these runs.
    pub figures: BTreeMap<&'static str, Distribution>,
}

/// A run that did not succeed.
#[derive(Debug, Serialize)]
pub(super) struct Failure {
    /// Its number.
    pub run: u64,
    /// Its seed.
    pub seed: u64,
    /// Its swept values.
    pub swept: BTreeMap<String, f64>,
    /// How it ended.
    pub outcome: String,
    /// Why it did not succeed.
    pub reason: String,
}

impl Statistics {
    /// Of these rows of a campaign.
    pub(super) fn of(campaign: &Campaign, rows: &[&Row]) -> Self {
        let swept = |row: &Row| -> BTreeMap<String, f64> {
            campaign.sweeps.iter().map(|sweep| sweep.key.clone()).zip(row.swept.iter().copied()).collect()
        };
        let failure = |row: &&Row| Failure {
            run: row.run,
            seed: row.seed,
            swept: swept(row),
            outcome: row.outcome.clone(),
            reason: row.reason.clone(),
        };
        let point = |rows: &[&Row]| Point {
            swept: swept(rows[0]),
            flown: rows.len(),
            rate: Rate::of(rows),
            figures: distributions(rows),
        };
        Self {
            format: "fss-campaign-summary/1",
            mission: campaign.stack.mission_name.clone(),
            runs: campaign.count(),
            flown: rows.len(),
            rate: Rate::of(rows),
            figures: distributions(rows),
            points: if campaign.sweeps.is_empty() {
                Vec::new()
            } else {
                // Runs of one combination stand together.
                rows.chunk_by(|a, b| a.swept == b.swept).map(point).collect()
            },
            failures: rows.iter().filter(|row| !row.success).map(failure).collect(),
            wall_time_s: rows.iter().map(|row| row.wall_time_s).sum(),
        }
    }

    /// For a person.
    ///
    /// # Errors
    /// Of writing.
    pub(super) fn print(&self, folder: &Path) {
        /// More failures, or points, than this are for the files.
        const MOST: usize = 12;
        say!("{}: {} of {} runs flown, {}", self.mission, self.flown, self.runs, self.rate);
        say!("\n{:<28} {:>11} {:>11} {:>11} {:>11} {:>11}", "figure", "min", "5 %", "median", "95 %", "max");
        for (name, _) in FIGURES {
            let Some(d) = self.figures.get(name) else { continue };
            let [min, p5, p50, p95, max] = [d.min, d.p5, d.p50, d.p95, d.max].map(short);
            say!("{name:<28} {min:>11} {p5:>11} {p50:>11} {p95:>11} {max:>11}");
        }
        if !self.points.is_empty() {
            say!();
        }
        let shown: Vec<String> = self.points.iter().take(MOST).map(|point| words(&point.swept)).collect();
        let width = shown.iter().map(String::len).max().unwrap_or(0);
        for (words, point) in shown.iter().zip(&self.points) {
            say!("{words:<width$}  {}", point.rate);
        }
        if self.points.len() > MOST {
            say!("and {} combinations more; --json FILE has all, with their figures", self.points.len() - MOST);
        }
        if !self.failures.is_empty() {
            say!("\nnot successful:");
        }
        for f in self.failures.iter().take(MOST) {
            let swept = if f.swept.is_empty() { String::new() } else { format!(", {}", words(&f.swept)) };
            say!("  run {} (seed {}{swept}): {}: {}", f.run, f.seed, f.outcome, f.reason);
        }
        if self.failures.len() > MOST {
            say!("  and {} more; --json FILE lists all", self.failures.len() - MOST);
        }
        if let Some(first) = self.failures.first() {
            say!("`fss campaign --out {} --run {}` flies one again, with its log", folder.display(), first.run);
        }
    }
}

impl Rate {
    fn of(rows: &[&Row]) -> Self {
        let (n, k) = (rows.len() as f64, rows.iter().filter(|row| row.success).count());
        // Wilson, E. B. (1927), with the 97.5 % quantile of the normal distribution.
        let (p, z) = (k as f64 / n, 1.959_964_f64);
        let (middle, half) = (p + z * z / (2.0 * n), z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt());
        let interval = [middle - half, middle + half].map(|end| (end / (1.0 + z * z / n)).clamp(0.0, 1.0));
        let any = !rows.is_empty();
        Self { succeeded: k, success_rate: any.then_some(p), success_interval: any.then_some(interval) }
    }
}

impl std::fmt::Display for Rate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.success_rate, self.success_interval) {
            (Some(rate), Some([low, high])) => {
                let [rate, low, high] = [rate, low, high].map(|share| 100.0 * share);
                write!(f, "{} successful: {rate:.1} % ({low:.1} to {high:.1} %)", self.succeeded)
            }
            _ => write!(f, "none yet"),
        }
    }
}

fn distributions(rows: &[&Row]) -> BTreeMap<&'static str, Distribution> {
    let of = |i: usize| Distribution::of(rows.iter().filter_map(|row| row.figures.get(i).copied().flatten()).collect());
    FIGURES.iter().enumerate().filter_map(|(i, (name, _))| of(i).map(|d| (*name, d))).collect()
}

impl Distribution {
    fn of(mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let (min, max) = (*values.first()?, *values.last()?);
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0).max(1.0);
        // Linear between the order statistics.
        let quantile = |share: f64| {
            let at = share * (n - 1.0);
            let (below, above) = (values[at.floor() as usize], values[at.ceil() as usize]);
            below + at.fract() * (above - below)
        };
        let [p5, p50, p95] = [0.05, 0.5, 0.95].map(quantile);
        Some(Self { count: values.len(), mean, std: variance.sqrt(), min, p5, p50, p95, max })
    }
}

fn words(swept: &BTreeMap<String, f64>) -> String {
    swept.iter().map(|(key, value)| format!("{key} = {}", short(*value))).collect::<Vec<_>>().join(", ")
}

/// Four digits that count.
fn short(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || (1e-3..1e5).contains(&size) {
        let digits = if value == 0.0 { 0 } else { (3 - size.log10().floor() as i32).max(0) as usize };
        format!("{value:.digits$}")
    } else {
        format!("{value:.3e}")
    }
}
