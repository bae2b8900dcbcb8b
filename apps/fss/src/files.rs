//! Reading the files a person writes, with errors that show the line.

use miette::{Diagnostic, NamedSource, Report, Result, SourceSpan};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A file that could not be read or that says something wrong; printed with the line in question.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[error("{path}: {message}")]
struct FileError {
    path: String,
    message: String,
    #[help]
    help: Option<String>,
    #[source_code]
    source_code: Option<NamedSource<String>>,
    #[label("here")]
    span: Option<SourceSpan>,
}

/// A file's text and where it lies.
#[derive(Clone, Debug)]
pub struct TextFile {
    /// Where it lies.
    pub path: PathBuf,
    /// What it says.
    pub text: String,
}

impl TextFile {
    /// Reads the file.
    pub fn read(path: &Path, what: &str) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| FileError {
            path: path.display().to_string(),
            message: format!("cannot read the {what}: {e}"),
            help: None,
            source_code: None,
            span: None,
        })?;
        Ok(Self { path: path.to_owned(), text })
    }

    /// What is wrong with it, where, and what to do.
    pub fn error(&self, message: String, help: String, span: Option<Range<usize>>) -> Report {
        let path = self.path.display().to_string();
        let line = span.as_ref().map(|s| self.text[..s.start.min(self.text.len())].matches('\n').count() + 1);
        FileError {
            path: line.map_or_else(|| path.clone(), |line| format!("{path}:{line}")),
            message,
            help: Some(help).filter(|h| !h.is_empty()),
            source_code: span.is_some().then(|| NamedSource::new(path, self.text.clone())),
            span: span.map(Into::into),
        }
        .into()
    }
}
