//! `fss log`: what a log holds, as tables, and whole again where it was broken.

mod export;
mod perfetto;

use clap::{Args, Subcommand};
use fss_messages::{Event, text_of, topic};
use fss_records::log::{Damage, Log, TopicInfo};
use miette::{IntoDiagnostic, Result, miette};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Commands on a log.
#[derive(Subcommand)]
pub enum LogCommand {
    /// Show topics, counts and rates, and what happened.
    Info(InfoArgs),
    /// Write every topic as a table (CSV, Parquet or MATLAB), or the timeline of steps as a trace.
    Export(export::ExportArgs),
    /// Make a whole log of what a broken one still holds: all but the last second where its recorder was killed.
    Recover(RecoverArgs),
}

/// What to recover.
#[derive(Args)]
pub struct RecoverArgs {
    /// The log, an MCAP file that was cut off or damaged.
    log: PathBuf,
    /// The new log; where absent LOG with .recovered before its ending.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// What to show.
#[derive(Args)]
pub struct InfoArgs {
    /// The log, an MCAP file, or a run's folder.
    log: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Runs a command on a log.
pub fn run(command: &LogCommand) -> Result<()> {
    match command {
        LogCommand::Info(args) => info(args),
        LogCommand::Export(args) => export::run(args),
        LogCommand::Recover(args) => recover(args),
    }
}

#[derive(Serialize)]
struct Info {
    complete: bool,
    damaged_places: u64,
    damaged_bytes: u64,
    cut_off_bytes: u64,
    topics: Vec<TopicRow>,
}

#[derive(Serialize)]
struct TopicRow {
    topic: String,
    schema: String,
    count: u64,
    rate_hz: Option<f64>,
    first_ns: u64,
    last_ns: u64,
}

impl From<TopicInfo> for TopicRow {
    fn from(info: TopicInfo) -> Self {
        Self {
            rate_hz: info.rate_hz(),
            topic: info.topic,
            schema: info.schema,
            count: info.count,
            first_ns: info.first_ns,
            last_ns: info.last_ns,
        }
    }
}

fn info(args: &InfoArgs) -> Result<()> {
    let log = Log::open(&args.log).into_diagnostic()?;
    let (topics, damage) = log.survey().into_diagnostic()?;
    let Damage { places, bytes, cut_off_bytes } = damage;
    let info = Info {
        complete: log.is_complete(),
        damaged_places: places,
        damaged_bytes: bytes,
        cut_off_bytes,
        topics: topics.into_iter().map(Into::into).collect(),
    };
    if args.json {
        let json = serde_json::to_string_pretty(&info).into_diagnostic()?;
        say!("{json}");
        return Ok(());
    }
    let events = log.samples::<Event>(topic::EVENTS.name).into_diagnostic()?;
    print_info(&info, &events, &args.log);
    Ok(())
}

fn print_info(info: &Info, events: &[Event], path: &Path) {
    say!("{:<24} {:<28} {:>8} {:>10}", "topic", "schema", "count", "rate Hz");
    for t in &info.topics {
        let rate = t.rate_hz.map_or_else(|| "-".to_owned(), |r| format!("{r:.2}"));
        say!("{:<24} {:<28} {:>8} {:>10}", t.topic, t.schema, t.count, rate);
    }
    let start_ns = info.topics.iter().map(|t| t.first_ns).min().unwrap_or(0);
    for event in events {
        let severity =
            ["debug", "info", "warning", "error", "critical"].get(usize::from(event.severity)).unwrap_or(&"?");
        let t_s = event.stamp_ns.saturating_sub(start_ns) as f64 * 1e-9;
        say!("{t_s:>10.3} s  {severity:<8} {:<10} {}", text_of(&event.service), text_of(&event.text));
    }
    if info.damaged_places > 0 {
        say!("damaged in {} places: {} bytes cannot be read", info.damaged_places, info.damaged_bytes);
    }
    if !info.complete {
        let path = path.display();
        say!("the log was cut off or damaged at its end; `fss log recover {path}` makes a whole one");
    }
}

fn recover(args: &RecoverArgs) -> Result<()> {
    let out = args.out.clone().unwrap_or_else(|| args.log.with_extension("recovered.mcap"));
    if out.exists() {
        return Err(miette!(help = "name another with --out", "{} exists", out.display()));
    }
    let found = Log::open(&args.log).into_diagnostic()?.recover_to(&out).into_diagnostic()?;
    let span_s = (found.last_ns - found.first_ns) as f64 * 1e-9;
    let Damage { places, bytes, cut_off_bytes } = found.damage;
    say!(
        "{}: {} messages over {span_s:.2} s; {places} damaged places ({bytes} bytes), {cut_off_bytes} bytes of an unfinished record",
        out.display(),
        found.messages
    );
    Ok(())
}
