//! Values that vary from run to run, by their place in the plant file, the laboratory's, or the mission file.

use fss_launcher::stack::Texts;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::fmt;
use std::str::FromStr;
use toml::{Table, Value};

/// A key and its values.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sweep {
    /// As it was given.
    pub text: String,
    /// The way to the value, dotted.
    pub key: String,
    /// In the order in which they are flown.
    pub values: Vec<f64>,
}

/// A key and one of its values.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SweptValue {
    pub key: String,
    pub value: f64,
}

impl FromStr for Sweep {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = "write KEY=FROM..TO:COUNT or KEY=A,B,C, such as base.mass_kg=9..11:5";
        let (key, values) = text.split_once('=').ok_or(form)?;
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| format!("'{text}' is no number; {form}"));
        let values = match values.split_once("..") {
            Some((from, rest)) => {
                let (to, count) = rest.split_once(':').ok_or(form)?;
                let count: usize = count.trim().parse().map_err(|_| form)?;
                even(number(from)?, number(to)?, count)
            }
            None => values.split(',').map(number).collect::<Result<_, _>>()?,
        };
        let key = key.trim().to_owned();
        if key.is_empty() || values.is_empty() || values.iter().any(|value| !value.is_finite()) {
            return Err(form.to_owned());
        }
        Ok(Self { text: text.to_owned(), key, values })
    }
}

/// Values in equal steps, both ends included.
fn even(from: f64, to: f64, count: usize) -> Vec<f64> {
    let last = count.saturating_sub(1).max(1) as f64;
    (0..count).map(|i| i as f64 / last).map(|share| from * (1.0 - share) + to * share).collect()
}

impl Sweep {
    /// One of its values.
    pub(super) fn at(&self, value: f64) -> SweptValue {
        SweptValue { key: self.key.clone(), value }
    }
}

impl fmt::Display for SweptValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {}", self.key, self.value)
    }
}

impl SweptValue {
    /// Whether it is a value of the laboratory alone.
    pub(super) fn is_of_laboratory(&self) -> bool {
        self.key.starts_with("laboratory.")
    }

    /// Puts the value into the file that its key begins with; the plant file where it begins with none.
    ///
    /// # Errors
    /// Where the file has no such place. A key that the file has not, but might have, is added: the file's own reader says
    /// whether it knows it.
    pub(super) fn set(&self, texts: &mut Texts) -> Result<()> {
        let (file, key) = self.key.split_once('.').unwrap_or(("", &self.key));
        let (text, key) = match file {
            "mission" => (&mut texts.mission, key),
            "laboratory" => (texts.laboratory.get_or_insert_with(|| texts.plant.clone()), key),
            "plant" => (&mut texts.plant, key),
            _ => (&mut texts.plant, self.key.as_str()),
        };
        let mut root: Table = text.parse().into_diagnostic()?;
        let path: Vec<&str> = key.split('.').collect();
        let set = match path.as_slice() {
            ["effect", id, rest @ ..] if id.parse::<usize>().is_err() => set_effect(&mut root, id, rest, self.value),
            path => set_in_table(&mut root, path, self.value),
        };
        set.map_err(|what| {
            let help = "keys go as base.mass_kg, link.2.length_m, effect.table_tilt.accel_x_m_s2; elements of lists count from 1";
            miette!(help = help, "{what}")
        })
        .wrap_err_with(|| format!("cannot set {}", self.key))?;
        *text = toml::to_string(&root).into_diagnostic()?;
        Ok(())
    }
}

fn set_in_table(table: &mut Table, path: &[&str], number: f64) -> Result<(), String> {
    let Some((key, rest)) = path.split_first() else { return Err("a table is no number".to_owned()) };
    let missing = || if rest.is_empty() { Value::Float(number) } else { Value::Table(Table::new()) };
    set(table.entry(*key).or_insert_with(missing), key, rest, number)
}

fn set(place: &mut Value, name: &str, path: &[&str], number: f64) -> Result<(), String> {
    match (place, path) {
        // A whole number stays one, where the file has one: counts are.
        (place @ Value::Integer(_), []) if number.fract() == 0.0 => *place = Value::Integer(number as i64),
        (place @ (Value::Integer(_) | Value::Float(_)), []) => *place = Value::Float(number),
        (Value::Table(table), path) => return set_in_table(table, path, number),
        (Value::Array(array), [element, rest @ ..]) => {
            let count = array.len();
            let at = position(array, element)
                .ok_or_else(|| format!("'{name}' has {count} elements, and none is '{element}'"))?;
            return set(&mut array[at], element, rest, number);
        }
        (Value::Array(_), []) => return Err(format!("'{name}' is a list: say which element, as {name}.1")),
        (place, []) => return Err(format!("'{name}' is {}, no number", place.type_str())),
        (_, [below, ..]) => return Err(format!("'{name}' is a value, there is no '{below}' below it")),
    }
    Ok(())
}

/// An element by its number from 1, or by its name.
fn position(array: &[Value], element: &str) -> Option<usize> {
    match element.parse::<usize>() {
        Ok(number) => number.checked_sub(1).filter(|at| *at < array.len()),
        Err(_) => array.iter().position(|value| value.get("name").and_then(Value::as_str) == Some(element)),
    }
}

/// Sets a parameter of an effect, `ID.PARAMETER` or `ID.INDEX.PARAMETER`; one that the plant does not have yet is added.
fn set_effect(root: &mut Table, id: &str, path: &[&str], number: f64) -> Result<(), String> {
    let (index, parameter) = match path {
        [parameter] => (None, *parameter),
        [index, parameter] => {
            let index: i64 =
                index.parse().map_err(|_| format!("'{index}' is no number of a thruster, link or joint"))?;
            (Some(index), *parameter)
        }
        _ => return Err(format!("write effect.{id}.PARAMETER or effect.{id}.INDEX.PARAMETER")),
    };
    let effects = root.entry("effect").or_insert_with(|| Value::Array(Vec::new()));
    let Value::Array(effects) = effects else { return Err("'effect' is no list of tables".to_owned()) };
    let is_it = |effect: &Value| {
        effect.get("id").and_then(Value::as_str) == Some(id) && effect.get("index").and_then(Value::as_integer) == index
    };
    let at = effects.iter().position(is_it).unwrap_or(effects.len());
    if at == effects.len() {
        let mut effect = Table::from_iter([("id".to_owned(), Value::String(id.to_owned()))]);
        effect.extend(index.map(|index| ("index".to_owned(), Value::Integer(index))));
        effects.push(Value::Table(effect));
    }
    set(&mut effects[at], id, &[parameter], number)
}
