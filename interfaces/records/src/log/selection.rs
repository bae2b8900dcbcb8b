//! Which samples of a log are wanted, and how they then lie.

use super::table::definition_of;
use fss_messages::{CDR_HEADER, Field};
use std::ops::{Range, RangeInclusive};

/// Which samples are wanted, and how.
#[derive(Clone, Debug)]
pub struct Selection {
    /// Topics.
    pub topics: Vec<String>,
    /// Names of the fields that are wanted of each sample; all where empty.
    pub fields: Vec<String>,
    /// Log times, ns.
    pub log_time_ns: RangeInclusive<u64>,
    /// The most samples that are given at once.
    pub most_rows: usize,
}

/// How the wanted fields of a sample lie one behind the other.
#[derive(Clone, Debug)]
pub struct Layout {
    /// The fields, at their places in what is given.
    pub fields: Vec<Field<String>>,
    /// Bytes that are given of a sample.
    pub size: usize,
    /// Bytes of a whole sample.
    whole: usize,
    /// What is taken of it.
    parts: Vec<Range<usize>>,
}

impl Layout {
    pub(super) fn of(channel: &mcap::Channel<'_>, wanted: &[String]) -> Result<Self, String> {
        let definition = definition_of(channel)?;
        let (whole, mut fields) = (definition.size, definition.fields);
        if wanted.is_empty() {
            return Ok(Self { fields, size: whole, whole, parts: std::iter::once(0..whole).collect() });
        }
        fields.retain(|field| wanted.contains(&field.name));
        let parts = fields.iter().map(|field| field.offset..field.offset + field.size()).collect();
        let mut size = 0;
        for field in &mut fields {
            field.offset = size;
            size += field.size();
        }
        Ok(Self { fields, size, whole, parts })
    }

    /// Appends what is wanted of a message.
    pub(super) fn take(&self, message: &[u8], to: &mut Vec<u8>) -> Result<(), String> {
        let sample = message.get(CDR_HEADER.len()..).unwrap_or_default();
        if sample.len() < self.whole {
            return Err(format!("a sample of {} bytes has only {}", self.whole, sample.len()));
        }
        for part in &self.parts {
            to.extend_from_slice(&sample[part.clone()]);
        }
        Ok(())
    }
}

pub(super) fn overlap(range: &RangeInclusive<u64>, first_ns: u64, last_ns: u64) -> bool {
    first_ns <= *range.end() && last_ns >= *range.start()
}
