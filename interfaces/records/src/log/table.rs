//! A topic as a table: one column a value, one row a message.

use super::{Log, LogError};
use fss_messages::{Field, Sample, SampleVisitor, Scalar, visit_samples};
use std::io::{self, Write};

/// How to read the messages of one schema.
struct Layout {
    name: &'static str,
    hash: u64,
    fields: &'static [Field],
}

struct Finder<'a> {
    schema: &'a str,
    found: Option<Layout>,
}

impl SampleVisitor for Finder<'_> {
    fn visit<T: Sample>(&mut self) {
        if self.schema.rsplit('/').next() == Some(T::NAME) {
            self.found = Some(Layout { name: T::NAME, hash: T::HASH, fields: T::FIELDS });
        }
    }
}

impl Log {
    /// Writes a topic as CSV: arrays are spread over columns `name.0`, `name.1` and so on; floating-point numbers have
    /// as many digits as give back the same bits.
    ///
    /// # Errors
    /// Where the topic's schema is none of this build's, or the writer refuses.
    pub fn write_csv(&self, topic: &str, out: &mut impl Write) -> Result<(), LogError> {
        let unknown = |sample: &'static str, reason: String| LogError::Sample {
            path: self.path().to_owned(),
            topic: topic.to_owned(),
            sample,
            reason,
        };
        let mut layout: Option<Layout> = None;
        let mut outcome = Ok(());
        self.for_each(|channel, _, body| {
            if channel.topic != topic || outcome.is_err() {
                return;
            }
            if layout.is_none() {
                let schema = channel.schema.as_ref().map_or("", |s| s.name.as_str());
                let mut finder = Finder { schema, found: None };
                visit_samples(&mut finder);
                let Some(found) = finder.found else {
                    outcome = Err(unknown("samples", format!("its schema is '{schema}'")));
                    return;
                };
                let hash = format!("{:016x}", found.hash);
                if channel.metadata.get("layout_hash").is_some_and(|h| *h != hash) {
                    outcome = Err(unknown(found.name, "another build with another layout recorded it".to_owned()));
                    return;
                }
                outcome = header(found.fields, out).map_err(|source| self.csv_error(source));
                layout = Some(found);
            }
            if let (Ok(()), Some(layout)) = (&outcome, &layout) {
                outcome = row(layout.fields, body, out).map_err(|source| self.csv_error(source));
            }
        })?;
        outcome
    }

    fn csv_error(&self, source: io::Error) -> LogError {
        LogError::File { path: self.path().to_owned(), source }
    }
}

fn header(fields: &[Field], out: &mut impl Write) -> io::Result<()> {
    let mut separator = "";
    for field in fields {
        match field.count {
            None => write!(out, "{separator}{}", field.name)?,
            Some(n) => {
                for i in 0..n {
                    write!(out, "{separator}{}.{i}", field.name)?;
                    separator = ",";
                }
            }
        }
        separator = ",";
    }
    writeln!(out)
}

fn row(fields: &[Field], body: &[u8], out: &mut impl Write) -> io::Result<()> {
    let mut separator = "";
    for field in fields {
        let size = field.scalar.size();
        for i in 0..field.count.unwrap_or(1) {
            let at = field.offset + i * size;
            let bytes = body.get(at..at + size).ok_or(io::ErrorKind::UnexpectedEof)?;
            let mut word = [0; 8];
            word[..size].copy_from_slice(bytes);
            let word = u64::from_le_bytes(word);
            match field.scalar {
                Scalar::F64 => write!(out, "{separator}{:?}", f64::from_bits(word))?,
                Scalar::I64 => write!(out, "{separator}{}", word as i64)?,
                Scalar::U8 | Scalar::U16 | Scalar::U32 | Scalar::U64 => write!(out, "{separator}{word}")?,
            }
            separator = ",";
        }
    }
    writeln!(out)
}
