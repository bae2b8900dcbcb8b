//! The table of effects for the documentation, written from the catalogue.

use std::fmt::Write;

use crate::effects::catalogue;
use crate::kind::{About, Index, Parameter};

/// The whole page `docs/effects.md`.
pub fn effects_table_markdown() -> String {
    let mut page = String::from(
        "# Effects\n\n\
         What a plant can have beyond the nominal model. The simulator applies these, the diagnosis\n\
         searches them, a plant file states them:\n\n\
         ```toml\n[[effect]]\nid = \"thruster_gain\"\nindex = 3\nscale = 0.72\n```\n\n\
         `index` counts thrusters, links and joints from 1; without it the effect is on all of them.\n\
         Any effect may begin during the run: `onset_s = 12.5`. A value that replaces one of the plant's\n\
         is given as its new value. Nominal is the value at which the effect does nothing; \"plant\" means\n\
         the plant's own value.\n\n\
         A link that bends is two `[[link]]` tables with a joint without a motor between them\n\
         (`max_torque_N_m = 0`) and a `joint_spring` on it.\n\n\
         This page is generated from the catalogue in `libs/plant`.\n\n\
         | effect | acts on | index | what it does | parameters |\n| --- | --- | --- | --- | --- |\n",
    );
    for kind in catalogue() {
        row(&mut page, kind.about());
    }
    page
}

fn row(page: &mut String, about: &About) {
    let parameters: Vec<String> = about.parameters.iter().map(cell).collect();
    let index = match about.index {
        Index::None => "-",
        other => other.name(),
    };
    // Writing to a String cannot fail.
    let _ = writeln!(
        page,
        "| `{}` | {} | {index} | {} | {} |",
        about.id,
        about.place.name(),
        about.sentence,
        parameters.join("<br>")
    );
}

fn cell(parameter: &Parameter) -> String {
    let unit = if parameter.unit.is_empty() { String::new() } else { format!(" [{}]", parameter.unit) };
    let nominal = parameter.nominal.map_or_else(|| "plant".to_owned(), |value| value.to_string());
    format!(
        "`{}`: {}{unit}; nominal {nominal}, {} to {}",
        parameter.name, parameter.meaning, parameter.lower, parameter.upper
    )
}
