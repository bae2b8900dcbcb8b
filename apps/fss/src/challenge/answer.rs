//! What the diagnosis says.
//!
//! It is asked as a user asks it: `fss diagnose` in a process of its own, which gets the logs and the plant file and
//! answers in JSON. So no secret can leak to it.

use super::hidden::Record;
use crate::diagnose::read::{Cause, ONSET, read};
use crate::files::this_program;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A cause that the diagnosis asserts.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Said {
    /// What it is.
    #[serde(flatten)]
    pub record: Record,
    /// Standard deviations of its values.
    pub std: BTreeMap<String, f64>,
    /// How sure it is.
    pub probability: f64,
    /// What else it could be, and how likely.
    pub alternatives: Vec<(Record, f64)>,
}

/// The answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Answer {
    /// `consistent`, `explained`, `partly_explained` or `unexplained`.
    pub verdict: String,
    /// Strongest first.
    pub causes: Vec<Said>,
    /// RMS over the noise floor on the validation run with the plant file, and with the extended model.
    pub ratio_before: f64,
    /// See `ratio_before`.
    pub ratio_after: f64,
}

fn record(cause: &Cause) -> Record {
    Record {
        effect: cause.effect.clone(),
        index: cause.index,
        channel: cause.channel.clone(),
        onset_s: cause.parameters.get(ONSET).map(|onset| onset.value),
        parameters: cause
            .parameters
            .iter()
            .filter(|(name, _)| *name != ONSET)
            .map(|(name, p)| (name.clone(), p.value))
            .collect(),
    }
}

fn said(cause: &Cause) -> Said {
    Said {
        record: record(cause),
        std: cause.parameters.iter().filter_map(|(name, p)| Some((name.clone(), p.std?))).collect(),
        probability: cause.probability,
        alternatives: cause.alternatives.iter().map(|other| (record(other), other.probability)).collect(),
    }
}

/// Asks for the diagnosis of logs, of which the last is kept for validation; its report is left in `folder`. `threads`
/// limits what it takes of the computer.
///
/// # Errors
/// Where the diagnosis fails, with what it said.
pub fn answer(plant: &Path, logs: &[PathBuf], folder: &Path, threads: Option<usize>) -> Result<Answer> {
    let (validation, fitted) = logs.split_last().ok_or_else(|| miette!("there is no log to diagnose"))?;
    let out = folder.join("diagnosis");
    let json = folder.join("diagnosis.json");
    let mut command = this_program();
    command.arg("diagnose").args(fitted).arg("--validate").arg(validation);
    command.arg("--plant").arg(plant).arg("--out").arg(&out).arg("--json").arg(&json);
    if let Some(threads) = threads {
        command.env("RAYON_NUM_THREADS", threads.to_string());
    }
    let done = command.output().into_diagnostic().wrap_err("cannot start the diagnosis")?;
    if !done.status.success() {
        return Err(miette!("the diagnosis failed: {}", String::from_utf8_lossy(&done.stderr).trim()));
    }
    let diagnosis = read(&json)?;
    Ok(Answer {
        causes: diagnosis.causes.iter().map(said).collect(),
        verdict: diagnosis.verdict,
        ratio_before: diagnosis.gain.ratio_before.unwrap_or(f64::MAX),
        ratio_after: diagnosis.gain.ratio_after.unwrap_or(f64::MAX),
    })
}
