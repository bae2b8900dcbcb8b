//! Effects in plain words and numbers, and the sealed envelope that holds them.

use fss_plant::Effect;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A hidden effect smaller than this shows nowhere: whatever is said of it would be a guess.
pub(super) const VISIBLE_EFFECT_SIZE: f64 = 0.1;
/// From this size on an effect must be found.
pub(super) const CLEAR_EFFECT_SIZE: f64 = 2.0;

/// What kind of secret a seed has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Kind {
    /// Nothing is hidden.
    None,
    /// One effect of the catalogue.
    One,
    /// Two effects of the catalogue.
    Two,
    /// Something that the catalogue does not have.
    Outside,
}

/// An effect in plain words and numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Record {
    /// Its id.
    pub effect: String,
    /// Which thruster, link or joint, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub index: Option<usize>,
    /// Which data stream.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel: Option<String>,
    /// When it begins, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub onset_s: Option<f64>,
    /// Its values by name.
    pub parameters: BTreeMap<String, f64>,
}

impl Record {
    /// Of an effect.
    pub(super) fn of(effect: &Effect) -> Self {
        let names = effect.about().parameters.iter().map(|p| p.name.to_owned());
        Self {
            effect: effect.id().to_owned(),
            index: effect.index(),
            channel: effect.channel().map(str::to_owned),
            onset_s: effect.onset_s(),
            parameters: names.zip(effect.values().iter().copied()).collect(),
        }
    }

    /// Whether two are the same cause, whatever their size. Two exchanged valves have no order.
    pub(super) fn is_same_cause(&self, other: &Self) -> bool {
        if self.effect == "valve_swap" && other.effect == "valve_swap" {
            let pair = |r: &Self| {
                let own = r.index.unwrap_or(0);
                let other = r.parameters.get("other_index").map_or(0, |i| *i as usize);
                (own.min(other), own.max(other))
            };
            return pair(self) == pair(other);
        }
        self.effect == other.effect && self.index == other.index && self.channel == other.channel
    }
}

impl std::fmt::Display for Record {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.effect)?;
        if let Some(index) = self.index {
            write!(f, " {index}")?;
        }
        if let Some(channel) = &self.channel {
            write!(f, " of {channel}")?;
        }
        let values: Vec<_> = self.parameters.iter().map(|(name, value)| format!("{name} {}", short(*value))).collect();
        if !values.is_empty() {
            write!(f, " ({})", values.join(", "))?;
        }
        self.onset_s.map_or(Ok(()), |onset_s| write!(f, " from {onset_s:.1} s"))
    }
}

/// Four significant digits.
pub(super) fn short(value: f64) -> String {
    let digits = if value == 0.0 { 0 } else { (3 - value.abs().log10().floor() as i32).clamp(0, 9) };
    format!("{value:.0$}", digits as usize)
}

/// Whether a parameter only shapes an effect whose size is another parameter.
pub(super) fn is_shape(name: &str) -> bool {
    matches!(name, "other_index" | "rest_rad" | "anchor_x_m" | "anchor_y_m" | "velocity_rad_s" | "cycles_per_rev")
}

/// One hidden effect.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct HiddenEffect {
    /// What it is.
    #[serde(flatten)]
    pub record: Record,
    /// Values at which it would do nothing.
    pub nominal: BTreeMap<String, f64>,
    /// RMS of what it does to the sensor channel that shows most of it, over noise and room air.
    #[serde(rename = "dose")]
    pub effect_size: f64,
    /// The same after the plant's uncertain values have taken off what they can within two standard deviations.
    #[serde(rename = "dose_beyond_tolerance")]
    pub effect_size_beyond_tolerance: f64,
    /// Whether these experiments can tell it from every other effect of the catalogue; asked of single effects with a
    /// clear effect size only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub is_separable: Option<bool>,
}

/// The sealed envelope.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Envelope {
    /// `fss-challenge-envelope/2`.
    pub format: String,
    /// The seed that all of this was drawn from.
    pub seed: u64,
    /// Whether the vehicle is the one of the plant file, not a drawn one.
    pub is_own_vehicle: bool,
    /// Number of its links.
    pub links: usize,
    /// How much is hidden.
    pub kind: Kind,
    /// What is hidden.
    pub effects: Vec<HiddenEffect>,
}

impl Envelope {
    /// The largest effect size that is hidden; 0 where nothing is.
    pub(super) fn largest_effect_size(&self) -> f64 {
        self.effects.iter().map(|effect| effect.effect_size_beyond_tolerance).fold(0.0, f64::max)
    }

    /// The smallest effect size that is hidden; infinite where nothing is.
    pub(super) fn smallest_effect_size(&self) -> f64 {
        self.effects.iter().map(|effect| effect.effect_size_beyond_tolerance).fold(f64::INFINITY, f64::min)
    }
}
