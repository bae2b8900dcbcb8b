//! `fss campaign`: one mission, many runs, each from its own seed and with its own values of the plant or the mission.
//!
//! A campaign lives in a folder: what it varies (`campaign.toml` and the files beside it), a journal for each shard, to
//! which every finished run adds a line, and in `runs/` the shard's table as Parquet, made from the journal. So a campaign that was
//! killed goes on with the runs that no journal has.

mod definition;
mod journal;
mod pieces;
mod row;
mod slurm;
mod statistics;
mod sweep;

use crate::challenge::parse_seeds;
use clap::Args;
use definition::{Campaign, TABLES, Wanted};
use fss_launcher::files::write_silently;
use fss_records::table::{HAS_PARQUET, TableError};
use fss_report::flown::fly_fast;
use fss_service::stop_on_signal;
use indicatif::{ProgressBar, ProgressStyle};
use journal::Journal;
use miette::{IntoDiagnostic, Result, miette};
pub use pieces::{begin, fly_one, write_rows};
use rayon::prelude::*;
use row::{Row, fly};
use statistics::Statistics;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;
use sweep::Sweep;

/// Fly a mission with many seeds, or over values of its plant, and count how often it succeeds.
///
/// Runs are as those of `fss run --fast`: the same seed and files give the same figures. They are flown on all cores,
/// without logs; --run repeats one with its log. A campaign that was stopped or killed goes on where it was:
/// `fss campaign --out DIR`.
#[derive(Args)]
#[command(after_help = "\
Examples:
  fss campaign capture --seeds 1..101 --out out/captures
  fss campaign zero-reaction --sweep laboratory.base.mass_kg=9..11:9 --seeds 1..21 --out out/masses
  fss campaign zero-reaction --sweep laboratory.effect.table_tilt.accel_x_m_s2=0,0.0005,0.001 --out out/tilts
  fss campaign --out out/captures                 go on where it was stopped
  fss campaign --out out/captures --run 17        one run again, with its log, in out/captures/run-17")]
pub struct CampaignArgs {
    /// A mission that comes with fss, or a mission file; where absent that of the campaign in DIR, or else zero-reaction.
    mission: Option<String>,
    /// Folder of the campaign.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Seeds from A to B, B not included; seed 1 where absent.
    #[arg(long, value_name = "A..B", value_parser = parse_seeds)]
    seeds: Option<Range<u64>>,
    /// Vary a value: KEY=FROM..TO:COUNT in equal steps, or KEY=A,B,C. Given several times, all combinations are flown, each
    /// with all seeds. KEY is the way to the value in the plant file (base.mass_kg, link.2.length_m, counted from 1), in
    /// the laboratory's, of which the services know nothing (laboratory.base.mass_kg, laboratory.effect.thruster_gain.3.scale),
    /// or in the mission file (mission.phase.line.duration_s).
    #[arg(long, value_name = "KEY=VALUES")]
    sweep: Vec<Sweep>,
    /// Plant file: the vehicle and its laboratory.
    #[arg(long, value_name = "FILE")]
    plant: Option<PathBuf>,
    /// Plant file of the simulated laboratory, where it is to be another than the one that the services believe in.
    #[arg(long, value_name = "FILE")]
    laboratory: Option<PathBuf>,
    /// Launch file: rates and services.
    #[arg(long, value_name = "FILE")]
    launch: Option<PathBuf>,
    /// Fly only every N-th run from the I-th on, so that N machines share the campaign in one folder.
    #[arg(long, value_name = "I/N", default_value = "1/1")]
    shard: Shard,
    /// Fly this run again and keep its log, summary and picture in DIR/run-NUMBER.
    #[arg(long, value_name = "NUMBER", conflicts_with = "shard")]
    run: Option<u64>,
    /// Write a Slurm array script that flies the campaign in this many shards, to DIR/campaign.sbatch, and fly nothing.
    #[arg(long, value_name = "SHARDS", conflicts_with_all = ["shard", "run"])]
    slurm: Option<u64>,
    /// Write success rate, figures of merit and failures as JSON here.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Show no progress.
    #[arg(long)]
    quiet: bool,
}

/// Which runs of a campaign a process flies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 1.
    number: u64,
    count: u64,
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parsed {
            Some((number, count)) if (1..=count).contains(&number) => Ok(Self { number, count }),
            _ => Err("write I/N with I from 1 to N, such as 2/8".to_owned()),
        }
    }
}

impl Shard {
    /// Whether it flies the run of this number: one after the other in turn, so that all shards take as long.
    fn has(self, run: u64) -> bool {
        run % self.count == self.number % self.count
    }

    /// The name of its files.
    fn name(self) -> String {
        format!("shard-{}-of-{}", self.number, self.count)
    }
}

/// Runs the command.
pub fn run(args: &CampaignArgs) -> Result<()> {
    let campaign = opened(args)?;
    if let Some(number) = args.run {
        return again(&campaign, number);
    }
    if let Some(shards) = args.slurm {
        return slurm::write(&campaign, shards);
    }
    let interrupted = fly_shard(&campaign, args.shard, args.quiet)?;
    let rows = journal::read_all(&campaign.folder)?;
    let rows: Vec<&Row> = rows.values().filter(|row| row.run <= campaign.count()).collect();
    let statistics = Statistics::of(&campaign, &rows);
    statistics.print(&campaign.folder);
    if let Some(path) = &args.json {
        write_silently(path, &serde_json::to_string_pretty(&statistics).into_diagnostic()?)?;
    }
    if interrupted {
        let go_on = format!("`fss campaign --out {}` goes on", campaign.folder.display());
        return Err(miette!(help = go_on, "stopped after {} of {} runs", rows.len(), campaign.count()));
    }
    Ok(())
}

/// The campaign that lies in the folder, where nothing else is asked for; else the one that is asked for.
fn opened(args: &CampaignArgs) -> Result<Campaign> {
    let asks = args.mission.is_some() || args.seeds.is_some() || !args.sweep.is_empty();
    let files = [&args.plant, &args.laboratory, &args.launch];
    if !asks && files.iter().all(|file| file.is_none()) && Campaign::lies_in(&args.out) {
        return Campaign::open(&args.out);
    }
    if args.seeds.is_none() && args.sweep.is_empty() {
        return Err(miette!(
            help = "give --seeds 1..101, or --sweep base.mass_kg=9..11:5, or the --out of a campaign to go on with",
            "nothing says what this campaign varies, and {} holds none",
            args.out.display()
        ));
    }
    Campaign::begin(&Wanted {
        mission: args.mission.as_deref().unwrap_or("zero-reaction"),
        seeds: args.seeds.clone().unwrap_or(1..2),
        sweep: &args.sweep,
        plant: args.plant.as_deref(),
        laboratory: args.laboratory.as_deref(),
        launch: args.launch.as_deref(),
        folder: &args.out,
    })
}

/// Flies what is left of a shard and writes its table; true where it was interrupted.
fn fly_shard(campaign: &Campaign, shard: Shard, quiet: bool) -> Result<bool> {
    if !HAS_PARQUET {
        let path = campaign.folder.join(TABLES);
        return Err(TableError::WithoutParquet { path }).into_diagnostic();
    }
    let journal = Journal::open(&campaign.folder, &shard.name())?;
    let mut flown = journal::read_all(&campaign.folder)?;
    let left: Vec<u64> = (1..=campaign.count()).filter(|run| shard.has(*run) && !flown.contains_key(run)).collect();
    let stop = stop_on_signal()?;
    let bar = progress_bar(left.len() as u64, quiet);
    let outcomes: Result<Vec<Option<Row>>> = left
        .par_iter()
        .with_max_len(1)
        .map(|&run| {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let row = fly(campaign, run)?;
            journal.add(&row)?;
            bar.inc(1);
            Ok(Some(row))
        })
        .collect();
    bar.finish_and_clear();
    let new = outcomes?.into_iter().flatten().map(|row| (row.run, row));
    flown.extend(new);
    let own: BTreeMap<u64, Row> = flown.into_iter().filter(|(run, _)| shard.has(*run)).collect();
    row::write_table(campaign, own.values(), &campaign.folder.join(TABLES).join(shard.name() + ".parquet"))?;
    Ok(stop.load(Ordering::Relaxed))
}

fn progress_bar(runs: u64, quiet: bool) -> ProgressBar {
    if quiet || runs == 0 {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(runs);
    if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {pos} of {len} runs, {elapsed} gone, {eta} to go") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

/// One run again, with its log; it must come to the same figures.
fn again(campaign: &Campaign, number: u64) -> Result<()> {
    let (seed, stack) = campaign.stack(number)?;
    let folder = campaign.folder.join(format!("run-{number}"));
    let mut words = vec![format!("seed {seed}")];
    words.extend(campaign.point(number).iter().map(ToString::to_string));
    say!("run {number}: {}", words.join(", "));
    let summary = fly_fast(&stack, &folder, seed)?;
    let flown = journal::read_all(&campaign.folder)?;
    let Some(before) = flown.get(&number) else { return Ok(()) };
    let now = Row::of(campaign, number, &summary, 0.0);
    if now.figures != before.figures || now.outcome != before.outcome {
        return Err(miette!(
            help = "another build of fss flew the campaign; `fss log info` and `fss compare` tell of logs",
            "run {number} came to other figures than in the campaign"
        ));
    }
    say!("as in the campaign: every figure to the last bit");
    Ok(())
}
