//! An estimate told: as a table for a person, as JSON for a machine.

use fss_calibrate::Estimate;
use serde_json::{Map, Value, json};

/// Quantiles of the normal distribution for intervals of 90 and 95 percent.
const QUANTILE_90: f64 = 1.6449;
const QUANTILE_95: f64 = 1.96;

/// A kind of observation: its key in JSON, its name for a person, and the unit that a person reads.
#[derive(Clone, Copy)]
pub struct Kind {
    key: &'static str,
    name: &'static str,
    scale: f64,
    unit: &'static str,
}

impl Kind {
    /// Told in mm.
    pub const fn meters(key: &'static str, name: &'static str) -> Self {
        Self { key, name, scale: 1e3, unit: "mm" }
    }

    /// Told in degrees.
    pub const fn radians(key: &'static str, name: &'static str) -> Self {
        Self { key, name, scale: 180.0 / std::f64::consts::PI, unit: "deg" }
    }

    /// Told as it is.
    pub const fn plain(key: &'static str, name: &'static str, unit: &'static str) -> Self {
        Self { key, name, scale: 1.0, unit }
    }
}

/// The table.
pub fn print(estimate: &Estimate, kinds: &[Kind]) {
    if !estimate.parameters.is_empty() {
        say!("\n{:<30}{:>12}{:>12}{:>28}", "parameter", "value", "std", "95 % interval");
    }
    for p in &estimate.parameters {
        let half = estimate.half_width(p.std, QUANTILE_95);
        let interval = format!("{:.5} .. {:.5}", p.value - half, p.value + half);
        say!("{:<30}{:>12.5}{:>12.5}{interval:>28}", p.name, p.value, p.std);
    }
    say!();
    for (kind, std) in kinds.iter().zip(&estimate.residual_std).filter(|(_, std)| **std > 0.0) {
        say!("residuals     {:.4} {} RMS, {}", std * kind.scale, kind.unit, kind.name);
    }
    say!("rank          {} of {}", estimate.rank, estimate.unknowns);
    if estimate.condition.is_finite() {
        say!("condition     {:.1}", estimate.condition);
    }
    if !estimate.rejected.is_empty() {
        say!("outliers      {} instants left out", estimate.rejected.len());
    }
    if !estimate.undetermined.is_empty() {
        say!("\nThis data cannot determine {}; they stay as they were:", estimate.undetermined_parameters.join(", "));
        for line in &estimate.undetermined {
            say!("  {line}");
        }
    }
}

/// The answer for a machine.
pub fn json(kind: &str, estimate: &Estimate, kinds: &[Kind]) -> Value {
    let mut parameters = Map::new();
    for p in &estimate.parameters {
        let interval = |quantile: f64| {
            let half = estimate.half_width(p.std, quantile);
            [p.value - half, p.value + half]
        };
        let entry = json!({ "value": p.value, "std": p.std,
            "interval_90": interval(QUANTILE_90), "interval_95": interval(QUANTILE_95) });
        parameters.insert(p.name.clone(), entry);
    }
    let each = |values: &[f64]| -> Map<String, Value> {
        kinds.iter().zip(values).map(|(kind, value)| (kind.key.to_owned(), json!(value))).collect()
    };
    json!({ "format": "fss-calibration/1", "kind": kind, "parameters": parameters,
        "residual_std": each(&estimate.residual_std), "noise": each(&estimate.noise),
        "rank": estimate.rank, "unknowns": estimate.unknowns,
        "condition": estimate.condition.is_finite().then_some(estimate.condition),
        "degrees_of_freedom": estimate.degrees_of_freedom, "outliers": estimate.rejected.len(),
        "undetermined": estimate.undetermined, "undetermined_parameters": estimate.undetermined_parameters })
}
