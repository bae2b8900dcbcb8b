//! Tables as MATLAB files: a struct for each table, a field for each column. Level 5 of the format, uncompressed, as
//! MathWorks' "MAT-File Format" describes it; MATLAB, Octave and scipy read it.

use super::{Column, Table, TableError, Values, file_error};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

// Types of data elements.
const INT8: u32 = 1;
const UINT8: u32 = 2;
const UINT16: u32 = 4;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const INT64: u32 = 12;
const UINT64: u32 = 13;
const MATRIX: u32 = 14;

// Classes of arrays.
const CELL_CLASS: u16 = 1;
const STRUCT_CLASS: u16 = 2;
const CHAR_CLASS: u16 = 4;
const DOUBLE_CLASS: u16 = 6;
const UINT8_CLASS: u16 = 9;
/// Numbers that are true or false: 8-bit integers with a flag.
const LOGICAL_CLASS: u16 = UINT8_CLASS | 0x200;
const UINT16_CLASS: u16 = 11;
const UINT32_CLASS: u16 = 13;
const INT64_CLASS: u16 = 14;
const UINT64_CLASS: u16 = 15;

/// Names longer than this are cut by MATLAB.
const MAX_NAME: usize = 63;

/// A MATLAB file that is being written.
pub struct MatlabFile {
    path: PathBuf,
    out: BufWriter<File>,
}

impl MatlabFile {
    /// Begins a file; an existing file of this name is replaced.
    ///
    /// # Errors
    /// Where the file cannot be made.
    pub fn create(path: &Path) -> Result<Self, TableError> {
        let mut header = [b' '; 128];
        let text = concat!("MATLAB 5.0 MAT-file, written by fss ", env!("CARGO_PKG_VERSION"));
        header[..text.len()].copy_from_slice(text.as_bytes());
        header[116..124].fill(0);
        header[124..].copy_from_slice(&[0x00, 0x01, b'I', b'M']);
        let mut out = BufWriter::new(File::create(path).map_err(file_error(path))?);
        out.write_all(&header).map_err(file_error(path))?;
        Ok(Self { path: path.to_owned(), out })
    }

    /// Writes a table as a struct: a column of n values is an n x 1 array, one of several beside each other an n x m
    /// array, text a cell array. Missing numbers become NaN; what cannot stand in a name becomes `_`.
    ///
    /// # Errors
    /// Where the file refuses, or the table is larger than the format allows.
    pub fn append(&mut self, name: &str, table: &Table) -> Result<(), TableError> {
        let fields: Vec<Vec<u8>> = table.columns.iter().map(field).collect();
        let names: Vec<String> = table.columns.iter().map(|column| identifier(&column.name)).collect();
        // A multiple of eight, the closing zero included.
        let name_len = names.iter().map(|name| name.len() + 1).max().unwrap_or(1).next_multiple_of(32);
        let mut padded = Vec::with_capacity(names.len() * name_len);
        for name in &names {
            padded.extend_from_slice(name.as_bytes());
            padded.resize(padded.len().next_multiple_of(name_len), 0);
        }
        let mut head = array_head(STRUCT_CLASS, [1, 1], &identifier(name));
        // The length of names is a small element: type and size in four bytes, value in the next four.
        head.extend_from_slice(&(4 << 16 | INT32).to_le_bytes());
        head.extend_from_slice(&(name_len as u32).to_le_bytes());
        element(&mut head, INT8, &padded);
        let bytes = (head.len() + fields.iter().map(Vec::len).sum::<usize>()) as u64;
        let Ok(size) = u32::try_from(bytes) else {
            return Err(TableError::TooLarge { path: self.path.clone(), name: name.to_owned(), bytes });
        };
        let mut write = |bytes: &[u8]| self.out.write_all(bytes).map_err(file_error(&self.path));
        write(&MATRIX.to_le_bytes())?;
        write(&size.to_le_bytes())?;
        write(&head)?;
        fields.iter().try_for_each(|field| write(field))
    }

    /// Ends the file.
    ///
    /// # Errors
    /// Where the file refuses.
    pub fn finish(mut self) -> Result<(), TableError> {
        self.out.flush().map_err(file_error(&self.path))
    }
}

/// A name that MATLAB takes for a variable or a field.
fn identifier(name: &str) -> String {
    let name: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    let name = if name.starts_with(|c: char| c.is_ascii_alphabetic()) { name } else { format!("x{name}") };
    name.chars().take(MAX_NAME).collect()
}

/// Appends a data element: type, size, bytes, and zeros up to a multiple of eight.
fn element(out: &mut Vec<u8>, kind: u32, bytes: &[u8]) {
    out.extend_from_slice(&kind.to_le_bytes());
    out.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
    out.extend_from_slice(bytes);
    out.resize(out.len().next_multiple_of(8), 0);
}

/// Flags, dimensions and name, with which every array begins.
fn array_head(class: u16, dimensions: [usize; 2], name: &str) -> Vec<u8> {
    let mut head = Vec::new();
    element(&mut head, UINT32, &u64::from(class).to_le_bytes());
    element(&mut head, INT32, &dimensions.map(|n| (n as i32).to_le_bytes()).concat());
    element(&mut head, INT8, name.as_bytes());
    head
}

/// An array without a name, as fields and cells hold them.
fn array(class: u16, dimensions: [usize; 2], kind: u32, bytes: &[u8]) -> Vec<u8> {
    let mut content = array_head(class, dimensions, "");
    element(&mut content, kind, bytes);
    let mut out = Vec::with_capacity(content.len() + 8);
    element(&mut out, MATRIX, &content);
    out
}

fn field(column: &Column) -> Vec<u8> {
    let width = column.width.unwrap_or(1);
    let rows = column.values.len() / width.max(1);
    macro_rules! numbers {
        ($class:ident, $kind:ident, $values:expr, $number:expr) => {
            array($class, [rows, width], $kind, &by_columns($values, width, |value| $number(value).to_le_bytes()))
        };
    }
    match &column.values {
        Values::Bool(v) => numbers!(LOGICAL_CLASS, UINT8, v, |x: &bool| u8::from(*x)),
        Values::U8(v) => numbers!(UINT8_CLASS, UINT8, v, |x: &u8| *x),
        Values::U16(v) => numbers!(UINT16_CLASS, UINT16, v, |x: &u16| *x),
        Values::U32(v) => numbers!(UINT32_CLASS, UINT32, v, |x: &u32| *x),
        Values::U64(v) => numbers!(UINT64_CLASS, UINT64, v, |x: &u64| *x),
        Values::I64(v) => numbers!(INT64_CLASS, INT64, v, |x: &i64| *x),
        Values::F64(v) => numbers!(DOUBLE_CLASS, DOUBLE, v, |x: &f64| *x),
        Values::Known(v) => numbers!(DOUBLE_CLASS, DOUBLE, v, |x: &Option<f64>| x.unwrap_or(f64::NAN)),
        Values::Text(v) => cells(v),
    }
}

/// MATLAB's order: one column after the other.
fn by_columns<T, const N: usize>(values: &[T], width: usize, bytes: impl Fn(&T) -> [u8; N]) -> Vec<u8> {
    (0..width).flat_map(|i| values.iter().skip(i).step_by(width)).flat_map(bytes).collect()
}

fn cells(texts: &[String]) -> Vec<u8> {
    let mut content = array_head(CELL_CLASS, [texts.len(), 1], "");
    for text in texts {
        let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        content.extend(array(CHAR_CLASS, [usize::from(!units.is_empty()), units.len() / 2], UINT16, &units));
    }
    let mut out = Vec::with_capacity(content.len() + 8);
    element(&mut out, MATRIX, &content);
    out
}
