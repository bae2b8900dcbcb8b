//! Errors of Rust as exceptions of Python, with file, line and column where these are known.

use fss_plant::PlantError;
use fss_records::experiment::ExperimentError;
use fss_records::log::LogError;
use miette::{Diagnostic, Report};
use pyo3::exceptions::{PyException, PyFileNotFoundError};
use pyo3::prelude::*;
use std::error::Error as StdError;
use std::io;

pyo3::create_exception!(
    fss,
    Error,
    PyException,
    "What fss refuses or could not do. Attributes: help (what to do), file, line and column (from 1); None where unknown."
);

/// Where an error is.
#[derive(Default)]
struct Place {
    file: Option<String>,
    line: Option<usize>,
    column: Option<usize>,
}

/// Of an error with a chain of causes.
pub(crate) fn from_report(report: &Report) -> PyErr {
    let message = report.chain().map(ToString::to_string).collect::<Vec<_>>().join(": ");
    let place = report.chain().find_map(place_of).or_else(|| labelled(report.as_ref())).unwrap_or_default();
    let is_missing = report.chain().any(is_missing);
    make(&message, report.help().map(|help| help.to_string()), place, is_missing)
}

/// Of an error of a library.
pub(crate) fn from_error(error: &(dyn StdError + 'static)) -> PyErr {
    make(&error.to_string(), None, place_of(error).unwrap_or_default(), is_missing(error))
}

/// Of a refused plant file, known by a name.
pub(crate) fn of_plant(file: &str, error: &PlantError) -> PyErr {
    let place = Place { file: Some(file.to_owned()), line: Some(error.line), column: Some(error.column) };
    make(&format!("{file}:{}:{}: {}", error.line, error.column, error.message), Some(error.help.clone()), place, false)
}

fn make(message: &str, help: Option<String>, place: Place, is_missing: bool) -> PyErr {
    let text = match &help {
        Some(help) => format!("{message}\nhelp: {help}"),
        None => message.to_owned(),
    };
    let error = if is_missing { PyFileNotFoundError::new_err(text) } else { Error::new_err(text) };
    Python::attach(|py| {
        let value = error.value(py);
        let set = value
            .setattr("help", help)
            .and_then(|()| value.setattr("file", place.file))
            .and_then(|()| value.setattr("line", place.line))
            .and_then(|()| value.setattr("column", place.column));
        set.err().unwrap_or(error)
    })
}

fn place_of(error: &(dyn StdError + 'static)) -> Option<Place> {
    if let Some(error) = error.downcast_ref::<ExperimentError>() {
        let (path, line) = match error {
            ExperimentError::Cell { path, row, .. } => (path, Some(*row)),
            ExperimentError::File { path, .. } | ExperimentError::Description { path, .. } => (path, None),
        };
        return Some(Place { file: Some(path.display().to_string()), line, column: None });
    }
    let path = match error.downcast_ref::<LogError>()? {
        LogError::File { path, .. }
        | LogError::Mcap { path, .. }
        | LogError::Schema { path, .. }
        | LogError::Sample { path, .. } => path,
        LogError::Table(_) => return None,
    };
    Some(Place { file: Some(path.display().to_string()), ..Place::default() })
}

/// The place that an error points to in a text.
fn labelled(error: &dyn Diagnostic) -> Option<Place> {
    let label = error.labels()?.next()?;
    let source = error.source_code()?;
    let content = source.read_span(label.inner(), 0, 0).ok()?;
    Some(Place {
        file: content.name().map(ToOwned::to_owned),
        line: Some(content.line() + 1),
        column: Some(content.column() + 1),
    })
}

fn is_missing(error: &(dyn StdError + 'static)) -> bool {
    let of_file = |e: &io::Error| e.kind() == io::ErrorKind::NotFound;
    let mut next = Some(error);
    while let Some(error) = next {
        if error.downcast_ref::<io::Error>().is_some_and(of_file) {
            return true;
        }
        next = error.source();
    }
    false
}
