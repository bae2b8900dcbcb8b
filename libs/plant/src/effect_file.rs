//! Effects in the plant file: read, checked against the plant, written.

use serde::ser::{Serialize, SerializeMap, Serializer};
use toml::de::{DeTable, DeValue};

use crate::effect::{Effect, EffectError};
use crate::effects;
use crate::error::Fault;
use crate::file::Plant;
use crate::kind::{Index, Place};

impl Effect {
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
