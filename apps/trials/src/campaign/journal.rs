//! The journal of a shard: a line of JSON for each run that is finished. What it holds is never flown again.

use super::row::Row;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

const ENDING: &str = "jsonl";

/// A journal that this process writes; it is the only one.
pub(super) struct Journal {
    path: PathBuf,
    file: Mutex<File>,
}

impl Journal {
    /// Opens the journal of this name, and begins one where there is none. A last line that was cut off, when its process
    /// was killed, is taken away: that run was not finished.
    ///
    /// # Errors
    /// Where another process writes it, or the file system refuses.
    pub(super) fn open(folder: &Path, name: &str) -> Result<Self> {
        let path = folder.join(format!("{name}.{ENDING}"));
        let say = || format!("cannot open {}", path.display());
        let options = File::options().read(true).append(true).create(true).open(&path);
        let mut file = options.into_diagnostic().wrap_err_with(say)?;
        if file.try_lock().is_err() {
            let help = "wait for it, or stop it; several processes share a campaign by --shard 1/N, 2/N and so on";
            return Err(miette!(help = help, "another process flies {} already", path.display()));
        }
        let mut text = Vec::new();
        file.read_to_end(&mut text).into_diagnostic().wrap_err_with(say)?;
        let whole = text.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
        file.set_len(whole as u64).into_diagnostic().wrap_err_with(say)?;
        file.seek(SeekFrom::End(0)).into_diagnostic()?;
        Ok(Self { path, file: Mutex::new(file) })
    }

    /// The runs that it holds.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub(super) fn rows(&self) -> Result<BTreeMap<u64, Row>> {
        let mut rows = BTreeMap::new();
        read(&self.path, &mut rows).map(|()| rows)
    }

    /// Enters a finished run: when this returns, no end of this process loses it.
    ///
    /// # Errors
    /// Where the file system refuses.
    pub(super) fn add(&self, row: &Row) -> Result<()> {
        let line = serde_json::to_string(row).into_diagnostic()? + "\n";
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(line.as_bytes())
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot write {}", self.path.display()))
    }
}

/// The runs of all journals of a campaign, by number.
///
/// # Errors
/// Where one cannot be read, or holds what no campaign of this build wrote.
pub(super) fn read_all(folder: &Path) -> Result<BTreeMap<u64, Row>> {
    let mut rows = BTreeMap::new();
    for entry in std::fs::read_dir(folder).into_diagnostic()? {
        let path = entry.into_diagnostic()?.path();
        if path.extension().is_some_and(|ending| ending == ENDING) {
            read(&path, &mut rows)?;
        }
    }
    Ok(rows)
}

/// Adds the runs of one journal to those that are known.
fn read(path: &Path, rows: &mut BTreeMap<u64, Row>) -> Result<()> {
    let text = std::fs::read_to_string(path).into_diagnostic()?;
    // What stands behind the last end of a line is being written, or was when its process was killed.
    let whole = text.rfind('\n').map_or("", |at| &text[..at]);
    for (line, number) in whole.lines().zip(1..) {
        let row: Row = serde_json::from_str(line)
            .into_diagnostic()
            .wrap_err_with(|| format!("{}:{number} is no run of a campaign", path.display()))?;
        rows.entry(row.run).or_insert(row);
    }
    Ok(())
}
