//! What the diagnosis says, in plain words and numbers.

use super::hidden::Record;
use fss_identify::measured::Run;
use fss_identify::misfit::{Windows, of_run};
use fss_plant::Plant;
use miette::{IntoDiagnostic, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

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

/// Asks the diagnosis.
///
/// # Errors
/// Where the plant is no mechanism.
pub fn answer(plant: &Plant, runs: &[Run], validation: &[Run]) -> Result<Answer> {
    let windows = Windows::suited_to(plant, runs);
    let mut ratios = Vec::new();
    for run in validation {
        ratios.extend(
            of_run(plant, run, windows).into_diagnostic()?.iter().map(fss_identify::misfit::ChannelMisfit::ratio),
        );
    }
    let ratio = (ratios.iter().map(|r| r * r).sum::<f64>() / ratios.len().max(1) as f64).sqrt();
    let verdict = if ratio > 1.3 { "unexplained" } else { "consistent" }.to_owned();
    Ok(Answer { verdict, causes: Vec::new(), ratio_before: ratio, ratio_after: ratio })
}
