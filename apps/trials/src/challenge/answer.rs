//! What the diagnosis says.
//!
//! It is asked as a user asks it: `fss diagnose` in a process of its own, which gets the logs and the plant file and
//! answers in JSON. So no secret can leak to it.

use super::record::Record;
use fss_launcher::files::this_program;
use fss_report::diagnose::answer::{self as diagnosis, EffectName, ONSET, Parameters};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A cause that the diagnosis asserts.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Said {
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
pub(super) struct Alternative {
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
pub(super) struct Answer {
    /// `consistent`, `explained`, `partly_explained` or `unexplained`.
    pub verdict: String,
    /// Strongest first.
    pub causes: Vec<Said>,
    /// RMS over the noise floor on the validation run with the plant file; absent where it gives none.
    pub ratio_before: Option<f64>,
    /// The same with the extended model.
    pub ratio_after: Option<f64>,
}

fn record(name: &EffectName, parameters: &Parameters) -> Record {
    let values = parameters.iter().filter(|(name, _)| *name != ONSET);
    Record {
        effect: name.effect.clone(),
        index: name.index,
        channel: name.channel.clone(),
        onset_s: parameters.get(ONSET).map(|onset| onset.value),
        parameters: values.map(|(name, p)| (name.clone(), p.value)).collect(),
    }
}

fn deviations(parameters: &Parameters) -> BTreeMap<String, f64> {
    parameters.iter().filter_map(|(name, p)| Some((name.clone(), p.std?))).collect()
}

fn said(cause: &diagnosis::Cause) -> Said {
    let alternative = |other: &diagnosis::Alternative| Alternative {
        record: record(&other.name, &other.parameters),
        std: deviations(&other.parameters),
        probability: other.probability,
        is_equivalent: other.equivalent,
    };
    Said {
        record: record(&cause.name, &cause.parameters),
        std: deviations(&cause.parameters),
        probability: cause.probability,
        alternatives: cause.alternatives.iter().map(alternative).collect(),
    }
}

/// Asks for the diagnosis of logs, of which the last is kept for validation; its report is left in `folder`. `threads`
/// limits what it takes of the computer.
///
/// # Errors
/// Where the diagnosis fails, with what it said.
pub(super) fn answer(plant: &Path, logs: &[PathBuf], folder: &Path, threads: Option<usize>) -> Result<Answer> {
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
    written(&json)
}

/// Reads what the diagnosis wrote.
fn written(path: &Path) -> Result<Answer> {
    let diagnosis = diagnosis::Answer::read(path)?;
    Ok(Answer {
        causes: diagnosis.causes.iter().map(said).collect(),
        verdict: diagnosis.verdict,
        ratio_before: diagnosis.gain.ratio_before,
        ratio_after: diagnosis.gain.ratio_after,
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
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("diagnosis.json");
        std::fs::write(&path, text).unwrap();
        let answer = written(&path).unwrap();
        let said = &answer.causes[0];
        assert_eq!((said.record.onset_s, said.std["delay_s"]), (Some(4.0), 0.001));
        assert!(said.alternatives[0].is_equivalent && !said.alternatives[1].is_equivalent);
        assert_eq!(answer.ratio_after, None);
    }
}
