//! RIHS01: SHA-256 of a message's description as `rosidl` writes it, JSON with its fields and those of all that it contains.

use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt::Write;

/// A message whose definition cannot be hashed, or that contains one that is not given.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnknownType(pub String);

impl core::fmt::Display for UnknownType {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "the type '{}' is not defined", self.0)
    }
}

impl core::error::Error for UnknownType {}

/// Numbers of the primitives in `type_description_interfaces/msg/FieldType`; arrays of them come 48 later, bounded sequences 96,
/// unbounded ones 144.
const PRIMITIVES: [(&str, u32); 15] = [
    ("int8", 2),
    ("uint8", 3),
    ("int16", 4),
    ("uint16", 5),
    ("int32", 6),
    ("uint32", 7),
    ("int64", 8),
    ("uint64", 9),
    ("float32", 10),
    ("float64", 11),
    ("char", 3),
    ("bool", 15),
    ("byte", 16),
    ("string", 17),
    ("wstring", 18),
];
const NESTED: u32 = 1;
const ARRAY: u32 = 48;
const BOUNDED: u32 = 96;
const UNBOUNDED: u32 = 144;

struct Described {
    json: String,
    contains: Vec<String>,
}

/// The hash of `package/msg/Name` with this definition; `parts` are the definitions of all that it contains, as
/// `package/Name` or `package/msg/Name`.
///
/// # Errors
/// Names a type that is neither a primitive nor among the parts.
pub fn rihs01(name: &str, definition: &str, parts: &[(&str, &str)]) -> Result<String, UnknownType> {
    let parts: BTreeMap<String, &str> = parts.iter().map(|(name, text)| (full_name(name), *text)).collect();
    let whole = describe(name, definition)?;
    let mut contained: BTreeMap<String, String> = BTreeMap::new();
    let mut open = whole.contains;
    while let Some(next) = open.pop() {
        if contained.contains_key(&next) {
            continue;
        }
        let text = parts.get(&next).ok_or_else(|| UnknownType(next.clone()))?;
        let part = describe(&next, text)?;
        open.extend(part.contains);
        contained.insert(next, part.json);
    }
    let contained: Vec<String> = contained.into_values().collect();
    let json = format!(
        "{{\"type_description\": {}, \"referenced_type_descriptions\": [{}]}}",
        whole.json,
        contained.join(", ")
    );
    Ok(format!("RIHS01_{}", hex::encode(Sha256::digest(json.as_bytes()))))
}

/// `std_msgs/Header` as `std_msgs/msg/Header`.
fn full_name(name: &str) -> String {
    match name.split_once('/') {
        Some((package, rest)) if !rest.contains('/') => format!("{package}/msg/{rest}"),
        _ => name.to_owned(),
    }
}

fn describe(name: &str, definition: &str) -> Result<Described, UnknownType> {
    let package = name.split('/').next().unwrap_or_default();
    let (mut fields, mut contains) = (Vec::new(), Vec::new());
    for line in definition.lines() {
        let said = line.split('#').next().unwrap_or_default().trim();
        // A constant has a value, and does not count.
        let Some((kind, field)) = said.split_once(char::is_whitespace).filter(|_| !said.contains('=')) else {
            continue;
        };
        let (element, shift, capacity) = array_of(kind);
        let known = PRIMITIVES.iter().find(|(primitive, _)| *primitive == element);
        let (id, nested) = match known {
            Some((_, id)) => (*id, String::new()),
            None if element.chars().next().is_some_and(char::is_uppercase) => {
                (NESTED, format!("{package}/msg/{element}"))
            }
            None if element.contains('/') => (NESTED, full_name(element)),
            None => return Err(UnknownType(element.to_owned())),
        };
        let mut json = String::new();
        let _ = write!(
            json,
            "{{\"name\": \"{}\", \"type\": {{\"type_id\": {}, \"capacity\": {capacity}, \"string_capacity\": 0, \
             \"nested_type_name\": \"{nested}\"}}}}",
            field.trim(),
            id + shift,
        );
        fields.push(json);
        if !nested.is_empty() {
            contains.push(nested);
        }
    }
    let json = format!("{{\"type_name\": \"{name}\", \"fields\": [{}]}}", fields.join(", "));
    Ok(Described { json, contains })
}

/// The element's type, what an array of it adds to its number, and how many there are or may be.
fn array_of(kind: &str) -> (&str, u32, usize) {
    let Some((element, rest)) = kind.split_once('[') else { return (kind, 0, 0) };
    let count = rest.trim_end_matches(']');
    match (count.strip_prefix("<="), count.parse()) {
        (Some(most), _) => (element, BOUNDED, most.parse().unwrap_or(0)),
        (None, Ok(count)) => (element, ARRAY, count),
        (None, Err(_)) => (element, UNBOUNDED, 0),
    }
}
