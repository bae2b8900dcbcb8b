//! Reads what `fss diagnose` wrote, `fss-diagnosis/1`.

use fss_plant::Effect;
use miette::{IntoDiagnostic, Result, WrapErr};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// A diagnosis, as far as others go on from it.
#[derive(Deserialize)]
pub struct Diagnosis {
    /// `consistent`, `explained`, `partly_explained` or `unexplained`.
    #[serde(default)]
    pub verdict: String,
    /// What is asserted, strongest first.
    pub causes: Vec<Cause>,
    /// What came nearest, where nothing is asserted.
    #[serde(default)]
    pub suspects: Vec<Cause>,
    /// What the extended model gains.
    #[serde(default)]
    pub gain: Gain,
}

/// RMS over the noise floor on the validation runs.
#[derive(Default, Deserialize)]
pub struct Gain {
    /// With the plant file.
    pub ratio_before: Option<f64>,
    /// With the extended model.
    pub ratio_after: Option<f64>,
}

/// Name of the parameter that says when an effect begins, s.
pub const ONSET: &str = "onset_s";

/// A cause, or another in its place.
#[derive(Deserialize)]
pub struct Cause {
    /// Its id.
    pub effect: String,
    /// Which thruster, link or joint, from 1.
    pub index: Option<usize>,
    /// Which data stream.
    pub channel: Option<String>,
    /// How sure the diagnosis is.
    pub probability: f64,
    /// Its values by name.
    #[serde(default)]
    pub parameters: BTreeMap<String, Parameter>,
    /// What else it could be.
    #[serde(default)]
    pub alternatives: Vec<Self>,
}

/// A value and its standard deviation.
#[derive(Deserialize)]
pub struct Parameter {
    /// The value.
    pub value: f64,
    /// Its standard deviation, where it was fitted.
    pub std: Option<f64>,
}

/// Reads a file.
///
/// # Errors
/// Names the file that is missing or no diagnosis.
pub fn read(path: &Path) -> Result<Diagnosis> {
    let text = std::fs::read_to_string(path)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot read {}: did fss diagnose write it?", path.display()))?;
    serde_json::from_str(&text).into_diagnostic().wrap_err_with(|| format!("cannot understand {}", path.display()))
}

impl Cause {
    /// The effect with these values.
    ///
    /// # Errors
    /// Where the catalogue has no such effect or parameter.
    pub fn effect(&self) -> Result<Effect> {
        let mut effect = Effect::new(&self.effect).into_diagnostic()?;
        if let Some(index) = self.index {
            effect = effect.at(index);
        }
        if let Some(channel) = &self.channel {
            effect = effect.on(channel);
        }
        for (name, parameter) in &self.parameters {
            if name == ONSET {
                effect = effect.from_onset(parameter.value);
            } else {
                effect.set(name, parameter.value).into_diagnostic()?;
            }
        }
        Ok(effect)
    }
}
