//! `fss diagnose`: where the simulation is wrong, what causes it, and what knowing it is worth.

pub mod answer;
pub mod log;
mod page;
pub mod runs;
mod summary;

use answer::Answer;
use clap::Args;
use fss_diagnosis::diagnose;
use fss_diagnosis::diagnosis::Diagnosis;
use fss_experiments::measured::Run;
use fss_launcher::files::{TextFile, write};
use fss_plant::Plant;
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::path::PathBuf;
use std::time::Duration;

/// Name of the extended plant file beside the report.
const EXTENDED: &str = "extended.toml";

/// Find what the simulation of a plant gets wrong about measured runs: where, why, and what knowing it gains.
///
/// Looks for the causes of what is wrong among the effects that a plant can have, and writes the extended plant, diagnosis.json and diagnosis.html to DIR.
#[derive(Args)]
pub struct DiagnoseArgs {
    /// Measured runs: folders in the format fss-experiment/1, or logs of `fss run`.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Runs kept for measuring the gain only.
    #[arg(long, num_args = 1.., value_name = "RUN")]
    validate: Vec<PathBuf>,
    /// Plant file: what the laboratory believes.
    #[arg(long, value_name = "FILE")]
    plant: PathBuf,
    /// Folder for the report and the extended plant.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write the answer as JSON here too.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &DiagnoseArgs) -> Result<()> {
    let bar = progress();
    let found = found(args, &|what| bar.set_message(what.to_owned()));
    bar.finish_and_clear();
    tell(args, &found?)
}

/// Runs the command for a caller that shows in its own way how far it is: `say` is told.
pub fn run_telling(args: &DiagnoseArgs, say: &(dyn Fn(&str) + Sync)) -> Result<()> {
    tell(args, &found(args, say)?)
}

/// The diagnosis, and the runs that it fitted.
fn found(args: &DiagnoseArgs, say: &(dyn Fn(&str) + Sync)) -> Result<(Diagnosis, Vec<Run>)> {
    let file = TextFile::read(&args.plant, "plant file")?;
    let plant = Plant::parse(&file.text).map_err(|e| file.error(e.message, e.help, Some(e.span)))?;
    let fitted = runs::read(&args.runs, &plant)?;
    let validation = runs::read(&args.validate, &plant)?;
    let diagnosis = diagnose(&plant, &fitted, &validation, say).into_diagnostic()?;
    if diagnosis.before.is_empty() && diagnosis.validation_before.is_empty() {
        return Err(nothing_to_simulate(&fitted));
    }
    Ok((diagnosis, fitted))
}

/// Says the answer and writes its files.
fn tell(args: &DiagnoseArgs, (diagnosis, fitted): &(Diagnosis, Vec<Run>)) -> Result<()> {
    summary::print(diagnosis);

    std::fs::create_dir_all(&args.out)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot make {}", args.out.display()))?;
    let term = if diagnosis.laws.is_empty() {
        ""
    } else {
        "# No known effect explains the rest: what is called unmodelled is empirical.\n"
    };
    let extended = format!(
        "# Made by fss diagnose from {}: uncertain values as the data settle them, and the causes asserted.\n{term}{}",
        args.plant.display(),
        diagnosis.extended.to_toml().into_diagnostic()?
    );
    let json = serde_json::to_string_pretty(&Answer::of(diagnosis, EXTENDED)).into_diagnostic()?;
    write(&args.out.join(EXTENDED), &extended)?;
    write(&args.out.join("diagnosis.json"), &json)?;
    write(&args.out.join("diagnosis.html"), &page::render(diagnosis, fitted))?;
    args.json.iter().try_for_each(|path| write(path, &json))
}

fn nothing_to_simulate(runs: &[Run]) -> miette::Report {
    let names: Vec<&str> = runs.iter().map(|r| r.name.as_str()).collect();
    miette!(
        help = "a floating base needs base_pose.csv; a clamped arm needs angles and rates of all joints in joints.csv, and their currents where drivers moved it; \
                and a run has to last a second or more",
        "none of the runs ({}) has a channel that can be simulated",
        names.join(", ")
    )
}

fn progress() -> ProgressBar {
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed} {msg}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}
