//! What a plant can have beyond the nominal model: the trait of an effect, and one effect with
//! its values as a plant file states it.

use serde::ser::{Serialize, SerializeMap, Serializer};
use toml::de::{DeTable, DeValue};

use crate::effects;
use crate::error::Fault;
use crate::file::Plant;
use crate::physics::Physics;

/// Most parameters that any effect has.
pub const MAX_PARAMETERS: usize = 4;

/// Where an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Place {
    /// Force or torque on the base, or acceleration of every body.
    Base,
    /// A mass, centre of mass or moment of inertia.
    Mass,
    /// Torque or geometry of a joint.
    Joint,
    /// A thruster.
    Thruster,
    /// What a sensor says.
    Sensor,
    /// When something is said or done.
    Time,
    /// Not in the catalogue.
    Unknown,
}

impl Place {
    /// The word for reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Base => "base",
            Self::Mass => "mass",
            Self::Joint => "joint",
            Self::Thruster => "thruster",
            Self::Sensor => "sensor",
            Self::Time => "time",
            Self::Unknown => "unknown",
        }
    }
}

/// What an effect's `index` counts, from 1. Without an index it is all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Index {
    /// The effect is there once.
    None,
    /// Thrusters.
    Thruster,
    /// Links.
    Link,
    /// Joints.
    Joint,
    /// Not a number: the name of a data stream, in `channel`.
    Channel,
}

impl Index {
    /// The word for reports and error messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Thruster => "thruster",
            Self::Link => "link",
            Self::Joint => "joint",
            Self::Channel => "channel",
        }
    }

    /// How many the plant has; 0 where the effect is there once.
    pub fn count(self, plant: &Plant) -> usize {
        match self {
            Self::None | Self::Channel => 0,
            Self::Thruster => plant.thrusters.len(),
            Self::Link | Self::Joint => plant.links.len(),
        }
    }
}

/// One parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Key in the plant file, ending with the unit.
    pub name: &'static str,
    /// Unit for people; empty is a pure number.
    pub unit: &'static str,
    /// What it is, for the documentation.
    pub meaning: &'static str,
    /// Value at which the effect does nothing; `None` is the plant's own value, which
    /// [`EffectKind::nominal`] knows.
    pub nominal: Option<f64>,
    /// Smallest value that makes sense.
    pub lower: f64,
    /// Largest value that makes sense.
    pub upper: f64,
    /// Typical size of a departure from nominal: the unit for searching and differencing.
    pub scale: f64,
}

impl Parameter {
    /// A parameter whose nominal value is 0, without bounds.
    pub const fn new(name: &'static str, unit: &'static str, meaning: &'static str) -> Self {
        Self { name, unit, meaning, nominal: Some(0.0), lower: f64::MIN, upper: f64::MAX, scale: 1.0 }
    }

    /// The same with another nominal value.
    #[must_use]
    pub const fn nominal(mut self, nominal: f64) -> Self {
        self.nominal = Some(nominal);
        self
    }

    /// The same, replacing a value of the plant.
    #[must_use]
    pub const fn of_plant(mut self) -> Self {
        self.nominal = None;
        self
    }

    /// The same with bounds.
    #[must_use]
    pub const fn within(mut self, lower: f64, upper: f64) -> Self {
        self.lower = lower;
        self.upper = upper;
        self
    }

    /// The same with a typical size.
    #[must_use]
    pub const fn scale(mut self, scale: f64) -> Self {
        self.scale = scale;
        self
    }
}

/// What a kind of effect is, without its action.
#[derive(Debug, Clone, Copy)]
pub struct About {
    /// Name in plant files and reports.
    pub id: &'static str,
    /// What it does, one sentence.
    pub sentence: &'static str,
    /// Where it acts.
    pub place: Place,
    /// What its index counts.
    pub index: Index,
    /// Its parameters, at most [`MAX_PARAMETERS`].
    pub parameters: &'static [Parameter],
}

/// A kind of effect: one file in `src/effects`, one line in the catalogue.
pub trait EffectKind: Sync {
    /// Name, sentence, place, index and parameters.
    fn about(&self) -> &'static About;

    /// Values at which the effect changes nothing, in the order of the parameters. `index` counts
    /// from 0; without one, the first.
    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let _ = (plant, index);
        let mut values = [0.0; MAX_PARAMETERS];
        for (value, parameter) in values.iter_mut().zip(self.about().parameters) {
            *value = parameter.nominal.unwrap_or(0.0);
        }
        values
    }

    /// Builds the effect into what really acts.
    fn act(&self, effect: &Effect, physics: &mut Physics);
}

/// An effect with values: an `[[effect]]` table of a plant file.
#[derive(Clone)]
pub struct Effect {
    kind: &'static dyn EffectKind,
    index: Option<usize>,
    channel: Option<String>,
    description: Option<String>,
    onset_s: Option<f64>,
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
    /// The effect `id` with its parameters at their plain nominal values, on all indices, from the start.
    pub fn new(id: &str) -> Result<Self, EffectError> {
        let kind = effects::find(id)
            .ok_or_else(|| EffectError { message: format!("there is no effect {id:?}"), help: suggestion(id) })?;
        Ok(Self::of(kind))
    }

    /// An effect of `kind` with its parameters' plain nominal values.
    pub fn of(kind: &'static dyn EffectKind) -> Self {
        let mut values = [0.0; MAX_PARAMETERS];
        for (value, parameter) in values.iter_mut().zip(kind.about().parameters) {
            *value = parameter.nominal.unwrap_or(0.0);
        }
        Self { kind, index: None, channel: None, description: None, onset_s: None, values }
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

    /// The same with every parameter at the value that changes nothing in `plant`.
    #[must_use]
    pub fn nominal(mut self, plant: &Plant) -> Self {
        self.values = self.kind.nominal(plant, self.index.map(|i| i.saturating_sub(1)));
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

    /// The kind.
    pub fn kind(&self) -> &'static dyn EffectKind {
        self.kind
    }

    /// Name, sentence, place, index and parameters.
    pub fn about(&self) -> &'static About {
        self.kind.about()
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

    /// When it begins [s]; `None` is from the start.
    pub fn onset_s(&self) -> Option<f64> {
        self.onset_s
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

    fn parameter_names(&self) -> String {
        let names: Vec<_> = self.about().parameters.iter().map(|p| p.name).collect();
        names.join(", ")
    }

    /// Whether `plant` can have this effect: its index exists and its values are within bounds.
    ///
    /// # Errors
    /// Says what is wrong and what to do.
    pub fn validate(&self, plant: &Plant) -> Result<(), EffectError> {
        self.check(plant).map_err(|fault| EffectError { message: fault.message, help: fault.help })
    }

    /// Refuses an index that the plant does not have and values outside of their bounds.
    pub(crate) fn check(&self, plant: &Plant) -> Result<(), Fault> {
        let about = self.about();
        let count = about.index.count(plant);
        match (about.index, self.index) {
            (Index::None | Index::Channel, Some(_)) => {
                return Err(Fault::new("index", format!("{} takes no index", about.id), "remove the key"));
            }
            (_, Some(i)) if i == 0 || i > count => {
                return Err(Fault::new(
                    "index",
                    format!("there is no {} {i}, the plant has {count}", about.index.name()),
                    "indices count from 1",
                ));
            }
            _ => {}
        }
        if about.index == Index::Channel && about.id == "clock_offset" {
            let known = effects::STREAMS;
            if !self.channel().is_some_and(|c| known.contains(&c)) {
                return Err(Fault::new(
                    "channel",
                    "clock_offset needs the name of a data stream",
                    format!("channel is one of: {}", known.join(", ")),
                ));
            }
        }
        for (parameter, value) in about.parameters.iter().zip(self.values()) {
            if !(parameter.lower..=parameter.upper).contains(value) {
                return Err(Fault::new(
                    parameter.name,
                    format!(
                        "{} of {} is {value}, outside of {} to {}",
                        parameter.name, about.id, parameter.lower, parameter.upper
                    ),
                    parameter.meaning,
                ));
            }
        }
        if let Some(onset) = self.onset_s
            && !(onset.is_finite() && onset >= 0.0)
        {
            return Err(Fault::new(
                "onset_s",
                format!("onset_s is {onset}, it must be a time in the run"),
                "give the seconds from the start of the run",
            ));
        }
        self.check_partner(count)
    }

    /// `other_index` of a swap names a second, different one.
    fn check_partner(&self, count: usize) -> Result<(), Fault> {
        let Some(other) = self.get("other_index") else {
            return Ok(());
        };
        let exists = other.fract() == 0.0 && other >= 1.0 && other <= count as f64;
        if exists && self.index.is_some_and(|own| own as f64 != other) {
            return Ok(());
        }
        Err(Fault::new(
            "other_index",
            format!("{} needs two different indices of 1 to {count}", self.id()),
            "give index and other_index, whole numbers",
        ))
    }

    /// Reads an `[[effect]]` table.
    pub(crate) fn from_table(table: &DeTable<'_>) -> Result<Self, Fault> {
        let id = table
            .get("id")
            .and_then(|v| v.get_ref().as_str())
            .ok_or_else(|| Fault::new("", "an effect needs its id", "add id = \"table_tilt\" or another"))?;
        let mut effect = Self::new(id).map_err(|e| Fault::new("id", e.message, e.help))?;
        let mut given = 0;
        for (key, value) in table {
            let (key, value) = (key.get_ref().as_ref(), value.get_ref());
            match key {
                "id" => {}
                "index" => effect.index = Some(whole(key, value)?),
                "onset_s" => effect.onset_s = Some(number(key, value)?),
                "channel" if effect.about().index == Index::Channel => {
                    effect.channel = Some(text(key, value)?);
                }
                "description" if effect.about().place == Place::Unknown => {
                    effect.description = Some(text(key, value)?);
                }
                _ => {
                    let value = number(key, value)?;
                    given += 1;
                    effect.set(key, value).map_err(|e| Fault::new(key, e.message, e.help))?;
                }
            }
        }
        if given == 0 && effect.about().place != Place::Unknown {
            return Err(Fault::new(
                "id",
                format!("{id} is given without any of its parameters"),
                format!("its parameters are: {}", effect.parameter_names()),
            ));
        }
        Ok(effect)
    }
}

fn number(key: &str, value: &DeValue<'_>) -> Result<f64, Fault> {
    let parsed = match value {
        DeValue::Float(float) => float.as_str().parse::<f64>().ok(),
        DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|i| i as f64),
        _ => None,
    };
    parsed
        .filter(|v| v.is_finite())
        .ok_or_else(|| Fault::new(key, format!("{key} must be a finite number"), "give a number"))
}

fn whole(key: &str, value: &DeValue<'_>) -> Result<usize, Fault> {
    value
        .as_integer()
        .and_then(|i| usize::from_str_radix(i.as_str(), i.radix()).ok())
        .filter(|i| *i > 0)
        .ok_or_else(|| Fault::new(key, format!("{key} must be 1, 2, .."), "indices count from 1"))
}

fn text(key: &str, value: &DeValue<'_>) -> Result<String, Fault> {
    value.as_str().map(str::to_owned).ok_or_else(|| Fault::new(key, format!("{key} must be text"), "put it in quotes"))
}

/// The known ids that share the most with a misspelt one.
fn suggestion(id: &str) -> String {
    let pairs = |s: &str| -> Vec<(u8, u8)> { s.as_bytes().windows(2).map(|w| (w[0], w[1])).collect() };
    let wanted = pairs(id);
    let closest = effects::catalogue()
        .iter()
        .map(|kind| {
            let known = kind.about().id;
            let own = pairs(known);
            let shared = own.iter().filter(|p| wanted.contains(p)).count();
            (2 * shared * 1000 / (own.len() + wanted.len()).max(1), known)
        })
        .max();
    match closest {
        Some((likeness, known)) if likeness > 500 => format!("did you mean {known}?"),
        _ => "docs/effects.md lists them all".to_owned(),
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
            write!(f, "{open}{} {v}", p.name)?;
        }
        if !self.about().parameters.is_empty() {
            write!(f, ")")?;
        }
        self.onset_s.map_or(Ok(()), |onset| write!(f, " from {onset} s"))
    }
}

impl Serialize for Effect {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("id", self.id())?;
        if let Some(index) = self.index {
            map.serialize_entry("index", &index)?;
        }
        if let Some(channel) = &self.channel {
            map.serialize_entry("channel", channel)?;
        }
        if let Some(description) = &self.description {
            map.serialize_entry("description", description)?;
        }
        if let Some(onset) = self.onset_s {
            map.serialize_entry("onset_s", &onset)?;
        }
        for (parameter, value) in self.about().parameters.iter().zip(self.values()) {
            map.serialize_entry(parameter.name, value)?;
        }
        map.end()
    }
}
