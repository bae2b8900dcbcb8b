//! What the launch file says: the FMU, and which of its variables are which fields of which topics.

use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{Definition, Field, Sample, Scalar};
use serde::Deserialize;
use std::path::PathBuf;

/// `config` of the service's table.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The FMU; a path that is not absolute is taken from the folder in which `fss` is started.
    pub fmu: PathBuf,
    /// What the FMU reads.
    #[serde(default)]
    pub input: Vec<Input>,
    /// What it says.
    pub output: Vec<Output>,
    /// Values of its parameters, in its own units.
    #[serde(default)]
    pub parameters: toml::Table,
    /// Where an input is older, the FMU is not stepped and nothing is published, ms.
    #[serde(default = "default_max_age_ms")]
    pub max_age_ms: u64,
}

/// A field of a topic that an input variable of the FMU follows.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// The variable.
    pub variable: String,
    /// The topic, without the vehicle's name.
    pub topic: String,
    /// Its field, `q_rad[0]` for the first of several.
    pub field: String,
}

/// A field of a topic that an output variable gives, or a constant.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Output {
    /// The variable.
    #[serde(default)]
    pub variable: Option<String>,
    /// The constant.
    #[serde(default)]
    pub value: Option<f64>,
    /// The topic, without the vehicle's name.
    pub topic: String,
    /// Its field.
    pub field: String,
}

const fn default_max_age_ms() -> u64 {
    200
}

/// One number of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    scalar: Scalar,
    offset: usize,
}

/// A topic of fss, as a port of the service needs it.
#[derive(Clone, Debug)]
pub struct Port {
    /// Its name.
    pub topic: String,
    /// Its message.
    pub definition: Definition,
}

impl Port {
    /// The topic of this name.
    pub fn find(name: &str) -> Result<Self, String> {
        struct Find<'a>(&'a str, Option<Definition>);
        impl TopicVisitor for Find<'_> {
            fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
                if topic.name == self.0 {
                    self.1 = Some(Definition::of::<T>());
                }
            }
        }
        let mut find = Find(name, None);
        topic::visit(&mut find);
        let definition = find.1.ok_or_else(|| format!("there is no topic {name}"))?;
        Ok(Self { topic: name.to_owned(), definition })
    }

    /// Where a field lies, and its unit.
    pub fn slot(&self, field: &str) -> Result<(Slot, &'static str), String> {
        let (name, index) = match field.split_once('[') {
            Some((name, index)) => {
                let index = index.strip_suffix(']').and_then(|index| index.parse::<usize>().ok());
                (name, Some(index.ok_or_else(|| format!("'{field}' is no field; one of several reads q_rad[0]"))?))
            }
            None => (field, None),
        };
        let found = self.definition.fields.iter().find(|known| known.name == name);
        let Some(Field { scalar, offset, count, .. }) = found else {
            let names: Vec<_> = self.definition.fields.iter().map(|known| known.name.as_str()).collect();
            return Err(format!("{} has no field '{name}'; it has {}", self.topic, names.join(", ")));
        };
        let index = match (index, count) {
            (None, None) => 0,
            (Some(index), Some(count)) if index < *count => index,
            (_, Some(count)) => return Err(format!("{} {name} has the numbers 0 to {}", self.topic, count - 1)),
            (Some(_), None) => return Err(format!("{} {name} is a single number", self.topic)),
        };
        Ok((Slot { scalar: *scalar, offset: offset + index * scalar.size() }, unit_of(name)))
    }
}

impl Slot {
    /// The number in a sample.
    pub fn read(self, sample: &[u8]) -> Option<f64> {
        let bytes = sample.get(self.offset..)?;
        Some(match self.scalar {
            Scalar::U8 => (*bytes.first()?).into(),
            Scalar::U16 => u16::from_le_bytes(*bytes.first_chunk()?).into(),
            Scalar::U32 => u32::from_le_bytes(*bytes.first_chunk()?).into(),
            Scalar::U64 => u64::from_le_bytes(*bytes.first_chunk()?) as f64,
            Scalar::I64 => i64::from_le_bytes(*bytes.first_chunk()?) as f64,
            Scalar::F64 => f64::from_le_bytes(*bytes.first_chunk()?),
        })
    }

    /// Puts a number into a sample, rounded and bounded where the field is whole; false where it is none.
    pub fn write(self, sample: &mut [u8], value: f64) -> bool {
        let size = self.scalar.size();
        let Some(slot) = sample.get_mut(self.offset..self.offset + size).filter(|_| value.is_finite()) else {
            return false;
        };
        let whole = value.round();
        // Casts of floats end at the bounds of the whole type.
        match self.scalar {
            Scalar::U8 => slot.copy_from_slice(&(whole as u8).to_le_bytes()),
            Scalar::U16 => slot.copy_from_slice(&(whole as u16).to_le_bytes()),
            Scalar::U32 => slot.copy_from_slice(&(whole as u32).to_le_bytes()),
            Scalar::U64 => slot.copy_from_slice(&(whole as u64).to_le_bytes()),
            Scalar::I64 => slot.copy_from_slice(&(whole as i64).to_le_bytes()),
            Scalar::F64 => slot.copy_from_slice(&value.to_le_bytes()),
        }
        true
    }
}

/// Ends of field names and the units that they say, longest first.
const SUFFIXES: [(&str, &str); 12] = [
    ("_rad_s2", "rad/s2"),
    ("_m_s2", "m/s2"),
    ("_rad_s", "rad/s"),
    ("_m_s", "m/s"),
    ("_rad", "rad"),
    ("_nm", "N.m"),
    ("_hz", "Hz"),
    ("_ns", "ns"),
    ("_m", "m"),
    ("_s", "s"),
    ("_a", "A"),
    ("_v", "V"),
];

/// The unit that a field's name says; `1` where it says none.
fn unit_of(field: &str) -> &'static str {
    SUFFIXES.iter().find(|(end, _)| field.ends_with(end)).map_or("1", |(_, unit)| unit)
}

/// Units of FMUs that are converted, each with the unit that fields have and how many of that it is.
const CONVERTED: [(&str, &str, f64); 11] = [
    ("deg", "rad", std::f64::consts::PI / 180.0),
    ("deg/s", "rad/s", std::f64::consts::PI / 180.0),
    ("rpm", "rad/s", std::f64::consts::PI / 30.0),
    ("mm", "m", 1e-3),
    ("cm", "m", 1e-2),
    ("mm/s", "m/s", 1e-3),
    ("ms", "s", 1e-3),
    ("mA", "A", 1e-3),
    ("mN.m", "N.m", 1e-3),
    ("s", "ns", 1e9),
    ("%", "1", 1e-2),
];

/// How many of a field's unit one of the variable's is. A variable that says none is taken to have the field's.
pub fn factor(variable: &str, unit: Option<&str>, field: &str, field_unit: &str) -> Result<f64, String> {
    // The exponent is written in several ways, and so is the product.
    let plain = |unit: &str| unit.replace('^', "").replace(['*', '·'], ".").replace("Nm", "N.m");
    let Some(unit) = unit.map(plain) else { return Ok(1.0) };
    if unit == field_unit {
        return Ok(1.0);
    }
    let known = CONVERTED.iter().find(|(from, to, _)| *from == unit && *to == field_unit);
    known.map(|(.., factor)| *factor).ok_or_else(|| {
        let field_unit = if field_unit == "1" { "no unit" } else { field_unit };
        format!("the FMU's '{variable}' is in {unit}, the field {field} has {field_unit}")
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn units_are_converted_or_refused() {
        assert_eq!(factor("x", None, "x_m", unit_of("x_m")), Ok(1.0));
        assert_eq!(factor("x", Some("mm"), "x_m", unit_of("x_m")), Ok(1e-3));
        assert_eq!(factor("w", Some("rad/s"), "omega_rad_s", unit_of("omega_rad_s")), Ok(1.0));
        assert!((factor("w", Some("deg/s"), "omega_rad_s", "rad/s").unwrap() - 0.017_453_292_5).abs() < 1e-9);
        assert!(factor("x", Some("rad"), "x_m", "m").unwrap_err().contains("'x' is in rad"));
    }

    #[test]
    fn a_number_is_read_where_it_was_written() {
        let port = Port::find("/thrusters/command").unwrap();
        let mut sample = vec![0; port.definition.size];
        let (slot, unit) = port.slot("valves[3]").unwrap();
        assert!(slot.write(&mut sample, 1.2) && unit == "1");
        assert_eq!(slot.read(&sample), Some(1.0));
        assert!(!slot.write(&mut sample, f64::NAN));
        for (field, words) in
            [("valve[3]", "has no field"), ("valves[99]", "0 to"), ("valves", "0 to"), ("stamp_ns[0]", "single")]
        {
            assert!(port.slot(field).unwrap_err().contains(words), "{field}");
        }
    }
}
