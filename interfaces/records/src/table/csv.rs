//! Tables as text with commas: a column of several becomes `name.0`, `name.1` and so on, and floating-point numbers have
//! as many digits as give back the same bits.

use super::{Column, Table, TableError, TableFile, Values, file_error};
use std::fs::File;
use std::path::{Path, PathBuf};

/// A CSV file that is being written.
pub struct CsvFile {
    path: PathBuf,
    writer: csv::Writer<File>,
}

impl TableFile for CsvFile {
    fn create(path: &Path, like: &Table) -> Result<Self, TableError> {
        let writer = csv::Writer::from_writer(File::create(path).map_err(file_error(path))?);
        let mut file = Self { path: path.to_owned(), writer };
        let header: Vec<String> = like.columns.iter().flat_map(Column::names).collect();
        file.write(&header)?;
        Ok(file)
    }

    fn append(&mut self, table: &Table) -> Result<(), TableError> {
        let mut row = Vec::new();
        for i in 0..table.rows() {
            row.clear();
            for column in &table.columns {
                let width = column.width.unwrap_or(1);
                row.extend((i * width..(i + 1) * width).map(|at| word(&column.values, at)));
            }
            self.write(&row)?;
        }
        Ok(())
    }

    fn finish(mut self) -> Result<(), TableError> {
        self.writer.flush().map_err(file_error(&self.path))
    }
}

impl CsvFile {
    fn write(&mut self, row: &[String]) -> Result<(), TableError> {
        self.writer.write_record(row).map_err(|e| file_error(&self.path)(e.into()))
    }
}

fn word(values: &Values, at: usize) -> String {
    match values {
        Values::Bool(v) => v[at].to_string(),
        Values::U8(v) => v[at].to_string(),
        Values::U16(v) => v[at].to_string(),
        Values::U32(v) => v[at].to_string(),
        Values::U64(v) => v[at].to_string(),
        Values::I64(v) => v[at].to_string(),
        Values::F64(v) => format!("{:?}", v[at]),
        Values::Known(v) => v[at].map_or(String::new(), |value| format!("{value:?}")),
        Values::Text(v) => v[at].clone(),
    }
}
