//! What is wrong with a mission file, where, and what to do about it.

use std::ops::Range;

/// A mission file that was refused.
///
/// [`std::fmt::Display`] gives `line L, column C: what is wrong (what to do)`; a program that wants to point into the
/// text has the byte [`span`](MissionError::span).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: {message} ({help})")]
pub struct MissionError {
    /// What is wrong.
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

/// A fault at a place in the text, before the text is at hand to count lines.
#[derive(Debug)]
pub(crate) struct Fault {
    pub(crate) span: Range<usize>,
    pub(crate) message: String,
    pub(crate) help: String,
}

impl Fault {
    pub(crate) fn new(span: Range<usize>, message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { span, message: message.into(), help: help.into() }
    }

    /// What the TOML reader found.
    pub(crate) fn from_toml(error: &toml::de::Error) -> Self {
        let message = error.message().lines().collect::<Vec<_>>().join("; ");
        let help = if message.starts_with("unknown field") {
            "check the spelling; the missions that come with fss show every key"
        } else if message.starts_with("missing field `phase`") {
            "a mission needs at least one [[phase]]"
        } else if message.starts_with("missing field") {
            "add the key to this table"
        } else {
            "correct the value or the TOML syntax"
        };
        Self::new(error.span().unwrap_or(0..0), message, help)
    }

    pub(crate) fn in_text(self, text: &str) -> MissionError {
        let before = text.get(..self.span.start).unwrap_or(text);
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        MissionError {
            message: self.message,
            help: self.help,
            line: before.matches('\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
            span: self.span,
        }
    }
}
