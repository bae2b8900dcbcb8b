//! `fss log export`: every topic as a table for other programs.

use clap::{Args, ValueEnum};
use fss_records::log::{Log, TopicInfo};
use fss_records::table::{CsvFile, MatlabFile, ParquetFile, Table, TableFile};
use miette::{IntoDiagnostic, Result, WrapErr};
use std::path::{Path, PathBuf};

/// Rows that are in memory at once; a MATLAB file needs a topic whole.
const ROWS: usize = 1 << 16;

/// What to export.
#[derive(Args)]
pub struct ExportArgs {
    /// The log, an MCAP file, or a run's folder.
    log: PathBuf,
    /// Folder for the tables.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// What is to read them.
    #[arg(long, value_enum, default_value_t = Format::Csv)]
    format: Format,
}

/// The formats.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// One CSV file a topic, /nav/state as nav.state.csv; arrays as columns q_rad.0, q_rad.1 and so on.
    Csv,
    /// One Parquet file a topic, with the same columns, for pandas, polars, DuckDB, R.
    Parquet,
    /// One MATLAB file, with a struct a topic: nav_state.x_m is a column vector, links_state.q_rad a matrix.
    Matlab,
    /// One trace of steps, deadlines, overruns and events, for <https://ui.perfetto.dev>.
    Perfetto,
}

/// Runs the command.
pub fn run(args: &ExportArgs) -> Result<()> {
    let log = Log::open(&args.log).into_diagnostic()?;
    let out = &args.out;
    std::fs::create_dir_all(out).into_diagnostic().wrap_err_with(|| format!("cannot make {}", out.display()))?;
    if args.format == Format::Perfetto {
        let path = out.join(args.log.file_stem().unwrap_or_else(|| "log".as_ref())).with_extension("perfetto.json");
        let steps = super::perfetto::write(&log, &path)?;
        say!("{} ({steps} steps)", path.display());
        return Ok(());
    }
    let topics = log.topics().into_diagnostic()?;
    if args.format == Format::Matlab {
        let name = args.log.file_stem().unwrap_or_else(|| "log".as_ref());
        return matlab(&log, &topics, &out.join(name).with_extension("mat"));
    }
    for topic in topics {
        let name = topic.topic.trim_matches('/').replace('/', ".");
        match args.format {
            Format::Parquet => stream::<ParquetFile>(&log, &topic, &out.join(name + ".parquet"))?,
            _ => stream::<CsvFile>(&log, &topic, &out.join(name + ".csv"))?,
        }
    }
    Ok(())
}

fn stream<F: TableFile>(log: &Log, topic: &TopicInfo, path: &Path) -> Result<()> {
    let mut file: Option<F> = None;
    let each = |table: &Table| {
        let mut open = file.take().map_or_else(|| F::create(path, table), Ok)?;
        open.append(table)?;
        file = Some(open);
        Ok(())
    };
    log.tables(&topic.topic, ROWS, each).into_diagnostic()?;
    file.map_or(Ok(()), TableFile::finish).into_diagnostic()?;
    say!("{} ({} messages)", path.display(), topic.count);
    Ok(())
}

fn matlab(log: &Log, topics: &[TopicInfo], path: &Path) -> Result<()> {
    let mut file = MatlabFile::create(path).into_diagnostic()?;
    for topic in topics {
        let name = topic.topic.trim_matches('/').replace('/', "_");
        log.tables(&topic.topic, usize::MAX, |table| file.append(&name, table)).into_diagnostic()?;
    }
    file.finish().into_diagnostic()?;
    say!("{} ({} messages)", path.display(), topics.iter().map(|topic| topic.count).sum::<u64>());
    Ok(())
}
