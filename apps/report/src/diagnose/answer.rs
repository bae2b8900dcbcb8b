//! The answer as JSON, `fss-diagnosis/1`: written by `fss diagnose`, and read by what goes on from it.
//!
//! What is missing in a file has its default, but for causes, their effects, values and probabilities. A figure of the misfit that is
//! not finite is written as `null` and read as NaN; a cause without a number for its value or probability is refused.

mod of_diagnosis;

use fss_plant::Effect;
use miette::{IntoDiagnostic, Result, WrapErr};
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the parameter that says when an effect begins, s.
pub const ONSET: &str = "onset_s";

/// A diagnosis.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Answer {
    /// `fss-diagnosis/1`.
    #[serde(default)]
    pub format: String,
    /// `consistent`, `explained`, `partly_explained` or `unexplained`.
    #[serde(default)]
    pub verdict: String,
    /// What is asserted, strongest first.
    pub causes: Vec<Cause>,
    /// Each channel of each run with the plant file.
    #[serde(default)]
    pub misfit: Vec<Misfit>,
    /// What the extended model gains.
    #[serde(default)]
    pub gain: Gain,
    /// File name of the extended plant, beside the answer.
    #[serde(default)]
    pub extended_model: String,
    /// What was left out of the records, and what is not as the plant file says of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
    /// What happened once.
    #[serde(default)]
    pub events: Vec<Event>,
    /// Probable causes that are not asserted.
    #[serde(default)]
    pub suspects: Vec<Cause>,
    /// Inclusion probabilities.
    #[serde(default)]
    pub posterior: Posterior,
    /// Strengths of the structured discrepancy.
    #[serde(default)]
    pub discrepancy: Vec<Discrepancy>,
    /// Laws in the extended model that are no known effect's. Not read again: the extended model has them.
    #[serde(skip_deserializing, skip_serializing_if = "Vec::is_empty")]
    pub empirical: Vec<Effect>,
}

/// Which effect, and where it acts.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EffectName {
    /// Its id.
    pub effect: String,
    /// Which thruster, link or joint, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub index: Option<usize>,
    /// Which data stream.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel: Option<String>,
}

/// Values by name; [`ONSET`] is among them where the effect begins during a run.
pub type Parameters = BTreeMap<String, Parameter>;

/// A value and its standard deviation.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Parameter {
    /// The value.
    pub value: f64,
    /// Its standard deviation, where it was fitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub std: Option<f64>,
}

/// A cause.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Cause {
    /// What it is.
    #[serde(flatten)]
    pub name: EffectName,
    /// Probability that it, or what is equivalent to it, acts.
    pub probability: f64,
    /// Probability that it or any of its alternatives acts.
    #[serde(default, deserialize_with = "number")]
    pub class_probability: f64,
    /// Its values.
    #[serde(default)]
    pub parameters: Parameters,
    /// What else it could be.
    #[serde(default)]
    pub alternatives: Vec<Alternative>,
    /// What it adds to the logarithm of the predictive density of the validation runs, nats.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub validation_nats: Option<f64>,
    /// The same of each fitted run, predicted from the others.
    #[serde(default, deserialize_with = "number")]
    pub left_out_nats: f64,
}

/// Another effect that could stand in a cause's place.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Alternative {
    /// What it is.
    #[serde(flatten)]
    pub name: EffectName,
    /// Its probability.
    pub probability: f64,
    /// Whether the data cannot tell it from the cause at all.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub equivalent: bool,
    /// Its values.
    #[serde(default)]
    pub parameters: Parameters,
}

/// RMS error of a channel in one run, and what noise alone would give.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Misfit {
    /// The channel.
    pub channel: String,
    /// The run.
    pub run: String,
    /// RMS error in the channel's unit.
    #[serde(deserialize_with = "number")]
    pub rms: f64,
    /// What the stated noise alone would give.
    #[serde(deserialize_with = "number")]
    pub noise: f64,
    /// One over the other.
    #[serde(deserialize_with = "number")]
    pub ratio: f64,
}

/// RMS over noise on the validation runs; on the fitted ones where there are none.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Gain {
    /// With the plant file.
    pub ratio_before: Option<f64>,
    /// With the extended model.
    pub ratio_after: Option<f64>,
    /// What noise alone would give.
    #[serde(deserialize_with = "number")]
    pub noise_floor: f64,
}

/// What happened once.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Event {
    /// `pulse_not_delivered`.
    pub kind: String,
    /// The run.
    pub run: String,
    /// The thruster that was commanded, from 1.
    pub thruster: usize,
    /// When the command begins, s.
    pub from_s: f64,
    /// When it ends, s.
    pub to_s: f64,
    /// How sure that is.
    #[serde(deserialize_with = "number")]
    pub probability: f64,
}

/// Probabilities of all that was considered.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Posterior {
    /// Probability that no cause acts.
    #[serde(deserialize_with = "number")]
    pub none: f64,
    /// Share of its typical size by which a cause varies from run to run.
    #[serde(deserialize_with = "number")]
    pub run_to_run: f64,
    /// Inclusion probabilities.
    pub inclusion: Vec<Alternative>,
}

/// Strength of a structured discrepancy.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Discrepancy {
    /// What acts, with its unit.
    pub name: String,
    /// As inferred with the asserted causes.
    #[serde(deserialize_with = "number")]
    pub inferred: f64,
    /// As expected of a good laboratory.
    #[serde(deserialize_with = "number")]
    pub expected: f64,
}

/// A number; `null` is not a number.
fn number<'de, D: Deserializer<'de>>(value: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(value)?.unwrap_or(f64::NAN))
}

impl Answer {
    /// Reads a file.
    ///
    /// # Errors
    /// Names the file that is missing or no diagnosis.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot read {}: did fss diagnose write it?", path.display()))?;
        serde_json::from_str(&text).into_diagnostic().wrap_err_with(|| format!("cannot understand {}", path.display()))
    }
}

impl EffectName {
    /// The effect with these values.
    fn effect(&self, parameters: &Parameters) -> Result<Effect> {
        let mut effect = Effect::new(&self.effect).into_diagnostic()?;
        if let Some(index) = self.index {
            effect = effect.at(index);
        }
        if let Some(channel) = &self.channel {
            effect = effect.on(channel);
        }
        for (name, parameter) in parameters {
            if name == ONSET {
                effect = effect.from_onset(parameter.value);
            } else {
                effect.set(name, parameter.value).into_diagnostic()?;
            }
        }
        Ok(effect)
    }
}

impl Cause {
    /// The effect with its values.
    ///
    /// # Errors
    /// Where the catalogue has no such effect or parameter.
    pub fn effect(&self) -> Result<Effect> {
        self.name.effect(&self.parameters)
    }
}

impl Alternative {
    /// The effect with its values.
    ///
    /// # Errors
    /// Where the catalogue has no such effect or parameter.
    pub fn effect(&self) -> Result<Effect> {
        self.name.effect(&self.parameters)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_in_a_file_or_null_has_its_default() {
        let text = r#"{ "causes": [ { "effect": "thruster_gain", "index": 3, "probability": 0.9, "unknown": [],
            "parameters": { "scale": { "value": 0.7 }, "onset_s": { "value": 4 } },
            "alternatives": [ { "effect": "clock_offset", "channel": "mocap", "probability": 0.1, "equivalent": true } ] } ],
            "misfit": [ { "channel": "gyro", "rms": null, "noise": 1.0, "ratio": null } ], "gain": { "ratio_before": null } }"#;
        let answer: Answer = serde_json::from_str(text).unwrap();
        let effect = answer.causes[0].effect().unwrap();
        assert_eq!((effect.id(), effect.index(), effect.onset_s()), ("thruster_gain", Some(3), Some(4.0)));
        assert!(answer.causes[0].alternatives[0].equivalent);
        let refused = text.replace("0.7", "null");
        assert!(serde_json::from_str::<Answer>(&refused).is_err(), "a cause without a value is no cause");
        assert!(answer.misfit[0].rms.is_nan() && answer.gain.ratio_before.is_none() && answer.verdict.is_empty());
    }
}
