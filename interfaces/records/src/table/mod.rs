//! Tables in the formats that other programs read: CSV ([`CsvFile`]), Parquet ([`ParquetFile`]), MATLAB ([`MatlabFile`]).

mod csv;
mod matlab;
#[cfg(feature = "parquet")]
mod parquet;
#[cfg(not(feature = "parquet"))]
mod without_parquet;

pub use csv::CsvFile;
pub use matlab::MatlabFile;
#[cfg(feature = "parquet")]
pub use parquet::ParquetFile;
#[cfg(not(feature = "parquet"))]
pub use without_parquet::ParquetFile;

use std::path::{Path, PathBuf};

/// Whether this build writes Parquet files.
pub const HAS_PARQUET: bool = cfg!(feature = "parquet");

/// A file that takes a table part after part.
pub trait TableFile: Sized {
    /// Begins a file for tables with the columns of this one; an existing file of this name is replaced.
    ///
    /// # Errors
    /// Where the file cannot be made.
    fn create(path: &Path, like: &Table) -> Result<Self, TableError>;
    /// Appends the rows of a table.
    ///
    /// # Errors
    /// Where the file refuses, or the table has other columns.
    fn append(&mut self, table: &Table) -> Result<(), TableError>;
    /// Ends the file.
    ///
    /// # Errors
    /// Where the file refuses.
    fn finish(self) -> Result<(), TableError>;
}

/// Columns of equal length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// From left to right.
    pub columns: Vec<Column>,
}

/// One column; or several beside each other that carry one name, as the joints' angles do.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Its name, with the unit where it has one.
    pub name: String,
    /// How many stand beside each other under this name; `None` for a single one.
    pub width: Option<usize>,
    /// The values, row by row.
    pub values: Values,
}

/// The values of a column.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs)]
pub enum Values {
    Bool(Vec<bool>),
    U8(Vec<u8>),
    U16(Vec<u16>),
    U32(Vec<u32>),
    U64(Vec<u64>),
    I64(Vec<i64>),
    F64(Vec<f64>),
    /// Numbers, some of which are missing.
    Known(Vec<Option<f64>>),
    Text(Vec<String>),
}

/// Why a table could not be written.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// The file system refused.
    #[error("cannot write {path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// This build cannot write Parquet.
    #[error("cannot write {path}: this program was built without Parquet; `cargo build --release --features parquet` has it, and so has the Debian package", path = path.display())]
    WithoutParquet {
        /// The file.
        path: PathBuf,
    },
    /// The Parquet library refused.
    #[cfg(feature = "parquet")]
    #[error("cannot write {path}: {source}", path = path.display())]
    Parquet {
        /// The file.
        path: PathBuf,
        /// What it said.
        source: ::parquet::errors::ParquetError,
    },
    /// The format has no room for so much.
    #[error("{path}: {name} needs {bytes} bytes, more than the 4 GB that a MATLAB file of this version may have", path = path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The variable.
        name: String,
        /// What it needs.
        bytes: u64,
    },
}

impl Column {
    /// A column of single values.
    pub fn new(name: impl Into<String>, values: Values) -> Self {
        Self { name: name.into(), width: None, values }
    }

    /// The names of the columns that stand beside each other: `q_rad.0`, `q_rad.1` and so on.
    pub fn names(&self) -> Vec<String> {
        let name = &self.name;
        self.width.map_or_else(|| vec![name.clone()], |n| (0..n).map(|i| format!("{name}.{i}")).collect())
    }
}

impl Table {
    /// Rows.
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |column| column.values.len() / column.width.unwrap_or(1).max(1))
    }
}

impl Values {
    /// How many.
    pub fn len(&self) -> usize {
        match self {
            Self::Bool(v) => v.len(),
            Self::U8(v) => v.len(),
            Self::U16(v) => v.len(),
            Self::U32(v) => v.len(),
            Self::U64(v) => v.len(),
            Self::I64(v) => v.len(),
            Self::F64(v) => v.len(),
            Self::Known(v) => v.len(),
            Self::Text(v) => v.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

fn file_error(path: &Path) -> impl FnOnce(std::io::Error) -> TableError + '_ {
    |source| TableError::File { path: path.to_owned(), source }
}
