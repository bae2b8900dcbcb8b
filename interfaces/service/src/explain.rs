//! Errors as a person reads them: what is wrong, why, where, and what to do.

use miette::{Diagnostic, ReportHandler, Severity, SourceSpan};
use std::fmt;

/// Lets a program of fss tell its errors so: the message, its causes, the line of the file that is wrong, and the help.
pub fn explain_errors() {
    // A second hook is not taken; then the first explains.
    let _ = miette::set_hook(Box::new(|_| Box::new(Plain)));
}

struct Plain;

impl ReportHandler for Plain {
    fn debug(&self, error: &dyn Diagnostic, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if error.severity() == Some(Severity::Warning) { "warning: " } else { "" };
        let mut said = error.to_string();
        write!(f, "{kind}{said}")?;
        let mut cause = error.source();
        while let Some(reason) = cause {
            // Some messages end with their cause's.
            let words = reason.to_string();
            if !said.ends_with(&words) {
                write!(f, "\n  because {words}")?;
            }
            (said, cause) = (words, reason.source());
        }
        places(error, f)?;
        error.help().map_or(Ok(()), |help| write!(f, "\n  help: {help}"))
    }
}

/// The lines of its file that an error points at, each with a mark below.
fn places(error: &dyn Diagnostic, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    let (Some(source), Some(labels)) = (error.source_code(), error.labels()) else { return Ok(()) };
    for label in labels {
        let before: SourceSpan = (0, label.offset() + label.len()).into();
        // What points beyond its text is told by the message alone.
        let Ok(read) = source.read_span(&before, 0, 1) else { continue };
        let text = String::from_utf8_lossy(read.data());
        let Some(head) = text.get(..label.offset()) else { continue };
        let start = head.rfind('\n').map_or(0, |end| end + 1);
        let line = text[start..].lines().next().unwrap_or_default();
        let (number, column) = (head.matches('\n').count() + 1, head[start..].chars().count());
        let margin = number.to_string().len();
        let marked = label.len().clamp(1, line.chars().count().saturating_sub(column).max(1));
        write!(f, "\n  {number} | {line}")?;
        write!(f, "\n  {:margin$} | {:column$}{}", "", "", "^".repeat(marked))?;
        if let Some(words) = label.label() {
            write!(f, " {words}")?;
        }
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use miette::{NamedSource, WrapErr};

    #[derive(Debug, thiserror::Error, Diagnostic)]
    #[error("launch.toml:2: there is no service 'fusoin'")]
    #[diagnostic(help("the services are fusion and base"))]
    struct Wrong {
        #[source_code]
        file: NamedSource<String>,
        #[label("here")]
        at: SourceSpan,
    }

    #[test]
    fn an_error_shows_its_line_its_cause_and_what_to_do() {
        explain_errors();
        let text = "[[service]]\nname = \"fusoin\"\nrate_hz = 100\n";
        let at = text.find("\"fusoin\"").unwrap();
        let wrong = Wrong { file: NamedSource::new("launch.toml", text.to_owned()), at: (at, 8).into() };
        let report = Err::<(), _>(miette::Report::new(wrong)).wrap_err("cannot fly").unwrap_err();
        let said = format!("{report:?}");
        let lines = [
            "cannot fly",
            "  because launch.toml:2: there is no service 'fusoin'",
            "  2 | name = \"fusoin\"",
            "    |        ^^^^^^^^ here",
            "  help: the services are fusion and base",
        ];
        assert_eq!(said, lines.join("\n"));
    }

    #[test]
    fn a_cause_that_the_message_ends_with_is_not_told_twice() {
        explain_errors();
        #[derive(Debug, thiserror::Error, Diagnostic)]
        #[error("run.mcap: {source}")]
        struct Unread {
            source: std::io::Error,
        }
        let unread = Unread { source: std::io::Error::other("no such file") };
        assert_eq!(format!("{:?}", miette::Report::new(unread)), "run.mcap: no such file");
    }
}
