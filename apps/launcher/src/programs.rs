//! Services of a stack that do not come with fss: found, asked what they are, and checked against the rest of the stack.

use crate::files::TextFile;
use crate::services::{Services, published_by};
use fss_bus::launch::{Launch, Schedule};
use fss_messages::Definition;
use fss_messages::topic::{self, Topic, TopicVisitor, is_shared};
use fss_messages::{MAX_PORTS, Sample};
use fss_service::{Description, PortDescription, ProgramEntry};
use miette::{IntoDiagnostic, Report, Result};
use std::collections::BTreeMap;
use std::io::Read;
use std::ops::Range;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long a program may take to say what it is.
const DESCRIBE_TIME: Duration = Duration::from_secs(5);
/// The most that is kept of what a program says, bytes.
const MOST_SAID: usize = 1 << 20;

/// Finds the programs of a launch file's services, and asks each what it reads and writes.
///
/// # Errors
/// At the line of the launch file whose program is not there, cannot run, refuses its config, or does not go with the others.
pub(crate) fn find(launch: &Launch, file: &TextFile) -> Result<Vec<ProgramEntry>> {
    let mut programs = Vec::new();
    for service in &launch.services {
        let Some(program) = &service.program else {
            programs.extend(linked(service, file)?);
            continue;
        };
        let at = |message: String, help: &str| file.error(message, help.to_owned(), Some(program.span()));
        let path = locate(program.get_ref(), &file.path, at)?;
        let description = ask(&path, service, file, at)?;
        programs.push(ProgramEntry { path: Some(path), description });
    }
    check(launch, &programs).map_err(|e| file.error(e.message, e.help, e.span))?;
    Ok(programs)
}

/// A service that is linked into this program, where it came from elsewhere.
fn linked(service: &Schedule, file: &TextFile) -> Result<Option<ProgramEntry>> {
    let entry = Services::linked().get(service.name.get_ref());
    let guest = entry.filter(|entry| entry.is_guest());
    match (guest, &service.config) {
        (None, Some(config)) => {
            let message = format!("'{}' is no service of one's own, and takes no config", service.name.get_ref());
            let help = "the services of fss take what they need from the plant file and the mission file";
            Err(file.error(message, help.to_owned(), Some(config.span())))
        }
        (None, None) => Ok(None),
        (Some(guest), config) => {
            guest.check(&service.config_text()).map_err(|e| {
                let span = config.as_ref().map_or_else(|| service.name.span(), toml::Spanned::span);
                let words = e.to_string();
                let span = key_of(&words, &file.text, span);
                file.error(words, String::new(), Some(span))
            })?;
            Ok(Some(ProgramEntry { path: None, description: guest.description() }))
        }
    }
}

/// The absolute path of a program that can be started: from the launch file's folder, or, by its bare name, one of those beside fss.
fn locate(program: &Path, launch_file: &Path, at: impl Fn(String, &str) -> Report) -> Result<PathBuf> {
    let folder = launch_file.parent().unwrap_or(Path::new(""));
    let mut path = std::path::absolute(folder.join(program)).into_diagnostic()?;
    let own = std::env::current_exe().into_diagnostic()?;
    if !path.exists() && program.components().count() == 1 && own.with_file_name(program).is_file() {
        path = own.with_file_name(program);
    }
    let Ok(meta) = path.metadata() else {
        let help = "build it, or correct the path, which is taken from the launch file's folder";
        return Err(at(format!("there is no program {}", path.display()), help));
    };
    if !meta.is_file() || meta.permissions().mode() & 0o111 == 0 {
        return Err(at(format!("{} is not executable", path.display()), "make it so: chmod +x"));
    }
    Ok(path)
}

/// What a program says of the service that it is to be.
fn ask(path: &Path, service: &Schedule, file: &TextFile, at: impl Fn(String, &str) -> Report) -> Result<Description> {
    let name = service.name.get_ref();
    let help = "a program of a service is made by `main!` of fss-service, and describes itself with --describe";
    let said = output_of(path, &service.config_text()).map_err(|e| at(format!("{}: {e}", path.display()), help))?;
    if !said.success {
        let words = said.errors.trim();
        return Err(match &service.config {
            Some(config) if words.contains("config of") => {
                file.error(words.to_owned(), String::new(), Some(key_of(words, &file.text, config.span())))
            }
            _ => at(format!("{} does not describe itself: {words}", path.display()), help),
        });
    }
    let description = Description::parse(&said.output).map_err(|e| at(format!("{}: {e}", path.display()), help))?;
    if description.service != *name {
        let message = format!("{} is the service '{}'", path.display(), description.service);
        return Err(file.error(message, "give the table its name".to_owned(), Some(service.name.span())));
    }
    Ok(description)
}

/// Where the key stands that a program does not know; all of its config where the words name none.
fn key_of(words: &str, text: &str, config: Range<usize>) -> Range<usize> {
    let key = words.split_once("unknown field `").and_then(|(_, rest)| rest.split_once('`')).map(|(key, _)| key);
    let place = key.and_then(|key| Some((text.get(config.start..)?.find(key)?, key.len())));
    place.map_or(config.clone(), |(at, len)| config.start + at..config.start + at + len)
}

struct Said {
    success: bool,
    output: String,
    errors: String,
}

/// Runs the program until it has described itself.
fn output_of(path: &Path, config: &str) -> Result<Said, String> {
    let mut child = Command::new(path)
        .args(["--describe", config])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| e.to_string())?;
    let texts = (drain(child.stdout.take()), drain(child.stderr.take()));
    let success = wait(&mut child)?;
    let text = |thread: JoinHandle<String>| thread.join().unwrap_or_default();
    Ok(Said { success, output: text(texts.0), errors: text(texts.1) })
}

/// Reads on a thread of its own: a pipe that nobody empties stops who writes. What is longer than [`MOST_SAID`] is let go.
pub(crate) fn drain(pipe: Option<impl Read + Send + 'static>) -> JoinHandle<String> {
    std::thread::spawn(move || {
        let (mut said, mut buffer) = (Vec::new(), [0; 4096]);
        let Some(mut pipe) = pipe else { return String::new() };
        while let Ok(n @ 1..) = pipe.read(&mut buffer) {
            let room = MOST_SAID - said.len();
            said.extend_from_slice(&buffer[..n.min(room)]);
        }
        String::from_utf8_lossy(&said).into_owned()
    })
}

fn wait(child: &mut Child) -> Result<bool, String> {
    let asked = Instant::now();
    loop {
        if let Some(status) = child.try_wait().map_err(|e| e.to_string())? {
            return Ok(status.success());
        }
        if asked.elapsed() > DESCRIBE_TIME {
            let _ = child.kill();
            let _ = child.wait();
            return Err(format!("it did not describe itself within {} s", DESCRIBE_TIME.as_secs()));
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// What does not fit, and where in the launch file.
#[derive(Debug)]
struct Misfit {
    message: String,
    help: String,
    span: Option<Range<usize>>,
}

/// What is known of a topic while the stack is put together.
#[derive(Default)]
struct Known {
    /// The type's name, with the hash of its layout.
    type_name: Option<String>,
    publisher: Option<String>,
}

/// Whether programs and services go together: one publisher a topic, one layout, and plain samples.
fn check(launch: &Launch, programs: &[ProgramEntry]) -> Result<(), Misfit> {
    let mut topics = BTreeMap::<String, Known>::new();
    topic::visit(&mut Ours(&mut topics));
    for service in launch.services.iter().filter(|service| service.program.is_none()) {
        let name = service.name.get_ref();
        for topic in published_by(name).into_iter().filter(|_| programs.iter().all(|p| p.description.service != *name))
        {
            topics.entry(topic).or_default().publisher = Some(service.name.get_ref().clone());
        }
    }
    for ProgramEntry { description, .. } in programs {
        let schedule = launch.schedule(&description.service);
        let span = schedule.and_then(|schedule| schedule.program.as_ref()).map(toml::Spanned::span);
        let refuse = |message: String, help: String| Err(Misfit { message, help, span: span.clone() });
        let name = &description.service;
        if description.inputs.len() > MAX_PORTS {
            return refuse(format!("'{name}' has more than {MAX_PORTS} inputs"), "read fewer topics".to_owned());
        }
        for port in description.inputs.iter().chain(&description.outputs) {
            if let Err((message, help)) = fits(port, &mut topics) {
                return refuse(format!("'{name}': {message}"), help);
            }
        }
        for port in description.outputs.iter().filter(|port| !is_shared(&port.topic)) {
            let known = topics.entry(port.topic.clone()).or_default();
            if let Some(other) = known.publisher.replace(name.clone()) {
                let help = format!("remove one of the two services, or let '{name}' publish a topic of its own");
                return refuse(format!("'{name}' publishes {}, which '{other}' publishes already", port.topic), help);
            }
        }
    }
    check_shared(launch, &topics)
}

/// Whether somebody publishes the topics that nodes of ROS 2 shall see.
fn check_shared(launch: &Launch, topics: &BTreeMap<String, Known>) -> Result<(), Misfit> {
    let shared = launch.ros2.iter().flat_map(|ros2| &ros2.share);
    let is_known =
        |name: &str| topic::NAMES.contains(&name) || topics.get(name).is_some_and(|known| known.publisher.is_some());
    match shared.into_iter().find(|shared| !is_known(shared.get_ref())) {
        Some(shared) => Err(Misfit {
            message: format!("there is no topic {} to share", shared.get_ref()),
            help: "topics are written without the vehicle's name: /nav/state".to_owned(),
            span: Some(shared.span()),
        }),
        None => Ok(()),
    }
}

/// Whether a port's topic can be, and has the layout that the others know; what is wrong, and what to do.
fn fits(port: &PortDescription, topics: &mut BTreeMap<String, Known>) -> Result<(), (String, String)> {
    if !topic::is_name(&port.topic) {
        let help = "it reads /word/word, of lower-case letters, digits and underscores".to_owned();
        return Err((format!("'{}' is no name of a topic", port.topic), help));
    }
    let definition = Definition::parse(&port.schema, &port.definition).map_err(|e| {
        (format!("{}: {}: {e}", port.topic, port.schema), "correct the message's definition".to_owned())
    })?;
    let known = topics.entry(port.topic.clone()).or_default().type_name.get_or_insert_with(|| definition.type_name());
    if *known != definition.type_name() {
        let message = format!("{} carries {known}, not its {}", port.topic, definition.type_name());
        return Err((message, "build all programs of a stack against the same definition of the message".to_owned()));
    }
    Ok(())
}

/// Notes the topics of this program.
struct Ours<'a>(&'a mut BTreeMap<String, Known>);

impl TopicVisitor for Ours<'_> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        let known = Known { type_name: Some(T::TYPE_NAME.to_owned()), publisher: None };
        self.0.insert(topic.name.to_owned(), known);
    }
}
