//! Tables as Parquet files (<https://parquet.apache.org>): a column of several becomes `name.0`, `name.1` and so on.

use super::{Column, Table, TableError, TableFile, Values, file_error};
use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::{ParquetError, Result};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{Type, TypePtr};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A Parquet file that is being written.
pub struct ParquetFile {
    path: PathBuf,
    writer: SerializedFileWriter<File>,
}

impl TableFile for ParquetFile {
    fn create(path: &Path, like: &Table) -> std::result::Result<Self, TableError> {
        let file = File::create(path).map_err(file_error(path))?;
        let writer = begin(file, like).map_err(|source| TableError::Parquet { path: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), writer })
    }

    fn append(&mut self, table: &Table) -> std::result::Result<(), TableError> {
        append(&mut self.writer, table).map_err(|source| TableError::Parquet { path: self.path.clone(), source })
    }

    fn finish(self) -> std::result::Result<(), TableError> {
        let path = self.path;
        let file = self.writer.into_inner().map_err(|source| TableError::Parquet { path: path.clone(), source })?;
        file.sync_all().map_err(file_error(&path))
    }
}

fn begin(file: File, like: &Table) -> Result<SerializedFileWriter<File>> {
    let mut fields = Vec::<TypePtr>::new();
    for column in &like.columns {
        for name in column.names() {
            fields.push(Arc::new(field(&name, &column.values)?));
        }
    }
    let schema = Type::group_type_builder("table").with_fields(fields).build()?;
    let properties = WriterProperties::builder()
        .set_created_by(concat!("fss ", env!("CARGO_PKG_VERSION")).to_owned())
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
        .build();
    SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties))
}

fn field(name: &str, values: &Values) -> Result<Type> {
    let unsigned = |bits| Some(LogicalType::integer(bits, false));
    let (physical, logical, repetition) = match values {
        Values::Bool(_) => (Physical::BOOLEAN, None, Repetition::REQUIRED),
        Values::U8(_) => (Physical::INT32, unsigned(8), Repetition::REQUIRED),
        Values::U16(_) => (Physical::INT32, unsigned(16), Repetition::REQUIRED),
        Values::U32(_) => (Physical::INT32, unsigned(32), Repetition::REQUIRED),
        Values::U64(_) => (Physical::INT64, unsigned(64), Repetition::REQUIRED),
        Values::I64(_) => (Physical::INT64, None, Repetition::REQUIRED),
        Values::F64(_) => (Physical::DOUBLE, None, Repetition::REQUIRED),
        Values::Known(_) => (Physical::DOUBLE, None, Repetition::OPTIONAL),
        Values::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String), Repetition::REQUIRED),
    };
    Type::primitive_type_builder(name, physical).with_logical_type(logical).with_repetition(repetition).build()
}

fn append(writer: &mut SerializedFileWriter<File>, table: &Table) -> Result<()> {
    let mut group = writer.next_row_group()?;
    for column in &table.columns {
        for part in 0..column.width.unwrap_or(1) {
            let mut next = group.next_column()?.ok_or_else(|| other_columns(column))?;
            write(next.untyped(), column, part)?;
            next.close()?;
        }
    }
    group.close()?;
    Ok(())
}

/// The `part`-th of the values that stand beside each other in each row.
fn every<'a, T, U>(column: &Column, part: usize, values: &'a [T], convert: impl Fn(&'a T) -> U) -> Vec<U> {
    values.iter().skip(part).step_by(column.width.unwrap_or(1)).map(convert).collect()
}

fn write(writer: &mut ColumnWriter<'_>, column: &Column, part: usize) -> Result<()> {
    let written = match (writer, &column.values) {
        (ColumnWriter::BoolColumnWriter(w), Values::Bool(v)) => {
            w.write_batch(&every(column, part, v, |x| *x), None, None)
        }
        (ColumnWriter::Int32ColumnWriter(w), Values::U8(v)) => {
            w.write_batch(&every(column, part, v, |x| i32::from(*x)), None, None)
        }
        (ColumnWriter::Int32ColumnWriter(w), Values::U16(v)) => {
            w.write_batch(&every(column, part, v, |x| i32::from(*x)), None, None)
        }
        (ColumnWriter::Int32ColumnWriter(w), Values::U32(v)) => {
            w.write_batch(&every(column, part, v, |x| *x as i32), None, None)
        }
        (ColumnWriter::Int64ColumnWriter(w), Values::U64(v)) => {
            w.write_batch(&every(column, part, v, |x| *x as i64), None, None)
        }
        (ColumnWriter::Int64ColumnWriter(w), Values::I64(v)) => {
            w.write_batch(&every(column, part, v, |x| *x), None, None)
        }
        (ColumnWriter::DoubleColumnWriter(w), Values::F64(v)) => {
            w.write_batch(&every(column, part, v, |x| *x), None, None)
        }
        (ColumnWriter::DoubleColumnWriter(w), Values::Known(v)) => {
            let known: Vec<f64> = every(column, part, v, |x| *x).into_iter().flatten().collect();
            let levels = every(column, part, v, |x| i16::from(x.is_some()));
            w.write_batch(&known, Some(&levels), None)
        }
        (ColumnWriter::ByteArrayColumnWriter(w), Values::Text(v)) => {
            w.write_batch(&every(column, part, v, |x| ByteArray::from(x.as_str())), None, None)
        }
        _ => Err(other_columns(column)),
    };
    written.map(|_| ())
}

fn other_columns(column: &Column) -> ParquetError {
    ParquetError::General(format!("column {} is none of those that the file was begun with", column.name))
}
