//! `fss messages`: messages and topics for services in other languages.

mod c;
mod python;
mod ros2;

use clap::Args;
use fss_launcher::files::TextFile;
use fss_messages::Sample;
use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{Definition, SampleVisitor, visit_samples};
use miette::{IntoDiagnostic, Result, miette};
use std::path::{Path, PathBuf};

/// Which messages, and for whom.
#[derive(Args)]
pub struct MessagesArgs {
    #[command(flatten)]
    language: Language,
    /// Messages of one's own, each a file PACKAGE/msg/NAME.msg; those of fss, with its topics, where absent.
    files: Vec<PathBuf>,
}

/// The languages.
#[derive(Args)]
#[group(required = true, multiple = false)]
struct Language {
    /// A C header, for `fss.h`.
    #[arg(long)]
    c: bool,
    /// A Python module of ctypes structures, for `fss.service`; iceoryx2's Python package takes them too.
    #[arg(long)]
    python: bool,
    /// A ROS 2 package for each package of messages, written into this folder; colcon builds it.
    #[arg(long, value_name = "DIR")]
    ros2: Option<PathBuf>,
}

/// A named value of a message.
struct Constant<'a> {
    name: &'a str,
    value: &'a str,
    doc: &'a str,
}

/// A topic of fss.
struct OwnTopic {
    name: &'static str,
    message: &'static str,
    doc: &'static str,
}

/// Prints them.
pub fn run(args: &MessagesArgs) -> Result<()> {
    let (definitions, topics) = if args.files.is_empty() {
        own()
    } else {
        (args.files.iter().map(|path| read(path)).collect::<Result<_>>()?, Vec::new())
    };
    if let Some(folder) = &args.language.ros2 {
        for package in ros2::write(&definitions, folder)? {
            say!("{}", folder.join(package).display());
        }
        return Ok(());
    }
    let render = if args.language.c { c::render } else { python::render };
    say_part!("{}", render(&definitions, &topics));
    Ok(())
}

/// The messages and topics of fss.
fn own() -> (Vec<Definition>, Vec<OwnTopic>) {
    struct All(Vec<Definition>, Vec<OwnTopic>);
    impl SampleVisitor for All {
        fn visit<T: Sample>(&mut self) {
            self.0.push(Definition::of::<T>());
        }
    }
    impl TopicVisitor for All {
        fn visit<T: Sample>(&mut self, topic: Topic<T>, doc: &'static str) {
            self.1.push(OwnTopic { name: topic.name, message: T::NAME, doc });
        }
    }
    let mut all = All(Vec::new(), Vec::new());
    visit_samples(&mut all);
    topic::visit(&mut all);
    (all.0, all.1)
}

/// Reads the definition of `PACKAGE/msg/NAME.msg`.
fn read(path: &Path) -> Result<Definition> {
    let file = TextFile::read(path, "message's definition")?;
    let whole = std::path::absolute(path).into_diagnostic()?.with_extension("");
    let parts: Vec<_> = whole.iter().rev().take(3).map(|part| part.to_string_lossy()).collect();
    let [name, folder, package] = parts.as_slice() else { return Err(misplaced(path)) };
    if folder != "msg" {
        return Err(misplaced(path));
    }
    Definition::parse(&format!("{package}/msg/{name}"), &file.text).map_err(|e| {
        let start = file.text.split_inclusive('\n').take(e.line - 1).map(str::len).sum::<usize>();
        let line = file.text[start..].lines().next().map_or(0, str::len);
        file.error(e.message, String::new(), Some(start..start + line))
    })
}

fn misplaced(path: &Path) -> miette::Report {
    let help = "a message lies in PACKAGE/msg/NAME.msg: its folders give its name";
    miette!(help = help, "{} lies in no folder of a package", path.display())
}

/// What a definition says first of its message.
fn doc_of(definition: &Definition) -> &str {
    definition.text.lines().next().and_then(|line| line.strip_prefix('#')).map_or("", str::trim)
}

/// The named values of a definition.
fn constants(definition: &Definition) -> impl Iterator<Item = Constant<'_>> {
    definition.text.lines().filter_map(|line| {
        let (said, doc) = line.split_once('#').unwrap_or((line, ""));
        let (name, value) = said.split_once('=')?;
        Some(Constant { name: name.split_whitespace().last()?, value: value.trim(), doc: doc.trim() })
    })
}

/// `/nav/state` as `NAV_STATE`.
fn constant_name(topic: &str) -> String {
    topic.trim_start_matches('/').replace('/', "_").to_uppercase()
}
