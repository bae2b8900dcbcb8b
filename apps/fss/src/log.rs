//! `fss log`: what a log holds.

use clap::{Args, Subcommand};
use fss_messages::{Event, text_of, topic};
use fss_records::log::{Log, TopicInfo};
use miette::{IntoDiagnostic, Result, WrapErr};
use serde::Serialize;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::PathBuf;

/// Commands on a log.
#[derive(Subcommand)]
pub enum LogCommand {
    /// Show topics, counts and rates, and what happened.
    Info(InfoArgs),
    /// Write every topic as a table.
    Export(ExportArgs),
}

/// What to export.
#[derive(Args)]
pub struct ExportArgs {
    /// The log, an MCAP file.
    log: PathBuf,
    /// Folder for one CSV file a topic, /nav/state as nav.state.csv.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// What to show.
#[derive(Args)]
pub struct InfoArgs {
    /// The log, an MCAP file.
    log: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Runs a command on a log.
pub fn run(command: &LogCommand) -> Result<()> {
    match command {
        LogCommand::Info(args) => info(args),
        LogCommand::Export(args) => export(args),
    }
}

#[derive(Serialize)]
struct Info {
    complete: bool,
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
    let info = Info {
        complete: log.is_complete(),
        topics: log.topics().into_diagnostic()?.into_iter().map(Into::into).collect(),
    };
    if args.json {
        println!("{}", serde_json::to_string_pretty(&info).into_diagnostic()?);
        return Ok(());
    }
    println!("{:<24} {:<28} {:>8} {:>10}", "topic", "schema", "count", "rate Hz");
    for t in &info.topics {
        let rate = t.rate_hz.map_or_else(|| "-".to_owned(), |r| format!("{r:.2}"));
        println!("{:<24} {:<28} {:>8} {:>10}", t.topic, t.schema, t.count, rate);
    }
    let start_ns = info.topics.iter().map(|t| t.first_ns).min().unwrap_or(0);
    for event in log.samples::<Event>(topic::EVENTS.name).into_diagnostic()? {
        let severity =
            ["debug", "info", "warning", "error", "critical"].get(usize::from(event.severity)).unwrap_or(&"?");
        let t_s = event.stamp_ns.saturating_sub(start_ns) as f64 * 1e-9;
        println!("{t_s:>10.3} s  {severity:<8} {:<10} {}", text_of(&event.service), text_of(&event.text));
    }
    if !info.complete {
        println!("the log was cut off: what follows its last whole chunk is missing");
    }
    Ok(())
}

fn export(args: &ExportArgs) -> Result<()> {
    let log = Log::open(&args.log).into_diagnostic()?;
    std::fs::create_dir_all(&args.out)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot make {}", args.out.display()))?;
    for topic in log.topics().into_diagnostic()? {
        let path = args.out.join(topic.topic.trim_matches('/').replace('/', ".") + ".csv");
        let file = File::create(&path).into_diagnostic().wrap_err_with(|| format!("cannot make {}", path.display()))?;
        let mut file = BufWriter::new(file);
        log.write_csv(&topic.topic, &mut file).into_diagnostic()?;
        file.flush().into_diagnostic().wrap_err_with(|| format!("cannot write {}", path.display()))?;
        println!("{} ({} messages)", path.display(), topic.count);
    }
    Ok(())
}
