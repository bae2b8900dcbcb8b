//! A topic as a table: one column a field, one row a message.

use super::{Log, LogError};
use crate::table::{Column, Table, TableError, Values};
use fss_messages::{Field, Sample, SampleVisitor, Scalar, text_of, visit_samples};

/// How to read the messages of one schema.
struct Layout {
    name: &'static str,
    hash: u64,
    fields: Vec<&'static Field>,
}

struct Finder<'a> {
    schema: &'a str,
    found: Option<Layout>,
}

impl SampleVisitor for Finder<'_> {
    fn visit<T: Sample>(&mut self) {
        if self.schema.rsplit('/').next() == Some(T::NAME) {
            let fields = T::FIELDS.iter().filter(|field| !field.is_padding()).collect();
            self.found = Some(Layout { name: T::NAME, hash: T::HASH, fields });
        }
    }
}

impl Log {
    /// Gives a topic as tables of at most `most_rows` rows, one after the other: arrays are columns of several values, text
    /// is text, and what only fills a sample's layout is left out.
    ///
    /// # Errors
    /// Where the topic's schema is none of this build's, or `each` fails.
    pub fn tables(
        &self,
        topic: &str,
        most_rows: usize,
        mut each: impl FnMut(&Table) -> Result<(), TableError>,
    ) -> Result<(), LogError> {
        let refused = |sample: &'static str, reason: String| LogError::Sample {
            path: self.path().to_owned(),
            topic: topic.to_owned(),
            sample,
            reason,
        };
        let mut reading: Option<(Layout, Table)> = None;
        let mut outcome = Ok(());
        self.for_each(|channel, _, body| {
            if channel.topic != topic || outcome.is_err() {
                return;
            }
            if reading.is_none() {
                match layout_of(channel) {
                    Ok(layout) => {
                        let table = empty(&layout);
                        reading = Some((layout, table));
                    }
                    Err((sample, reason)) => outcome = Err(refused(sample, reason)),
                }
            }
            let Some((layout, table)) = &mut reading else { return };
            if table.rows() == most_rows {
                outcome = each(table).map_err(LogError::Table);
                *table = empty(layout);
            }
            if !add_row(layout, table, body) {
                outcome = Err(refused(layout.name, format!("a message has only {} bytes", body.len())));
            }
        })?;
        outcome?;
        reading.map_or(Ok(()), |(_, table)| each(&table).map_err(LogError::Table))
    }
}

fn layout_of(channel: &mcap::Channel<'_>) -> Result<Layout, (&'static str, String)> {
    let schema = channel.schema.as_ref().map_or("", |schema| schema.name.as_str());
    let mut finder = Finder { schema, found: None };
    visit_samples(&mut finder);
    let found = finder.found.ok_or_else(|| ("samples", format!("its schema is '{schema}'")))?;
    let hash = format!("{:016x}", found.hash);
    if channel.metadata.get("layout_hash").is_some_and(|other| *other != hash) {
        return Err((found.name, "another build with another layout recorded it".to_owned()));
    }
    Ok(found)
}

fn empty(layout: &Layout) -> Table {
    let column = |field: &&'static Field| {
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
        Column { name: field.name.to_owned(), width, values }
    };
    Table { columns: layout.fields.iter().map(column).collect() }
}

/// Appends a message's values; false where it is too short.
fn add_row(layout: &Layout, table: &mut Table, body: &[u8]) -> bool {
    for (field, column) in layout.fields.iter().zip(&mut table.columns) {
        let len = field.scalar.size() * field.count.unwrap_or(1);
        let Some(bytes) = body.get(field.offset..field.offset + len) else { return false };
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
