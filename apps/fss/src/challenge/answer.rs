//! What the diagnosis says.
//!
//! It is asked as a user asks it: `fss diagnose` in a process of its own, which gets the logs and the plant file and
//! answers in JSON. So no secret can leak to it.

use super::hidden::Record;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

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

/// `fss-diagnosis/1`, as far as it counts here.
#[derive(Deserialize)]
struct Diagnosis {
    verdict: String,
    causes: Vec<Cause>,
    gain: Gain,
}

#[derive(Deserialize)]
struct Gain {
    ratio_before: Option<f64>,
    ratio_after: Option<f64>,
}

#[derive(Deserialize)]
struct Cause {
    effect: String,
    index: Option<usize>,
    channel: Option<String>,
    onset_s: Option<f64>,
    probability: f64,
    #[serde(default)]
    parameters: BTreeMap<String, Value>,
    #[serde(default)]
    alternatives: Vec<Cause>,
}

#[derive(Deserialize)]
struct Value {
    value: f64,
    std: Option<f64>,
}

impl Cause {
    fn record(&self) -> Record {
        Record {
            effect: self.effect.clone(),
            index: self.index,
            channel: self.channel.clone(),
            onset_s: self.onset_s,
            parameters: self.parameters.iter().map(|(name, v)| (name.clone(), v.value)).collect(),
        }
    }

    fn said(&self) -> Said {
        Said {
            record: self.record(),
            std: self.parameters.iter().filter_map(|(name, v)| Some((name.clone(), v.std?))).collect(),
            probability: self.probability,
            alternatives: self.alternatives.iter().map(|a| (a.record(), a.probability)).collect(),
        }
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
    let program = std::env::current_exe().into_diagnostic().wrap_err("cannot find this program's file")?;
    let mut command = Command::new(program);
    command.arg("diagnose").args(fitted).arg("--validate").arg(validation);
    command.arg("--plant").arg(plant).arg("--out").arg(&out).arg("--json").arg(&json);
    if let Some(threads) = threads {
        command.env("RAYON_NUM_THREADS", threads.to_string());
    }
    let done = command.output().into_diagnostic().wrap_err("cannot start the diagnosis")?;
    if !done.status.success() {
        return Err(miette!("the diagnosis failed: {}", String::from_utf8_lossy(&done.stderr).trim()));
    }
    let text =
        std::fs::read_to_string(&json).into_diagnostic().wrap_err_with(|| format!("cannot read {}", json.display()))?;
    let diagnosis: Diagnosis = serde_json::from_str(&text)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot understand {}", json.display()))?;
    Ok(Answer {
        causes: diagnosis.causes.iter().map(Cause::said).collect(),
        verdict: diagnosis.verdict,
        ratio_before: diagnosis.gain.ratio_before.unwrap_or(f64::MAX),
        ratio_after: diagnosis.gain.ratio_after.unwrap_or(f64::MAX),
    })
}
