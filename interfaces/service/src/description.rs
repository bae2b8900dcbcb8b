//! What a program says of its service, so that a launcher knows its topics before it flies.

use fss_bus::{InputPorts, OutputPorts, PortVisitor, RawTopic, Service};
use fss_messages::topic::{Owner, Topic, is_shared};
use fss_messages::{Definition, Sample};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The version of what programs say of themselves.
pub const FORMAT: &str = "fss-service/1";
/// Name of the list of a stack's programs in a run's folder, and in its log.
pub const PROGRAMS_FILE: &str = "programs.json";

/// A service as its program describes it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Description {
    /// The version of this description.
    pub format: String,
    /// The service's name.
    pub service: String,
    /// Its input ports, in their order.
    pub inputs: Vec<PortDescription>,
    /// Its output ports, in their order.
    pub outputs: Vec<PortDescription>,
}

/// A port of a topic.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PortDescription {
    /// The topic, without the vehicle's name.
    pub topic: String,
    /// Whether it is the topic of the vehicle that is this one's target.
    #[serde(default)]
    pub of_target: bool,
    /// The message, `package/msg/Name`.
    pub schema: String,
    /// Its ROS 2 definition.
    pub definition: String,
    /// Of an input whose service is written in another language: whether a step takes every sample, or only the newest.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub every: bool,
}

impl PortDescription {
    /// Of a topic that this program knows.
    pub fn of<T: Sample>(topic: Topic<T>) -> Self {
        let definition = Definition::of::<T>();
        Self {
            topic: topic.name.to_owned(),
            of_target: topic.owner == Owner::Target,
            schema: definition.schema(),
            definition: definition.text,
            every: false,
        }
    }

    /// The topic as the bus has it.
    ///
    /// # Errors
    /// Where the definition is none of a plain sample.
    pub fn to_topic(&self) -> Result<RawTopic> {
        let definition = Definition::parse(&self.schema, &self.definition).into_diagnostic();
        let definition = definition.wrap_err_with(|| format!("{}: {}", self.topic, self.schema))?;
        let owner = if self.of_target { Owner::Target } else { Owner::This };
        Ok(RawTopic { name: self.topic.clone(), owner, definition })
    }
}

/// Notes the ports of a service.
#[derive(Default)]
struct Ports(Vec<PortDescription>);

impl PortVisitor for Ports {
    fn topic<T: Sample>(&mut self, topic: Topic<T>) {
        self.0.push(PortDescription::of(topic));
    }

    /// A device is the program's own business.
    fn device(&mut self, _queue: &'static str) {}
}

impl Description {
    /// Of a service of this program.
    pub fn of<S: Service>() -> Self {
        let (mut inputs, mut outputs) = (Ports::default(), Ports::default());
        S::Inputs::visit(&mut inputs);
        S::Outputs::visit(&mut outputs);
        Self { format: FORMAT.to_owned(), service: S::NAME.to_owned(), inputs: inputs.0, outputs: outputs.0 }
    }

    /// Its inputs as the bus has them, each with whether every sample is taken.
    ///
    /// # Errors
    /// Where a definition is none of a plain sample.
    pub fn input_topics(&self) -> Result<Vec<(RawTopic, bool)>> {
        self.inputs.iter().map(|port| Ok((port.to_topic()?, port.every))).collect()
    }

    /// Its outputs as the bus has them, but for the topics on which every service speaks: for these there are ports already.
    ///
    /// # Errors
    /// Where a definition is none of a plain sample.
    pub fn output_topics(&self) -> Result<Vec<RawTopic>> {
        self.outputs.iter().filter(|port| !is_shared(&port.topic)).map(PortDescription::to_topic).collect()
    }

    /// Reads what a program said of itself.
    ///
    /// # Errors
    /// Where it said something else.
    pub fn parse(json: &str) -> Result<Self> {
        let read = serde_json::from_str::<Self>(json).into_diagnostic()?;
        if read.format != FORMAT {
            return Err(miette!("it describes itself as {}, which is not {FORMAT}", read.format));
        }
        Ok(read)
    }
}

/// A service of a stack that does not come with fss.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProgramEntry {
    /// Where its program lies; none where it is linked into the launcher's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<PathBuf>,
    /// What it says of its service.
    pub description: Description,
}

/// The programs of the stack in a run's folder; none where the folder has no list of them.
///
/// # Errors
/// Where the list cannot be read.
pub fn read_programs(folder: &Path) -> Result<Vec<ProgramEntry>> {
    let path = folder.join(PROGRAMS_FILE);
    if !path.exists() {
        return Ok(Vec::new());
    }
    serde_json::from_str(&read(&path)?).into_diagnostic().wrap_err_with(|| path.display().to_string())
}

/// The topics that programs publish, beside those that every service has.
///
/// # Errors
/// Where one is no topic of plain samples.
pub fn topics_of(programs: &[ProgramEntry]) -> Result<Vec<RawTopic>> {
    let is_own = |port: &&PortDescription| !fss_messages::topic::NAMES.contains(&port.topic.as_str());
    let ports = programs.iter().flat_map(|program| &program.description.outputs);
    ports.filter(is_own).map(PortDescription::to_topic).collect()
}

/// The text of a file.
pub(crate) fn read(path: &Path) -> Result<String> {
    std::fs::read_to_string(path).into_diagnostic().wrap_err_with(|| format!("cannot read {}", path.display()))
}
