//! The plant file in TOML: its strict reader and its writer.

use serde::Deserialize;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::check;
use crate::effect::Effect;
use crate::error::{Fault, PlantError};
use crate::file::Plant;

/// The plant file that is used where none is given: the paper's laboratory.
pub const DEFAULT_PLANT: &str = include_str!("../../../deploy/etc/plants/fss.toml");

impl Plant {
    /// Reads a plant file.
    ///
    /// # Errors
    /// Text that is not TOML, keys that do not exist, values that no laboratory can have
    /// (a negative mass, a link on nothing) and effects that the catalogue does not know are
    /// refused, each with its place, the reason and what to do.
    pub fn parse(text: &str) -> Result<Self, PlantError> {
        let mut root = DeTable::parse(text).map_err(|e| from_toml(text, &e))?;
        let located = root.clone();
        let effect_tables = root.get_mut().remove("effect");
        let mut plant = Self::deserialize(toml::de::Deserializer::from(root)).map_err(|e| from_toml(text, &e))?;
        let place = |fault: Fault| {
            let span = locate(&located, &fault.path);
            PlantError::at(text, span, fault.message, fault.help)
        };
        check::values(&plant).map_err(place)?;
        if let Some(tables) = effect_tables {
            plant.effects = read_effects(tables.get_ref(), &plant).map_err(place)?;
        }
        Ok(plant)
    }

    /// The laboratory that is used where no file is given.
    ///
    /// # Errors
    /// None as the project ships; the file is checked by the tests.
    pub fn default_laboratory() -> Result<Self, PlantError> {
        Self::parse(DEFAULT_PLANT)
    }

    /// Writes the plant as a file that [`Plant::parse`] reads back equal.
    ///
    /// # Errors
    /// When a value has no TOML form, which a parsed plant never has.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }
}

fn from_toml(text: &str, error: &toml::de::Error) -> PlantError {
    let message = error.message().lines().collect::<Vec<_>>().join("; ");
    let help = if message.starts_with("unknown field") {
        "the keys are described in deploy/etc/plants/fss.toml; check the spelling"
    } else if message.starts_with("missing field") {
        "add the key to this table"
    } else {
        "correct the value or the TOML syntax"
    };
    let span = error.span().unwrap_or(0..0);
    PlantError::at(text, span, message, help.to_owned())
}

fn read_effects(tables: &DeValue<'_>, plant: &Plant) -> Result<Vec<Effect>, Fault> {
    let Some(array) = tables.as_array() else {
        return Err(Fault::new("effect", "effects are an array of tables", "write [[effect]] with two brackets"));
    };
    let mut effects = Vec::new();
    for (i, value) in array.iter().enumerate() {
        let at = format!("effect/{i}");
        let table = value
            .get_ref()
            .as_table()
            .ok_or_else(|| Fault::new(&at, "an effect is a table", "write [[effect]] and its keys"))?;
        let effect = Effect::from_table(table)
            .and_then(|effect| effect.check(plant).map(|()| effect))
            .map_err(|fault| Fault { path: format!("{at}/{}", fault.path), ..fault })?;
        effects.push(effect);
    }
    Ok(effects)
}

/// Span of the value at `path`, or of the nearest table that exists.
fn locate(root: &Spanned<DeTable<'_>>, path: &str) -> Range<usize> {
    let mut span = 0..0;
    let mut parts = path.split('/').filter(|p| !p.is_empty());
    let Some(mut value) = parts.next().and_then(|key| root.get_ref().get(key)) else {
        return span;
    };
    span = value.span();
    for part in parts {
        let next = match value.get_ref() {
            DeValue::Table(table) => table.get(part),
            DeValue::Array(array) => part.parse::<usize>().ok().and_then(|i| array.get(i)),
            _ => None,
        };
        let Some(next) = next else { break };
        value = next;
        span = value.span();
    }
    span
}
