//! Commands of the program, run in this process: the same code with the same arguments, so the same answers to the last bit.

use crate::error::from_report;
use crate::job;
use clap::{Args, Command, FromArgMatches, Subcommand};
use fss_launcher::console;
use fss_report::calibrate::{self, CalibrateCommand};
use fss_report::diagnose::{self, DiagnoseArgs};
use fss_report::workspace::{self, WorkspaceArgs};
use fss_trials::campaign;
use fss_trials::next_experiment::{self, NextExperimentArgs};
use miette::{IntoDiagnostic, Result, miette};
use pyo3::prelude::*;
use std::path::PathBuf;

/// Runs a command with arguments as a shell would give them, and gives the words that it would have printed. What it tells of
/// its progress goes to `progress`.
#[pyfunction]
#[pyo3(signature = (name, arguments, progress=None))]
pub(crate) fn command(
    py: Python<'_>,
    name: String,
    arguments: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    job::run(py, progress, move |teller| {
        let (done, words) = console::collecting(|| match name.as_str() {
            "diagnose" => {
                let args = args_of::<DiagnoseArgs>(&arguments)?;
                diagnose::run_telling(&args, &|words| teller.say(None, words))
            }
            "calibrate" => calibrate::run(&subcommand_of::<CalibrateCommand>(&arguments)?),
            "workspace" => workspace::run(&args_of::<WorkspaceArgs>(&arguments)?),
            "next-experiment" => next_experiment::run(&args_of::<NextExperimentArgs>(&arguments)?),
            other => Err(miette!("there is no command '{other}'")),
        });
        done.map(|()| words)
    })
}

fn args_of<T: Args + FromArgMatches>(arguments: &[String]) -> Result<T> {
    parsed(T::augment_args(Command::new("fss").no_binary_name(true)), arguments)
}

fn subcommand_of<T: Subcommand + FromArgMatches>(arguments: &[String]) -> Result<T> {
    parsed(T::augment_subcommands(Command::new("fss").no_binary_name(true)), arguments)
}

fn parsed<T: FromArgMatches>(command: Command, arguments: &[String]) -> Result<T> {
    let matches = command.try_get_matches_from(arguments).into_diagnostic()?;
    T::from_arg_matches(&matches).into_diagnostic()
}

/// Begins a campaign in a folder, or finds the same one there; gives how many runs it has.
#[pyfunction]
pub(crate) fn campaign_begin(py: Python<'_>, arguments: Vec<String>) -> PyResult<u64> {
    let begun = py.detach(|| args_of(&arguments).and_then(|args| campaign::begin(&args)));
    begun.map_err(|report| from_report(&report))
}

/// Flies one run of the campaign in a folder; gives its line of a journal, and the same as a JSON object with the table's names.
#[pyfunction]
pub(crate) fn campaign_run(py: Python<'_>, folder: PathBuf, run: u64) -> PyResult<(String, String)> {
    let (line, object) = job::run(py, None, move |_| campaign::fly_one(&folder, run))?;
    Ok((line, object.to_string()))
}

/// Writes rows into a journal and a table of the campaign in a folder; gives the table's path.
#[pyfunction]
pub(crate) fn campaign_write(py: Python<'_>, folder: PathBuf, name: String, rows: Vec<String>) -> PyResult<PathBuf> {
    py.detach(|| campaign::write_rows(&folder, &name, &rows)).map_err(|report| from_report(&report))
}
