//! What is wrong with a plant file, where, and what to do about it.

use std::ops::Range;

/// A plant file that was refused.
///
/// [`std::fmt::Display`] gives `line L, column C: what is wrong (what to do)`; a program that
/// wants to point into the text has the byte [`span`](PlantError::span).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: {message} ({help})")]
pub struct PlantError {
    /// What is wrong, one sentence without a full stop.
    pub message: String,
    /// What to do about it.
    pub help: String,
    /// Bytes of the text that are to blame.
    pub span: Range<usize>,
    /// Line of the span's start, counted from 1.
    pub line: usize,
    /// Column of the span's start in characters, counted from 1.
    pub column: usize,
}

impl PlantError {
    /// An error at `span` of `text`.
    pub(crate) fn at(text: &str, span: Range<usize>, message: String, help: String) -> Self {
        let start = span.start.min(text.len());
        let before = text.get(..start).unwrap_or(text);
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        Self {
            message,
            help,
            line: before.matches('\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
            span,
        }
    }
}

/// A fault in a value, named by where it stands: `link/1/mass_kg` counts from 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(crate) path: String,
    pub(crate) message: String,
    pub(crate) help: String,
}

impl Fault {
    pub(crate) fn new(path: impl Into<String>, message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { path: path.into(), message: message.into(), help: help.into() }
    }
}
