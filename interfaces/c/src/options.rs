//! Texts, tables and lists of a service's config.

use fss_service::Refusal;
use std::collections::BTreeMap;
use std::ffi::{CStr, CString};

/// The values by their paths: `gains.kp`, `names.0`.
pub(crate) struct Options {
    texts: BTreeMap<String, CString>,
    numbers: BTreeMap<String, f64>,
    json: CString,
}

impl Options {
    /// Of the part of a config that is no plain number.
    pub(crate) fn new(table: &toml::Table) -> Result<Self, Refusal> {
        let json = CString::new(serde_json::to_string(table)?)?;
        let mut options = Self { texts: BTreeMap::new(), numbers: BTreeMap::new(), json };
        for (key, value) in table {
            options.add(key.clone(), value)?;
        }
        Ok(options)
    }

    fn add(&mut self, path: String, value: &toml::Value) -> Result<(), Refusal> {
        match value {
            toml::Value::String(text) => drop(self.texts.insert(path, CString::new(text.as_str())?)),
            toml::Value::Integer(value) => drop(self.numbers.insert(path, *value as f64)),
            toml::Value::Float(value) => drop(self.numbers.insert(path, *value)),
            toml::Value::Boolean(value) => drop(self.numbers.insert(path, f64::from(u8::from(*value)))),
            toml::Value::Datetime(_) => return Err(format!("`{path}`: write a time as a text").into()),
            toml::Value::Array(values) => {
                for (i, value) in values.iter().enumerate() {
                    self.add(format!("{path}.{i}"), value)?;
                }
            }
            toml::Value::Table(table) => {
                for (key, value) in table {
                    self.add(format!("{path}.{key}"), value)?;
                }
            }
        }
        Ok(())
    }

    pub(crate) fn text(&self, path: &str) -> Option<&CStr> {
        self.texts.get(path).map(CString::as_c_str)
    }

    pub(crate) fn number(&self, path: &str) -> Option<f64> {
        self.numbers.get(path).copied()
    }

    pub(crate) fn json(&self) -> &CStr {
        &self.json
    }
}
