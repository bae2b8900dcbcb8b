//! Plays a service's recorded inputs to its core and compares what comes out.

use super::tape::{Recorded, Tape};
use fss_bus::{Batch, Bus, InputPort, InputPorts, Output, OutputPort, OutputPorts, PortVisitor, Runner, Service, Time};
use fss_messages::topic::{Owner, Topic, is_shared};
use fss_messages::{Field, Sample, Scalar, Step, text_of};
use miette::{IntoDiagnostic, Result, miette};
use serde::Serialize;
use std::fmt;

/// Differences that are kept of each service; the rest is counted.
const KEPT: usize = 100;

/// One place in which a recomputed sample is not the recorded one.
#[derive(Serialize)]
pub(crate) struct Difference {
    /// How often the service had been started.
    pub start: usize,
    /// The step since that start.
    pub step: u64,
    /// Time of the step since the log's first, s.
    pub time_s: f64,
    /// The topic.
    pub topic: String,
    /// The field, with its index where it is one of several; none where the sample itself is missing or too many.
    pub field: Option<String>,
    /// What the log holds.
    pub recorded: String,
    /// What came out.
    pub recomputed: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let field = self.field.as_deref().map_or_else(String::new, |field| format!(" {field}"));
        write!(f, "{}{field}: recorded {}, recomputed {}", self.topic, self.recorded, self.recomputed)
    }
}

/// What became of a service.
#[derive(Serialize)]
pub(crate) struct Verdict {
    /// Its name.
    pub service: String,
    /// How often it was started.
    pub starts: usize,
    /// Steps computed again.
    pub steps: u64,
    /// Samples compared.
    pub samples: u64,
    /// Fields that differ.
    pub difference_count: u64,
    /// The first of them.
    pub differences: Vec<Difference>,
    /// What could not be replayed, and why.
    pub gaps: Vec<String>,
}

impl Verdict {
    /// Of a service that has lived so, before anything was computed.
    pub(crate) fn of(service: &str, lives: &[Vec<Step>]) -> Self {
        Self {
            service: service.to_owned(),
            starts: lives.iter().filter(|life| life[0].step == 1).count(),
            steps: 0,
            samples: 0,
            difference_count: 0,
            differences: Vec::new(),
            gaps: Vec::new(),
        }
    }

    /// Counts a difference, and keeps it where it is one of the first.
    pub(crate) fn add(&mut self, difference: Difference) {
        self.difference_count += 1;
        if self.differences.len() < KEPT {
            self.differences.push(difference);
        }
    }
}

/// A port that gets what a step's record names.
trait Feeder {
    /// Gives a sample that was in hand before the step, though no step had seen it come; true where there was one.
    fn give_held(&mut self, _step: &Step, _port: usize) -> Result<bool, String> {
        Ok(false)
    }
    /// Gives what came for the step.
    fn give(&mut self, step: &Step, port: usize) -> Result<(), String>;
}

/// A topic.
struct FromTopic<'a, T: Sample> {
    recorded: &'a Recorded<T>,
    port: Output<T>,
    held: u64,
    /// Where the next sample is looked for, of a vehicle with another clock.
    from: usize,
}

/// As many samples as a record can count: there may have been more.
pub(super) const UNCOUNTED: usize = u8::MAX as usize;

impl<T: Sample> FromTopic<'_, T> {
    /// Gives the newest samples of which a step's record speaks, `count` of them.
    fn relay(&mut self, step: &Step, port: usize, count: usize) -> Result<(), String> {
        let (sequence, topic) = (step.input[port], self.recorded.topic);
        if count > 1 && (is_shared(topic.name) || count == UNCOUNTED) {
            return Err(format!("which samples of {} step {} used is not known", topic.name, step.step));
        }
        let place = match topic.owner {
            Owner::This => self.recorded.of_sequence(sequence, step.published_ns),
            Owner::Target => self.recorded.next_of_sequence(sequence, self.from),
        };
        let samples = place.and_then(|place| self.recorded.up_to(place, count)).ok_or_else(|| {
            format!("{} has no sample {sequence} in the log, which step {} used", topic.name, step.step)
        })?;
        for sample in samples {
            self.port.relay(sample);
        }
        (self.held, self.from) = (sequence, place.unwrap_or(self.from));
        Ok(())
    }
}

impl<T: Sample> Feeder for FromTopic<'_, T> {
    fn give_held(&mut self, step: &Step, port: usize) -> Result<bool, String> {
        let unseen = step.fresh[port] == 0 && step.input[port] != self.held;
        if unseen {
            self.relay(step, port, 1)?;
        }
        Ok(unseen)
    }

    fn give(&mut self, step: &Step, port: usize) -> Result<(), String> {
        let count = usize::from(step.fresh[port]);
        if count == 0 { Ok(()) } else { self.relay(step, port, count) }
    }
}

/// Gives a device's messages of a step, which had so many; returns how many it gave.
pub(crate) type Give<'a> = Box<dyn FnMut(&Step, u64) -> u64 + 'a>;

/// A device: gives what it had for the step, and says how many messages that were.
pub(crate) struct FromDevice<'a> {
    /// The queue to its service.
    pub queue: &'static str,
    /// What the messages are called.
    pub name: &'static str,
    /// Whether every message leaves a trace in the log.
    pub complete: bool,
    /// Gives the messages.
    pub give: Give<'a>,
}

impl Feeder for FromDevice<'_> {
    fn give(&mut self, step: &Step, port: usize) -> Result<(), String> {
        let had = step.input[port];
        let given = (self.give)(step, had);
        if given > had || (self.complete && given < had) {
            return Err(format!("the log holds {given} of the {had} {} that step {} used", self.name, step.step));
        }
        Ok(())
    }
}

/// A topic that the service writes.
trait Checker {
    /// Compares what the step published; returns how many samples.
    fn check(&mut self, step: &Step, found: &mut dyn FnMut(&'static str, Option<String>, String, String)) -> u64;
}

/// What was recorded of an output, and what comes out now.
struct ToTopic<'a, T: Sample> {
    recorded: &'a Recorded<T>,
    recomputed: Batch<T>,
}

impl<T: Sample> Checker for ToTopic<'_, T> {
    fn check(&mut self, step: &Step, found: &mut dyn FnMut(&'static str, Option<String>, String, String)) -> u64 {
        self.recomputed.refresh();
        let topic = self.recorded.topic.name;
        // On a topic of many, only what this service said.
        let speaker = T::FIELDS.iter().find(|field| field.name == "service");
        let own = |sample: &&T| {
            speaker
                .is_none_or(|field| sample.as_bytes().get(field.offset..field.offset + 16) == Some(&step.service[..]))
        };
        let recorded: Vec<&T> = self.recorded.at(step.published_ns).iter().filter(own).collect();
        let recomputed = self.recomputed.samples();
        for (was, is) in recorded.iter().zip(recomputed) {
            if was.as_bytes() != is.as_bytes() {
                each_difference(T::FIELDS, was.as_bytes(), is.as_bytes(), |field, was, is| {
                    found(topic, Some(field), was, is);
                });
            }
        }
        if recorded.len() != recomputed.len() {
            let samples = |n: usize| format!("{n} samples");
            found(topic, None, samples(recorded.len()), samples(recomputed.len()));
        }
        recorded.len().min(recomputed.len()) as u64
    }
}

/// Calls `found` with each value of two samples' bytes that differs.
pub(crate) fn each_difference<Text: AsRef<str>>(
    fields: &[Field<Text>],
    was: &[u8],
    is: &[u8],
    mut found: impl FnMut(String, String, String),
) {
    for field in fields {
        let (size, count) = (field.scalar.size(), field.count.unwrap_or(1));
        let range = field.offset..field.offset + size * count;
        // A text is one value.
        let name = field.name.as_ref();
        if matches!(name, "service" | "text") && was[range.clone()] != is[range.clone()] {
            let words = |bytes: &[u8]| format!("\"{}\"", text_of(&bytes[range.clone()]));
            found(name.to_owned(), words(was), words(is));
            continue;
        }
        for i in 0..count {
            let at = field.offset + i * size..field.offset + (i + 1) * size;
            if was[at.clone()] != is[at.clone()] {
                let name = field.count.map_or_else(|| name.to_owned(), |_| format!("{name}.{i}"));
                found(name, value(field.scalar, &was[at.clone()]), value(field.scalar, &is[at]));
            }
        }
    }
}

/// A value as it is written in tables: a floating-point number with as many digits as give back the same bits.
fn value(scalar: Scalar, bytes: &[u8]) -> String {
    let mut word = [0; 8];
    word[..bytes.len()].copy_from_slice(bytes);
    let word = u64::from_le_bytes(word);
    match scalar {
        Scalar::F64 => format!("{:?}", f64::from_bits(word)),
        Scalar::I64 => (word as i64).to_string(),
        _ => word.to_string(),
    }
}

/// Makes what feeds each input of a service, in the order of its ports.
struct Feeders<'a, 'b> {
    bus: &'b Bus,
    tape: &'a Tape,
    devices: Vec<FromDevice<'a>>,
    all: Vec<Result<Box<dyn Feeder + 'a>>>,
}

impl<'a> PortVisitor for Feeders<'a, '_> {
    fn topic<T: Sample>(&mut self, topic: Topic<T>) {
        let open = || -> Result<Box<dyn Feeder + 'a>> {
            let port = Output::open(self.bus, topic).into_diagnostic()?;
            Ok(Box::new(FromTopic { recorded: self.tape.topic(topic)?, port, held: 0, from: 0 }))
        };
        self.all.push(open());
    }

    fn device(&mut self, queue: &'static str) {
        let place = self.devices.iter().position(|device| device.queue == queue);
        let device = place.map(|i| Box::new(self.devices.swap_remove(i)) as Box<dyn Feeder + 'a>);
        self.all.push(device.ok_or_else(|| miette!("the log does not stand for the device '{queue}'")));
    }
}

/// Makes what checks each topic that a service writes; commands to devices are not recorded.
struct Checkers<'a, 'b> {
    bus: &'b Bus,
    tape: &'a Tape,
    all: Vec<Result<Box<dyn Checker + 'a>>>,
}

impl<'a> PortVisitor for Checkers<'a, '_> {
    fn topic<T: Sample>(&mut self, topic: Topic<T>) {
        let open = || -> Result<Box<dyn Checker + 'a>> {
            let recomputed = Batch::open(self.bus, topic).into_diagnostic()?;
            Ok(Box::new(ToTopic { recorded: self.tape.topic(topic)?, recomputed }))
        };
        self.all.push(open());
    }

    fn device(&mut self, _queue: &'static str) {}
}

/// A service on a bus of its own, with all that it reads and writes.
pub(crate) struct Player<'a, S: Service> {
    runner: Runner<S>,
    /// One for each input port, in their order.
    inputs: Vec<Box<dyn Feeder + 'a>>,
    /// One for each topic that it writes.
    outputs: Vec<Box<dyn Checker + 'a>>,
}

impl<'a, S: Service> Player<'a, S> {
    /// Of a service whose topics are on the tape.
    ///
    /// # Errors
    /// Where one is not, where a device is missing, or where the bus refuses a port.
    pub(crate) fn new(service: S, bus: &Bus, tape: &'a Tape, devices: Vec<FromDevice<'a>>) -> Result<Self> {
        let runner = Runner::new(service, bus).into_diagnostic()?;
        let mut feeders = Feeders { bus, tape, devices, all: Vec::new() };
        S::Inputs::visit(&mut feeders);
        let mut checkers = Checkers { bus, tape, all: Vec::new() };
        S::Outputs::visit(&mut checkers);
        let inputs = feeders.all.into_iter().collect::<Result<_>>()?;
        Ok(Self { runner, inputs, outputs: checkers.all.into_iter().collect::<Result<_>>()? })
    }

    /// One step as its record has it.
    fn step(&mut self, step: &Step) -> Result<(), String> {
        let mut held = false;
        for (port, input) in self.inputs.iter_mut().enumerate() {
            held |= input.give_held(step, port)?;
        }
        if held {
            self.runner.inputs.refresh();
        }
        for (port, input) in self.inputs.iter_mut().enumerate() {
            input.give(step, port)?;
        }
        self.runner.step(Time::from_ns(step.stamp_ns));
        self.runner.flush(Time::from_ns(step.published_ns));
        Ok(())
    }
}

/// Replays all lives of a service; `open` makes a player for one of them, the how-manieth start of the process it is.
///
/// # Errors
/// Where a player cannot be made.
pub(crate) fn replay<'a, S: Service>(
    tape: &'a Tape,
    open: impl Fn(&[Step], u32) -> Result<Player<'a, S>>,
) -> Result<Verdict> {
    let lives = tape.lives(S::NAME);
    let mut verdict = Verdict::of(S::NAME, &lives);
    let begin_ns = tape.steps.iter().map(|step| step.stamp_ns).min().unwrap_or(0);
    let mut start = 0;
    for life in &lives {
        let (first, last) = (life[0].step, life[life.len() - 1].step);
        if first != 1 {
            verdict.gaps.push(format!("steps {first} to {last}: the log lacks the steps before them"));
            continue;
        }
        start += 1;
        let mut player = open(life, start as u32)?;
        for step in life {
            if let Err(lack) = player.step(step) {
                verdict.gaps.push(format!("steps {} to {last}: {lack}", step.step));
                break;
            }
            verdict.steps += 1;
            let time_s = step.stamp_ns.saturating_sub(begin_ns) as f64 * 1e-9;
            for output in &mut player.outputs {
                let samples = output.check(step, &mut |topic, field, recorded, recomputed| {
                    let topic = topic.to_owned();
                    verdict.add(Difference { start, step: step.step, time_s, topic, field, recorded, recomputed });
                });
                verdict.samples += samples;
            }
        }
    }
    Ok(verdict)
}
