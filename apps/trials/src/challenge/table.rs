//! Many seeds: what was played so far, in a file that can be gone on from.

use super::gates::{Gate, table};
use super::play::Played;
use fss_launcher::files::write_silently;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

const FORMAT: &str = "fss-challenge-table/2";

/// The seeds that were played, by their number.
pub(super) type Seeds = BTreeMap<u64, Played>;

/// The file.
#[derive(Serialize, Deserialize)]
struct File {
    format: String,
    experiments: Vec<String>,
    seeds: Vec<Played>,
    #[serde(skip_deserializing)]
    gates: Vec<Gate>,
}

/// The seeds of a file that were played with these experiments; none where there is no such file.
///
/// # Errors
/// Where the file is another's, or its seeds flew other experiments.
pub(super) fn load(path: &Path, experiments: &[String]) -> Result<Seeds> {
    if !path.exists() {
        return Ok(Seeds::new());
    }
    let text =
        std::fs::read_to_string(path).into_diagnostic().wrap_err_with(|| format!("cannot read {}", path.display()))?;
    let value: serde_json::Value = serde_json::from_str(&text)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot go on from {}", path.display()))?;
    if value["format"] != FORMAT {
        return Err(miette!("{}: its format is {}, not \"{FORMAT}\"", path.display(), value["format"]));
    }
    let file: File = serde_json::from_value(value)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot go on from {}", path.display()))?;
    if file.experiments != experiments {
        let (there, asked) = (file.experiments.join(","), experiments.join(","));
        return Err(miette!(
            help = "give another --json file, or --experiments {there}",
            "{}: its seeds flew {there}, not {asked}",
            path.display()
        ));
    }
    Ok(file.seeds.into_iter().map(|played| (played.hidden.seed, played)).collect())
}

/// Writes the seeds and the table of their gates. The file is replaced as a whole, so that whoever stops the command finds
/// all that was played before.
///
/// # Errors
/// Where the folder refuses.
pub(super) fn save(path: &Path, experiments: &[String], played: &Seeds) -> Result<()> {
    let gates = table(&played.values().collect::<Vec<_>>());
    let seeds = played.values().cloned().collect();
    let file = File { format: FORMAT.to_owned(), experiments: experiments.to_vec(), seeds, gates };
    let new = path.with_extension("json.new");
    write_silently(&new, &serde_json::to_string_pretty(&file).into_diagnostic()?)?;
    std::fs::rename(&new, path).into_diagnostic().wrap_err_with(|| format!("cannot replace {}", path.display()))
}
