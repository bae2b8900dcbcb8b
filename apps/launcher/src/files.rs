//! Reading the files a person writes, with errors that show the line, and writing answers.

use clap::Args;
use fss_plant::Plant;
use miette::{Diagnostic, IntoDiagnostic, NamedSource, Report, Result, SourceSpan, WrapErr, miette};
use serde::Serialize;
use std::ops::Range;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

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

/// What a command that works on a plant believes, and where its answer goes.
#[derive(Args)]
pub struct PlantAndAnswer {
    /// Plant file: what is believed before, and whatever stays as it is.
    #[arg(long, value_name = "FILE")]
    pub plant: PathBuf,
    /// The file to write.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Write the answer as JSON here too.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

impl PlantAndAnswer {
    /// Writes the answer for a machine, where one is wanted.
    pub fn write_json(&self, answer: &impl Serialize) -> Result<()> {
        let text = serde_json::to_string_pretty(answer).into_diagnostic()?;
        self.json.iter().try_for_each(|path| write(path, &text))
    }
}

/// Reads a plant file.
pub fn read_plant(path: &Path) -> Result<Plant> {
    let file = TextFile::read(path, "plant file")?;
    Plant::parse(&file.text).map_err(|e| file.error(e.message, e.help, Some(e.span)))
}

/// Writes a file and says so.
pub fn write(path: &Path, text: &str) -> Result<()> {
    write_silently(path, text)?;
    say!("{}", path.display());
    Ok(())
}

/// Writes a file.
pub fn write_silently(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).into_diagnostic().wrap_err_with(|| format!("cannot write {}", path.display()))
}

/// This very program, to be started as another process. It is found even after an upgrade has put another file in its place:
/// one flight flies one build.
pub fn this_program() -> Command {
    let mut command = Command::new("/proc/self/exe");
    command.arg0("fss");
    command
}

/// The program of a service that is one of its own: it lies beside this one.
///
/// # Errors
/// Where it does not, with how to build it.
pub fn program_of(service: &str) -> Result<PathBuf> {
    let own = std::env::current_exe().into_diagnostic().wrap_err("cannot tell where this program lies")?;
    let path = own.with_file_name(format!("fss-{service}"));
    if path.is_file() {
        return Ok(path);
    }
    let help = format!("`cargo build --release -p fss-{service}` makes it, beside fss; the Debian package has it");
    Err(miette!(help = help, "the service '{service}' is a program of its own, and {} is not there", path.display()))
}
