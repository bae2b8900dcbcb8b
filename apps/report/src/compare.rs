//! `fss compare`: where two logs differ, and by how much.

mod align;
mod series;

use clap::Args;
use fss_bus::launch::Launch;
use fss_records::log::Log;
use indicatif::HumanCount;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::Serialize;
use series::{Flight, Series};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Rows that are shown unless all are asked for.
const SHOWN: usize = 20;

/// Compare two logs: align their clocks, synchronise their samples, and tell the differences.
#[derive(Args)]
pub struct CompareArgs {
    /// The first log; its samples set the times.
    a: PathBuf,
    /// The second log; its samples are interpolated to these times.
    b: PathBuf,
    /// What the clocks are aligned by: the begin of the mission, the first sample, nothing, or the time shift at which
    /// this field agrees best, as /nav/state.theta_rad.
    #[arg(long, default_value = "mission", value_name = "mission|start|none|FIELD")]
    align: String,
    /// Differences up to this are none, in the field's own unit.
    #[arg(long, default_value_t = 0.0, value_name = "X")]
    absolute: f64,
    /// Besides, differences up to this share of the field's largest magnitude in A are none.
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    relative: f64,
    /// Absolute tolerance of a field instead: x_m=0.001, or /nav/state.x_m=0.001. Give it again for more.
    #[arg(long = "tolerance", value_name = "FIELD=X")]
    tolerances: Vec<String>,
    /// Compare only this topic or field: /nav/state, /nav/state.x_m, x_m. Give it again for more.
    #[arg(long = "only", value_name = "NAME")]
    only: Vec<String>,
    /// Show every field, not only the worst.
    #[arg(long)]
    all: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// How a field differs.
#[derive(Serialize)]
struct Row {
    /// Topic and field.
    name: String,
    /// Samples compared.
    count: usize,
    /// Samples of A within the time of both logs for which B has nothing near.
    without_counterpart: usize,
    /// Samples beyond the tolerance.
    beyond: usize,
    /// Root mean square of the difference.
    rms: f64,
    /// Largest difference, B less A.
    largest: f64,
    /// When that is, s since the logs' common zero.
    largest_at_s: f64,
    tolerance: f64,
    /// Largest magnitude of the field in A.
    magnitude: f64,
}

#[derive(Serialize)]
struct Answer {
    format: &'static str,
    same: bool,
    shift_s: f64,
    overlap_s: [f64; 2],
    only_in_a: Vec<String>,
    only_in_b: Vec<String>,
    fields: Vec<Row>,
}

/// Runs the command: 0 where all is within the tolerances, 1 where something is not, 2 where they cannot be compared.
pub fn run(args: &CompareArgs) -> ExitCode {
    match compare(args) {
        Ok(answer) if answer.same => ExitCode::SUCCESS,
        Ok(_) => ExitCode::from(1),
        Err(error) => {
            eprintln!("{error:?}");
            ExitCode::from(2)
        }
    }
}

fn read(path: &Path) -> Result<Flight> {
    let log = Log::open(path).into_diagnostic()?;
    let launch = log.attachment("launch.toml").into_diagnostic()?;
    let vehicle = launch.and_then(|text| Launch::of_run(&text).ok());
    let vehicle = vehicle.map_or_else(String::new, |launch| launch.vehicle);
    Flight::read(&log, &vehicle).into_diagnostic().wrap_err_with(|| format!("cannot compare {}", path.display()))
}

fn compare(args: &CompareArgs) -> Result<Answer> {
    let tolerances = args.tolerances.iter().map(|text| tolerance(text)).collect::<Result<Vec<_>>>()?;
    let (mut a, mut b) = (read(&args.a)?, read(&args.b)?);
    let shift_s = align::align(&mut a, &mut b, &args.align)?;
    let wanted = |series: &Series| args.only.is_empty() || args.only.iter().any(|name| series.is_called(name));
    let overlap_s = [a.span_s()[0].max(b.span_s()[0]), a.span_s()[1].min(b.span_s()[1])];
    if overlap_s[0] >= overlap_s[1] {
        let help = "--align start lets both begin together";
        return Err(miette!(help = help, "the two logs have no time in common"));
    }
    let missing = |from: &Flight, other: &Flight| {
        let lonely = from.series.iter().filter(|s| wanted(s) && other.named(&s.name()).is_none());
        lonely.map(Series::name).collect::<Vec<_>>()
    };
    let (only_in_a, only_in_b) = (missing(&a, &b), missing(&b, &a));
    let mut fields: Vec<Row> = a
        .series
        .iter()
        .filter(|series| wanted(series))
        .filter_map(|series| {
            let own = tolerances.iter().rfind(|(name, _)| series.is_called(name));
            let tolerance = own.map_or(args.absolute + args.relative * series.largest_magnitude(), |(_, x)| *x);
            Some(difference(series, b.named(&series.name())?, overlap_s, tolerance))
        })
        .collect();
    if fields.is_empty() {
        return Err(miette!("there is nothing to compare: no field is in both logs (and named by --only)"));
    }
    fields.sort_by(|x, y| severity(y).total_cmp(&severity(x)));
    let beyond = fields.iter().any(|row| row.beyond > 0 || row.without_counterpart > 0);
    let same = !beyond && only_in_a.is_empty() && only_in_b.is_empty();
    let answer = Answer { format: "fss-compare/1", same, shift_s, overlap_s, only_in_a, only_in_b, fields };
    if args.json {
        say!("{}", serde_json::to_string_pretty(&answer).into_diagnostic()?);
    } else {
        print(&answer, args.all);
    }
    Ok(answer)
}

fn tolerance(text: &str) -> Result<(&str, f64)> {
    let parsed = text.split_once('=').and_then(|(name, x)| Some((name.trim(), x.trim().parse().ok()?)));
    parsed.filter(|(_, x)| *x >= 0.0).ok_or_else(|| miette!("--tolerance {text}: give FIELD=X, as x_m=0.001"))
}

/// What comes first: fields beyond their tolerance, by how much for their size.
fn severity(row: &Row) -> f64 {
    let size = row.tolerance.max(1e-3 * row.magnitude).max(f64::MIN_POSITIVE);
    let excess = (row.largest.abs() / size).min(1e9);
    if row.beyond > 0 { 1e9 + excess } else { excess }
}

fn difference(a: &Series, b: &Series, overlap_s: [f64; 2], tolerance: f64) -> Row {
    let mut row = Row {
        name: a.name(),
        count: 0,
        without_counterpart: 0,
        beyond: 0,
        rms: 0.0,
        largest: 0.0,
        largest_at_s: 0.0,
        tolerance,
        magnitude: a.largest_magnitude(),
    };
    let mut sum = 0.0;
    for (time_s, value) in a.within(overlap_s) {
        let Some(other) = b.at(time_s) else {
            row.without_counterpart += 1;
            continue;
        };
        let differs_by = a.apart(value, other);
        row.count += 1;
        sum += differs_by * differs_by;
        // What is no number differs from every number, and not from itself.
        let beyond =
            if differs_by.is_nan() { !(value.is_nan() && other.is_nan()) } else { differs_by.abs() > tolerance };
        row.beyond += usize::from(beyond);
        if differs_by.abs() > row.largest.abs() || (beyond && differs_by.is_nan()) {
            (row.largest, row.largest_at_s) = (differs_by, time_s);
        }
    }
    row.rms = (sum / row.count.max(1) as f64).sqrt();
    row
}

fn print(answer: &Answer, all: bool) {
    let [from, to] = answer.overlap_s;
    say!(
        "compared over {:.3} s, from {from:.3} s to {to:.3} s; B's clock shifted by {:.6} s",
        to - from,
        answer.shift_s
    );
    let beyond = answer.fields.iter().filter(|row| row.beyond > 0).count();
    say!("{} of {} fields differ by more than their tolerance", beyond, answer.fields.len());
    let shown = answer.fields.iter().filter(|row| all || row.beyond > 0 || row.without_counterpart > 0);
    let limit = if all { usize::MAX } else { SHOWN };
    let mut shown = shown.peekable();
    if shown.peek().is_some() {
        say!("{:<36} {:>12} {:>10} {:>12} {:>12} {:>14}", "field", "largest", "at s", "rms", "tolerance", "beyond, of");
    }
    for row in shown.by_ref().take(limit) {
        say!(
            "{:<36} {:>12.3e} {:>10.3} {:>12.3e} {:>12.3e} {:>6} {:>7}",
            row.name,
            row.largest,
            row.largest_at_s,
            row.rms,
            row.tolerance,
            row.beyond,
            row.count
        );
        if row.without_counterpart > 0 {
            say!("{:<36} {} samples of A have none of B near them", "", row.without_counterpart);
        }
    }
    let rest = shown.count();
    if rest > 0 {
        say!("and {} more; --all shows every field", HumanCount(rest as u64));
    }
    for (log, names) in [("A", &answer.only_in_a), ("B", &answer.only_in_b)] {
        for name in names {
            say!("only in {log}: {name}");
        }
    }
}
