//! A topic as a table: one column a field, one row a message.

use super::{Log, LogError};
use crate::table::{Column, Table, TableError, Values};
use fss_messages::{Definition, Field, Scalar, text_of};

/// The columns of a message: all of its fields but those that only fill the layout.
fn columns(definition: &Definition) -> impl Iterator<Item = &Field<String>> {
    definition.fields.iter().filter(|field| !field.is_padding())
}

impl Log {
    /// Gives a topic as tables of at most `most_rows` rows, one after the other: arrays are columns of several values, text
    /// is text, and what only fills a sample's layout is left out.
    ///
    /// # Errors
    /// Where the topic's schema is none of plain samples, or `each` fails.
    pub fn tables(
        &self,
        topic: &str,
        most_rows: usize,
        mut each: impl FnMut(&Table) -> Result<(), TableError>,
    ) -> Result<(), LogError> {
        let refused =
            |reason: String| LogError::Schema { path: self.path().to_owned(), topic: topic.to_owned(), reason };
        let mut reading: Option<(Definition, Table)> = None;
        let mut outcome = Ok(());
        self.for_each(|channel, _, body| {
            if channel.topic != topic || outcome.is_err() {
                return;
            }
            if reading.is_none() {
                match definition_of(channel) {
                    Ok(definition) => {
                        let table = empty(&definition);
                        reading = Some((definition, table));
                    }
                    Err(reason) => outcome = Err(refused(reason)),
                }
            }
            let Some((definition, table)) = &mut reading else { return };
            if table.rows() == most_rows {
                outcome = each(table).map_err(LogError::Table);
                *table = empty(definition);
            }
            if !add_row(definition, table, body) {
                let (name, len) = (&definition.name, body.len());
                outcome = Err(refused(format!("a {name} has only {len} bytes")));
            }
        })?;
        outcome?;
        reading.map_or(Ok(()), |(_, table)| each(&table).map_err(LogError::Table))
    }
}

/// What the log itself says of a topic's messages: those of another build, or of a service written elsewhere, are read as well.
///
/// # Errors
/// Where its schema is none of plain samples.
pub fn definition_of(channel: &mcap::Channel<'_>) -> Result<Definition, String> {
    let schema = channel.schema.as_ref().ok_or_else(|| "it has no schema".to_owned())?;
    let text = std::str::from_utf8(&schema.data).map_err(|e| e.to_string())?;
    Definition::parse(&schema.name, text).map_err(|e| format!("{}: {e}", schema.name))
}

fn empty(definition: &Definition) -> Table {
    let column = |field: &Field<String>| {
        let values = match field.scalar {
            _ if field.is_text() => Values::Text(Vec::new()),
            Scalar::U8 => Values::U8(Vec::new()),
            Scalar::U16 => Values::U16(Vec::new()),
            Scalar::U32 => Values::U32(Vec::new()),
            Scalar::U64 => Values::U64(Vec::new()),
            Scalar::I64 => Values::I64(Vec::new()),
            Scalar::F64 => Values::F64(Vec::new()),
        };
        let width = field.count.filter(|_| !field.is_text());
        Column { name: field.name.clone(), width, values }
    };
    Table { columns: columns(definition).map(column).collect() }
}

/// Appends a message's values; false where it is too short.
fn add_row(definition: &Definition, table: &mut Table, body: &[u8]) -> bool {
    for (field, column) in columns(definition).zip(&mut table.columns) {
        let Some(bytes) = body.get(field.offset..field.offset + field.size()) else { return false };
        push(&mut column.values, bytes);
    }
    true
}

fn push(values: &mut Values, bytes: &[u8]) {
    fn words<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [u8; N]> {
        bytes.as_chunks().0.iter().copied()
    }
    match values {
        Values::U8(v) => v.extend_from_slice(bytes),
        Values::U16(v) => v.extend(words(bytes).map(u16::from_le_bytes)),
        Values::U32(v) => v.extend(words(bytes).map(u32::from_le_bytes)),
        Values::U64(v) => v.extend(words(bytes).map(u64::from_le_bytes)),
        Values::I64(v) => v.extend(words(bytes).map(i64::from_le_bytes)),
        Values::F64(v) => v.extend(words(bytes).map(f64::from_le_bytes)),
        Values::Text(v) => v.push(text_of(bytes).to_owned()),
        // No field of a sample is one of these.
        Values::Bool(_) | Values::Known(_) => {}
    }
}
