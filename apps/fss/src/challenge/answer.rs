//! What the diagnosis says.
//!
//! It is asked as a user asks it: `fss diagnose` in a process of its own, which gets the logs and the plant file and
//! answers in JSON. So no secret can leak to it.

use super::record::Record;
use crate::files::this_program;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name of the parameter that says when an effect begins, s.
const ONSET: &str = "onset_s";

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
    /// What else it could be.
    pub alternatives: Vec<Alternative>,
}

/// What could stand in the place of a cause.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Alternative {
    /// What it is.
    #[serde(flatten)]
    pub record: Record,
    /// Standard deviations of its values, where they are given.
    pub std: BTreeMap<String, f64>,
    /// How likely it is.
    pub probability: f64,
    /// Whether the data cannot tell it from the cause at all.
    pub is_equivalent: bool,
}

/// The answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Answer {
    /// `consistent`, `explained`, `partly_explained` or `unexplained`.
    pub verdict: String,
    /// Strongest first.
    pub causes: Vec<Said>,
    /// RMS over the noise floor on the validation run with the plant file; absent where it gives none.
    pub ratio_before: Option<f64>,
    /// The same with the extended model.
    pub ratio_after: Option<f64>,
}

/// `fss-diagnosis/1`, as far as a game reads it.
#[derive(Deserialize)]
struct DiagnosisFile {
    verdict: String,
    causes: Vec<CauseFile>,
    #[serde(default)]
    gain: GainFile,
}

#[derive(Default, Deserialize)]
struct GainFile {
    ratio_before: Option<f64>,
    ratio_after: Option<f64>,
}

#[derive(Deserialize)]
struct CauseFile {
    effect: String,
    index: Option<usize>,
    channel: Option<String>,
    probability: f64,
    #[serde(default)]
    equivalent: bool,
    #[serde(default)]
    parameters: BTreeMap<String, ParameterFile>,
    #[serde(default)]
    alternatives: Vec<Self>,
}

#[derive(Deserialize)]
struct ParameterFile {
    value: f64,
    std: Option<f64>,
}

impl CauseFile {
    fn record(&self) -> Record {
        let values = self.parameters.iter().filter(|(name, _)| *name != ONSET);
        Record {
            effect: self.effect.clone(),
            index: self.index,
            channel: self.channel.clone(),
            onset_s: self.parameters.get(ONSET).map(|onset| onset.value),
            parameters: values.map(|(name, p)| (name.clone(), p.value)).collect(),
        }
    }

    fn std(&self) -> BTreeMap<String, f64> {
        self.parameters.iter().filter_map(|(name, p)| Some((name.clone(), p.std?))).collect()
    }

    fn said(&self) -> Said {
        let alternative = |other: &Self| Alternative {
            record: other.record(),
            std: other.std(),
            probability: other.probability,
            is_equivalent: other.equivalent,
        };
        Said {
            record: self.record(),
            std: self.std(),
            probability: self.probability,
            alternatives: self.alternatives.iter().map(alternative).collect(),
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
    let text =
        std::fs::read_to_string(&json).into_diagnostic().wrap_err_with(|| format!("cannot read {}", json.display()))?;
    read(&text).wrap_err_with(|| format!("cannot understand {}", json.display()))
}

/// Reads what the diagnosis wrote.
fn read(text: &str) -> Result<Answer> {
    let file: DiagnosisFile = serde_json::from_str(text).into_diagnostic()?;
    Ok(Answer {
        causes: file.causes.iter().map(CauseFile::said).collect(),
        verdict: file.verdict,
        ratio_before: file.gain.ratio_before,
        ratio_after: file.gain.ratio_after,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn an_alternative_that_the_data_cannot_tell_apart_is_read_as_one() {
        let text = r#"{ "format": "fss-diagnosis/1", "verdict": "explained", "gain": { "noise_floor": 1.0 },
            "causes": [ { "effect": "mocap_latency", "probability": 0.6, "more": [],
                "parameters": { "delay_s": { "value": 0.03, "std": 0.001 }, "onset_s": { "value": 4 } },
                "alternatives": [ { "effect": "clock_offset", "channel": "mocap", "probability": 0.4, "equivalent": true },
                                  { "effect": "thruster_delay", "index": 2, "probability": 0.001 } ] } ] }"#;
        let answer = read(text).unwrap();
        let said = &answer.causes[0];
        assert_eq!((said.record.onset_s, said.std["delay_s"]), (Some(4.0), 0.001));
        assert!(said.alternatives[0].is_equivalent && !said.alternatives[1].is_equivalent);
        assert_eq!(answer.ratio_after, None);
    }
}
