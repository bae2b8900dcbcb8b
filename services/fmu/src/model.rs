//! An FMU's archive and what `modelDescription.xml` says in it.

use roxmltree::{Document, Node};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

/// The longest model description that is read, bytes.
const LONGEST: u64 = 64 << 20;

/// Why an FMU is not taken.
#[derive(Debug, thiserror::Error)]
#[error("{path}: {what}")]
pub struct ModelError {
    /// The file.
    pub path: String,
    /// What is wrong, and what to do.
    pub what: String,
}

/// The standard's major version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fmi {
    /// FMI 2.0.
    Two,
    /// FMI 3.0.
    Three,
}

/// What a variable may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `Real` or `Float64`.
    Real,
    /// `Integer` or `Int32`.
    Integer,
    /// `Boolean`.
    Boolean,
}

/// A scalar variable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variable {
    /// By which its functions know it.
    pub reference: u32,
    /// Its type; none for one that is not read.
    pub kind: Option<Kind>,
    /// `input`, `output`, `parameter`, `local` ...
    pub causality: String,
    /// Its unit, where it has one.
    pub unit: Option<String>,
}

/// What the archive says of itself.
#[derive(Clone, Debug)]
pub struct Model {
    /// The archive.
    pub path: PathBuf,
    /// The standard.
    pub fmi: Fmi,
    /// Name of its shared library.
    pub identifier: String,
    /// What it wants to hear when it is made.
    pub token: String,
    /// Whether steps may have another length than the first.
    pub takes_any_step: bool,
    /// Its variables.
    pub variables: BTreeMap<String, Variable>,
}

impl Model {
    /// Reads an archive's description.
    ///
    /// # Errors
    /// Where it is no FMU for co-simulation of a version that is known.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let refuse = |what: String| ModelError { path: path.display().to_string(), what };
        let file = File::open(path).map_err(|e| refuse(format!("cannot be read: {e}")))?;
        let mut archive = zip::ZipArchive::new(file).map_err(|e| refuse(format!("is no FMU: {e}")))?;
        let entry = archive
            .by_name("modelDescription.xml")
            .map_err(|_| refuse("is no FMU: it has no modelDescription.xml".to_owned()))?;
        let mut text = String::new();
        std::io::Read::read_to_string(&mut std::io::Read::take(entry, LONGEST), &mut text)
            .map_err(|e| refuse(format!("modelDescription.xml: {e}")))?;
        let document = Document::parse(&text).map_err(|e| refuse(format!("modelDescription.xml: {e}")))?;
        Self::parse(path, document.root_element()).map_err(refuse)
    }

    fn parse(path: &Path, root: Node<'_, '_>) -> Result<Self, String> {
        let version = root.attribute("fmiVersion").unwrap_or_default();
        let fmi = match version.split('.').next() {
            Some("2") => Fmi::Two,
            Some("3") => Fmi::Three,
            _ => return Err(format!("FMI {version} is not known; export it as FMI 2.0 or 3.0")),
        };
        let child = |name: &str| root.children().find(|node| node.has_tag_name(name));
        let Some(simulation) = child("CoSimulation") else {
            return Err("is for model exchange only; export it for co-simulation".to_owned());
        };
        let token = root.attribute(if fmi == Fmi::Two { "guid" } else { "instantiationToken" }).unwrap_or_default();
        let types: BTreeMap<&str, &str> = child("TypeDefinitions").into_iter().flat_map(units_of_types).collect();
        let variables = child("ModelVariables").into_iter().flat_map(|node| node.children()).filter(Node::is_element);
        Ok(Self {
            path: path.to_owned(),
            fmi,
            identifier: simulation.attribute("modelIdentifier").unwrap_or_default().to_owned(),
            token: token.to_owned(),
            takes_any_step: simulation.attribute("canHandleVariableCommunicationStepSize") == Some("true"),
            variables: variables.filter_map(|node| variable(node, fmi, &types)).collect(),
        })
    }

    /// Unpacks the archive; gives the path of its shared library for this computer.
    ///
    /// # Errors
    /// Where there is none, or the archive is damaged.
    pub fn unpack(&self, folder: &Path) -> Result<PathBuf, ModelError> {
        let refuse = |what: String| ModelError { path: self.path.display().to_string(), what };
        let file = File::open(&self.path).map_err(|e| refuse(format!("cannot be read: {e}")))?;
        let archive = zip::ZipArchive::new(file).and_then(|mut archive| archive.extract(folder));
        archive.map_err(|e| refuse(format!("cannot be unpacked: {e}")))?;
        let platform = match self.fmi {
            Fmi::Two => "linux64".to_owned(),
            Fmi::Three => format!("{}-linux", std::env::consts::ARCH),
        };
        let library = folder.join("binaries").join(&platform).join(format!("{}.so", self.identifier));
        if library.is_file() {
            return Ok(library);
        }
        Err(refuse(format!("has no binaries/{platform}/{}.so: export it for this computer", self.identifier)))
    }
}

/// Names of types, and their units.
fn units_of_types<'a>(types: Node<'a, '_>) -> Vec<(&'a str, &'a str)> {
    let own = |node: Node<'a, '_>| {
        let unit = node.attribute("unit").or_else(|| node.children().find_map(|child| child.attribute("unit")));
        Some((node.attribute("name")?, unit?))
    };
    types.children().filter_map(own).collect()
}

fn variable(node: Node<'_, '_>, fmi: Fmi, types: &BTreeMap<&str, &str>) -> Option<(String, Variable)> {
    // FMI 2 has the type in an element of its own.
    let typed = if fmi == Fmi::Two { node.children().find(Node::is_element)? } else { node };
    let is_array = typed.children().any(|child| child.has_tag_name("Dimension"));
    let kind = match typed.tag_name().name() {
        _ if is_array => None,
        "Real" | "Float64" => Some(Kind::Real),
        "Integer" | "Int32" | "Enumeration" if fmi == Fmi::Two || typed.has_tag_name("Int32") => Some(Kind::Integer),
        "Boolean" => Some(Kind::Boolean),
        _ => None,
    };
    let declared = typed.attribute("declaredType").and_then(|name| types.get(name).copied());
    let unit = typed.attribute("unit").or(declared).filter(|unit| !unit.is_empty());
    let variable = Variable {
        reference: node.attribute("valueReference")?.parse().ok()?,
        kind,
        causality: node.attribute("causality").unwrap_or("local").to_owned(),
        unit: unit.map(str::to_owned),
    };
    Some((node.attribute("name")?.to_owned(), variable))
}
