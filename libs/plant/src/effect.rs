//! One effect with its values, as a plant file states it.

use crate::about::{About, MAX_PARAMETERS};

/// An effect with values: an `[[effect]]` table of a plant file.
#[derive(Clone)]
pub struct Effect {
    about: &'static About,
    pub(crate) index: Option<usize>,
    pub(crate) channel: Option<String>,
    pub(crate) description: Option<String>,
    pub(crate) onset_s: Option<f64>,
    values: [f64; MAX_PARAMETERS],
}

/// A use of an effect that the catalogue does not allow.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message} ({help})")]
pub struct EffectError {
    /// What is wrong.
    pub message: String,
    /// What to do about it.
    pub help: String,
}

impl Effect {
    /// An effect of a kind with its parameters' plain nominal values.
    pub(crate) fn described_as(about: &'static About) -> Self {
        let mut values = [0.0; MAX_PARAMETERS];
        for (value, parameter) in values.iter_mut().zip(about.parameters) {
            *value = parameter.nominal.unwrap_or(0.0);
        }
        Self { about, index: None, channel: None, description: None, onset_s: None, values }
    }

    /// The same on one thruster, link or joint, counted from 1 as in files and reports.
    #[must_use]
    pub fn at(mut self, index: usize) -> Self {
        self.index = Some(index);
        self
    }

    /// The same on a named data stream, or acting on a named channel.
    #[must_use]
    pub fn on(mut self, channel: &str) -> Self {
        self.channel = Some(channel.to_owned());
        self
    }

    /// The same with words for the report.
    #[must_use]
    pub fn described(mut self, description: &str) -> Self {
        self.description = Some(description.to_owned());
        self
    }

    /// The same, beginning `onset_s` after the start of the run.
    #[must_use]
    pub fn from_onset(mut self, onset_s: f64) -> Self {
        self.onset_s = Some(onset_s);
        self
    }

    /// The same with its first `values.len()` parameters replaced, in the catalogue's order.
    #[must_use]
    pub fn with(mut self, values: &[f64]) -> Self {
        let count = self.about().parameters.len();
        for (own, value) in self.values[..count].iter_mut().zip(values) {
            *own = *value;
        }
        self
    }

    /// Sets a parameter by name.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), EffectError> {
        let at = self.position(name).ok_or_else(|| EffectError {
            message: format!("{} has no parameter {name:?}", self.id()),
            help: format!("its parameters are: {}", self.parameter_names()),
        })?;
        self.values[at] = value;
        Ok(())
    }

    /// A parameter by name.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.position(name).map(|at| self.values[at])
    }

    /// The parameters' values, in the catalogue's order.
    pub fn values(&self) -> &[f64] {
        &self.values[..self.about().parameters.len()]
    }

    /// The first value, of those that have one.
    pub(crate) fn first(&self) -> f64 {
        self.values[0]
    }

    /// All values, unused ones 0.
    pub(crate) fn padded(&self) -> [f64; MAX_PARAMETERS] {
        self.values
    }

    /// Name, sentence, place, index and parameters.
    pub fn about(&self) -> &'static About {
        self.about
    }

    /// Name in plant files and reports.
    pub fn id(&self) -> &'static str {
        self.about().id
    }

    /// Which thruster, link or joint, from 1; `None` is all of them.
    pub fn index(&self) -> Option<usize> {
        self.index
    }

    /// Which data stream or channel.
    pub fn channel(&self) -> Option<&str> {
        self.channel.as_deref()
    }

    /// Words for the report.
    pub fn description(&self) -> Option<&str> {
        self.description.as_deref()
    }

    /// When it begins (s); `None` is from the start.
    pub fn onset_s(&self) -> Option<f64> {
        self.onset_s
    }

    /// In a line: the id, the index or channel, and the parameters with their values.
    pub fn in_words(&self) -> String {
        let index = self.index.map(|i| format!(" {i}")).unwrap_or_default();
        let channel = self.channel().map(|c| format!(" {c}")).unwrap_or_default();
        let named = self.about().parameters.iter().zip(self.values());
        // Four significant digits.
        let digits = |value: f64| (3.0 - value.abs().max(1e-9).log10().floor()).clamp(0.0, 9.0) as usize;
        let values: Vec<_> = named.map(|(p, value)| format!("{} {value:.*}", p.name, digits(*value))).collect();
        format!("{}{index}{channel}: {}", self.id(), values.join(", "))
    }

    /// Whether it acts at `t_s`.
    pub fn is_active(&self, t_s: f64) -> bool {
        self.onset_s.is_none_or(|onset| t_s >= onset)
    }

    /// Positions, from 0, that the effect acts on among `count`.
    pub(crate) fn targets(&self, count: usize) -> std::ops::Range<usize> {
        match self.index {
            Some(i) => i.saturating_sub(1).min(count)..i.min(count),
            None => 0..count,
        }
    }

    fn position(&self, name: &str) -> Option<usize> {
        self.about().parameters.iter().position(|p| p.name == name)
    }

    pub(crate) fn parameter_names(&self) -> String {
        let names: Vec<_> = self.about().parameters.iter().map(|p| p.name).collect();
        names.join(", ")
    }
}

impl PartialEq for Effect {
    fn eq(&self, other: &Self) -> bool {
        self.id() == other.id()
            && self.index == other.index
            && self.channel == other.channel
            && self.description == other.description
            && self.onset_s == other.onset_s
            && self.values == other.values
    }
}

impl std::fmt::Debug for Effect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{self}")
    }
}

/// As in reports: `thruster_gain 3 (scale 0.72)`.
impl std::fmt::Display for Effect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.id())?;
        if let Some(index) = self.index {
            write!(f, " {index}")?;
        }
        if let Some(channel) = &self.channel {
            write!(f, " of {channel}")?;
        }
        for (i, (p, v)) in self.about().parameters.iter().zip(self.values()).enumerate() {
            let open = if i == 0 { " (" } else { ", " };
            write!(f, "{open}{} {}", p.name, in_four_digits(*v))?;
        }
        if !self.about().parameters.is_empty() {
            write!(f, ")")?;
        }
        self.onset_s.map_or(Ok(()), |onset| write!(f, " from {} s", in_four_digits(onset)))
    }
}

/// As many digits as a person reads: no measurement has more.
fn in_four_digits(value: f64) -> f64 {
    let shift = 10.0_f64.powi(3 - value.abs().max(f64::MIN_POSITIVE).log10().floor() as i32);
    if shift.is_finite() { (value * shift).round() / shift } else { value }
}
