//! What a C service says it is, read once and checked.

use crate::{CService, CTopic, text};
use fss_messages::topic;
use fss_service::{Description, FORMAT, PortDescription, Refusal};

/// A service as it was declared.
pub(crate) struct Declared {
    /// As the launcher wants it.
    pub(crate) description: Description,
    /// Sizes of the outputs' samples, bytes.
    pub(crate) output_sizes: Vec<usize>,
    keys: Vec<String>,
    options: Vec<String>,
}

impl Declared {
    /// Reads it.
    ///
    /// # Safety
    /// What it points to is there, in the counts that it says; strings end with a zero.
    pub(crate) unsafe fn read(service: &CService) -> Result<Self, Refusal> {
        // SAFETY: the caller says so; null pointers are looked for.
        let (name, inputs, outputs, every) = unsafe {
            (
                text(service.name).ok_or("the service has no name")?,
                list(service.inputs, service.input_count),
                list(service.outputs, service.output_count),
                list(service.every, service.every_count),
            )
        };
        // SAFETY: as above.
        let (keys, options) =
            unsafe { (list(service.keys, service.key_count), list(service.options, service.option_count)) };
        // SAFETY: as above.
        let port = |topic: &CTopic| unsafe { port(topic) }.map_err(|e| format!("{name}: {e}"));
        let mut inputs: Vec<PortDescription> = inputs.iter().map(port).collect::<Result<_, _>>()?;
        for place in every {
            let input = inputs.get_mut(*place).ok_or("`every` names an input that is not there")?;
            input.every = true;
        }
        let mut ports: Vec<PortDescription> = outputs.iter().map(port).collect::<Result<_, _>>()?;
        // Every service may say what happens.
        ports.push(PortDescription::of(topic::EVENTS));
        // SAFETY: as above.
        let texts = |keys: &[*const std::ffi::c_char]| keys.iter().filter_map(|key| unsafe { text(*key) }).collect();
        let description = Description { format: FORMAT.to_owned(), service: name.clone(), inputs, outputs: ports };
        let output_sizes = outputs.iter().map(|topic| topic.size).collect();
        Ok(Self { description, output_sizes, keys: texts(keys), options: texts(options) })
    }

    /// The values of its keys in a config, in their order, and its options as they stand there.
    pub(crate) fn config(&self, config: &str) -> Result<(Vec<f64>, toml::Table), Refusal> {
        let mut table: toml::Table = config.parse()?;
        let known: Vec<&str> = self.keys.iter().chain(&self.options).map(String::as_str).collect();
        if let Some(key) = table.keys().find(|key| !known.contains(&key.as_str())) {
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            return Err(format!("unknown field `{key}`; the keys are: {known}").into());
        }
        let value = |key: &String| match table.get(key) {
            Some(toml::Value::Float(value)) => Ok(*value),
            Some(toml::Value::Integer(value)) => Ok(*value as f64),
            Some(_) => Err(Refusal::from(format!("`{key}` is a number"))),
            None => Err(format!("missing field `{key}`").into()),
        };
        let numbers = self.keys.iter().map(value).collect::<Result<_, Refusal>>()?;
        table.retain(|key, _| self.options.iter().any(|option| option == key));
        Ok((numbers, table))
    }
}

/// # Safety
/// `first` is null, or points to `count` of them.
unsafe fn list<'a, T>(first: *const T, count: usize) -> &'a [T] {
    // SAFETY: the caller says so.
    if first.is_null() { &[] } else { unsafe { std::slice::from_raw_parts(first, count) } }
}

/// # Safety
/// The topic's strings are null or end with a zero.
unsafe fn port(declared: &CTopic) -> Result<PortDescription, Refusal> {
    // SAFETY: the caller says so.
    let texts = unsafe { (text(declared.topic), text(declared.schema), text(declared.definition)) };
    let (Some(topic), Some(schema), Some(definition)) = texts else {
        return Err("a topic has a name, a schema and a definition".into());
    };
    let port = PortDescription { topic, of_target: false, schema, definition, every: false };
    let size = port.to_topic().map_err(|e| format!("{e:#}"))?.definition.size;
    if size != declared.size {
        let (topic, declared) = (&port.topic, declared.size);
        return Err(format!(
            "{topic}: its struct has {declared} bytes, its definition {size}; generate the header anew"
        )
        .into());
    }
    Ok(port)
}
