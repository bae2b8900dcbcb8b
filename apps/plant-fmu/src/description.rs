//! `modelDescription.xml` of a plant's FMU.

use crate::variables::{Causality, Variable};
use std::fmt::Write;

/// Name of the shared library, and what it is told when it is made.
pub const IDENTIFIER: &str = "fss_plant";
/// What it is told when it is made: a model of this build.
pub const TOKEN: &str = concat!("{fss-plant-", env!("CARGO_PKG_VERSION"), "}");

/// The description of an FMU with these variables, for FMI 2 or 3.
pub fn xml(is_fmi2: bool, name: &str, variables: &[Variable]) -> String {
    let name = escaped(name);
    let (version, token) = if is_fmi2 { ("2.0", "guid") } else { ("3.0", "instantiationToken") };
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"{version}\" modelName=\"{name}\" {token}=\"{TOKEN}\" \
         description=\"A floating spacecraft simulator: table, base, arm, thrusters\" generationTool=\"fss {}\">\n  \
         <CoSimulation modelIdentifier=\"{IDENTIFIER}\" canHandleVariableCommunicationStepSize=\"true\"/>\n{UNITS}  \
         <DefaultExperiment startTime=\"0\" stopTime=\"10\" stepSize=\"0.001\"/>\n  <ModelVariables>\n",
        env!("CARGO_PKG_VERSION"),
    );
    for (reference, variable) in variables.iter().enumerate() {
        let unit = if variable.unit.is_empty() { String::new() } else { format!(" unit=\"{}\"", variable.unit) };
        let (causality, variability) = match variable.causality {
            Causality::Parameter => ("parameter", "fixed"),
            Causality::Input => ("input", "continuous"),
            Causality::Output => ("output", "continuous"),
            Causality::Independent => ("independent", "continuous"),
        };
        // An output is computed; a parameter and an input start somewhere.
        let is_output = variable.causality == Causality::Output;
        let start = if is_output || variable.causality == Causality::Independent {
            String::new()
        } else {
            format!(" start=\"{}\"", variable.start)
        };
        let common = format!(
            "name=\"{}\" valueReference=\"{reference}\" causality=\"{causality}\" variability=\"{variability}\" description=\"{}\"",
            variable.name,
            escaped(&variable.about)
        );
        let _ = if is_fmi2 {
            let initial = if is_output { " initial=\"calculated\"" } else { "" };
            writeln!(text, "    <ScalarVariable {common}{initial}><Real{unit}{start}/></ScalarVariable>")
        } else {
            writeln!(text, "    <Float64 {common}{unit}{start}/>")
        };
    }
    text.push_str("  </ModelVariables>\n  <ModelStructure>\n");
    let outputs = || variables.iter().enumerate().filter(|(_, v)| v.causality == Causality::Output);
    if is_fmi2 {
        // FMI 2 counts variables from 1.
        for kind in ["Outputs", "InitialUnknowns"] {
            let _ = writeln!(text, "    <{kind}>");
            for (i, _) in outputs() {
                let _ = writeln!(text, "      <Unknown index=\"{}\"/>", i + 1);
            }
            let _ = writeln!(text, "    </{kind}>");
        }
    } else {
        for kind in ["Output", "InitialUnknown"] {
            for (i, _) in outputs() {
                let _ = writeln!(text, "    <{kind} valueReference=\"{i}\"/>");
            }
        }
    }
    text.push_str("  </ModelStructure>\n</fmiModelDescription>\n");
    text
}

const UNITS: &str = "  <UnitDefinitions>\n    <Unit name=\"m\"><BaseUnit m=\"1\"/></Unit>\n    \
    <Unit name=\"m/s\"><BaseUnit m=\"1\" s=\"-1\"/></Unit>\n    <Unit name=\"rad\"><BaseUnit rad=\"1\"/></Unit>\n    \
    <Unit name=\"rad/s\"><BaseUnit rad=\"1\" s=\"-1\"/></Unit>\n    <Unit name=\"A\"><BaseUnit A=\"1\"/></Unit>\n    \
    <Unit name=\"N.m\"><BaseUnit kg=\"1\" m=\"2\" s=\"-2\"/></Unit>\n    <Unit name=\"kg\"><BaseUnit kg=\"1\"/></Unit>\n    \
    <Unit name=\"s\"><BaseUnit s=\"1\"/></Unit>\n  \
    </UnitDefinitions>\n";

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}
