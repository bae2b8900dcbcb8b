//! What stands for [`ParquetFile`] in a build without the feature `parquet`: it refuses, and says how to get it.

use super::{Table, TableError, TableFile};
use std::path::Path;

/// A file that cannot be begun.
pub enum ParquetFile {}

impl TableFile for ParquetFile {
    fn create(path: &Path, _like: &Table) -> Result<Self, TableError> {
        Err(TableError::WithoutParquet { path: path.to_owned() })
    }

    fn append(&mut self, _table: &Table) -> Result<(), TableError> {
        match *self {}
    }

    fn finish(self) -> Result<(), TableError> {
        match self {}
    }
}
