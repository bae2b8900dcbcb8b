//! Simulation-based calibration of the diagnosis: cases drawn from the priors that it states, and what it says of them.
//!
//! Where prior, likelihood and search are those of the cases, the rank of a true value in its posterior is uniform, and what
//! has the probability p acts in a share p of all cases.

mod case;
mod statistics;

use case::Case;
use fss_plant::Plant;
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, Result, miette};
use serde::Serialize;
use statistics::Statistics;
use std::num::NonZero;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{available_parallelism, scope};
use std::time::{Duration, Instant};

/// What the benchmark found.
#[derive(Serialize)]
pub(crate) struct Calibration {
    format: &'static str,
    seed: u64,
    runs_per_case: u64,
    run_s: f64,
    /// Cases whose masses or inertias no mechanism can have; they are left out.
    impossible: usize,
    #[serde(flatten)]
    statistics: Statistics,
    wall_time_s: f64,
}

/// Diagnoses so many cases, one a thread.
pub(crate) fn measure(cases: u64, seed: u64) -> Result<Calibration> {
    let start = Instant::now();
    let plant = plant()?;
    let bar = progress_bar(cases);
    let outcomes = diagnosed(&plant, cases, seed, &bar)?;
    bar.finish_and_clear();
    let count = outcomes.len();
    let possible: Vec<Case> = outcomes.into_iter().flatten().collect();
    Ok(Calibration {
        format: "fss-bench-calibration/1",
        seed,
        runs_per_case: case::RUNS,
        run_s: case::RUN_S,
        impossible: count - possible.len(),
        statistics: Statistics::of(&possible),
        wall_time_s: start.elapsed().as_secs_f64(),
    })
}

/// The laboratory's base without its arm. Its tank never empties: the diagnosis does not know of the mass that is used.
fn plant() -> Result<Plant> {
    let mut plant = Plant::default_laboratory().into_diagnostic()?;
    plant.links.clear();
    (plant.tank, plant.battery, plant.target) = (None, None, None);
    Ok(plant)
}

/// All cases in the order of their numbers; `None` is one that no mechanism can have.
fn diagnosed(plant: &Plant, cases: u64, seed: u64, bar: &ProgressBar) -> Result<Vec<Option<Case>>> {
    let next = AtomicU64::new(0);
    let work = || -> Result<Vec<(u64, Option<Case>)>> {
        // What a case does in parallel stays on its thread.
        let own = rayon::ThreadPoolBuilder::new().num_threads(1).build().into_diagnostic()?;
        let mut done = Vec::new();
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= cases {
                return Ok(done);
            }
            done.push((number, own.install(|| case::run(plant, seed, number))?));
            bar.inc(1);
        }
    };
    let threads = available_parallelism().map_or(1, NonZero::get);
    let of_threads: Vec<_> = scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        workers.into_iter().map(std::thread::ScopedJoinHandle::join).collect()
    });
    let mut all = Vec::new();
    for of_thread in of_threads {
        all.extend(of_thread.map_err(|_| miette!("a case ended in a panic"))??);
    }
    all.sort_by_key(|(number, _)| *number);
    Ok(all.into_iter().map(|(_, case)| case).collect())
}

fn progress_bar(cases: u64) -> ProgressBar {
    let bar = ProgressBar::new(cases);
    if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {pos} of {len} cases, {elapsed} gone, {eta} to go") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

impl Calibration {
    /// The table for a person.
    pub(crate) fn print(&self) {
        let s = &self.statistics;
        say!(
            "{} cases of {} runs of {} s, seed {}, in {:.0} s; {} more were impossible",
            s.cases,
            self.runs_per_case,
            self.run_s,
            self.seed,
            self.wall_time_s,
            self.impossible
        );
        say!("causes drawn        {}, of which {} were asserted, by name or as an alternative", s.drawn, s.recovered);
        say!(
            "asserted            {}: {} by name, {} as an alternative, {} wrong",
            s.asserted,
            s.right_by_name,
            s.right_as_alternative,
            s.wrong
        );
        say!("nothing hidden      {} cases, {} of them with a name", s.null_cases, s.null_cases_with_name);
        let ranks = &s.ranks;
        let bins: Vec<String> = ranks.histogram.iter().map(ToString::to_string).collect();
        say!("ranks               {} values, in tenths: {}", ranks.count, bins.join(" "));
        say!(
            "uniformity          Kolmogorov-Smirnov D {}, p-value {}",
            told(ranks.kolmogorov_smirnov_d, 3),
            told(ranks.p_value, 3)
        );
        say!("90 % intervals      cover a share of {}", told(ranks.coverage_90, 3));
        say!();
        say!("{:<24} {:>6} {:>8} {:>8}", "inclusion probability", "count", "mean", "acts");
        for bin in &s.reliability {
            let (mean, frequency) = (told(bin.mean_probability, 3), told(bin.frequency, 3));
            say!("{:.1} to {:<17.1} {:>6} {mean:>8} {frequency:>8}", bin.from, bin.to, bin.count);
        }
        say!("expected calibration error {}, from 0.1 on", told(s.expected_calibration_error, 3));
        say!("drawn causes that are not told, below 0.01: {}", s.drawn_untold);
    }
}

/// A number in so many digits, or a dash where there is none.
fn told(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}
