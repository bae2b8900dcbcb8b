//! A campaign in pieces, for those who share its runs among computers in their own way.

use super::definition::{Campaign, TABLES};
use super::journal::{self, Journal};
use super::row::{self, Row};
use super::{CampaignArgs, opened};
use fss_records::table::{HAS_PARQUET, TableError};
use miette::{IntoDiagnostic, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Begins the campaign that is asked for in its folder, or finds it there; gives how many runs it has.
///
/// # Errors
/// Where another lies there, or no run of it could fly.
pub fn begin(args: &CampaignArgs) -> Result<u64> {
    opened(args).map(|campaign| campaign.count())
}

/// Flies one run of the campaign in a folder and writes nothing: its line of a journal, and the same as an object with the
/// table's names.
///
/// # Errors
/// Where the folder holds no campaign, or this computer does not let it fly.
pub fn fly_one(folder: &Path, run: u64) -> Result<(String, serde_json::Value)> {
    let campaign = Campaign::open(folder)?;
    let row = row::fly(&campaign, run)?;
    let line = serde_json::to_string(&row).into_diagnostic()?;
    Ok((line, row::object(&campaign, &row)))
}

/// Adds lines of [`fly_one`] to the journal of this name, and writes its table; gives the table's path. A run that a journal has
/// already stays as it is.
///
/// # Errors
/// Where the folder refuses, or a line is none of a journal.
pub fn write_rows(folder: &Path, name: &str, lines: &[String]) -> Result<PathBuf> {
    let path = folder.join(TABLES).join(format!("{name}.parquet"));
    if !HAS_PARQUET {
        return Err(TableError::WithoutParquet { path }).into_diagnostic();
    }
    let campaign = Campaign::open(folder)?;
    let mut flown = journal::read_all(folder)?;
    let own = Journal::open(folder, name)?;
    for line in lines {
        let row: Row = serde_json::from_str(line).into_diagnostic()?;
        if let std::collections::btree_map::Entry::Vacant(place) = flown.entry(row.run) {
            own.add(&row)?;
            place.insert(row);
        }
    }
    let own: BTreeMap<u64, Row> = own.rows()?;
    row::write_table(&campaign, own.values(), &path)?;
    Ok(path)
}
