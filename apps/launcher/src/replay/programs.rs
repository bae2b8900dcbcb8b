//! Services that are programs of their own, computed again: each is started anew, and stepped with the inputs that the log holds.

use super::player::{Difference, UNCOUNTED, Verdict, each_difference};
use super::tape::Tape;
use crate::follower::Follower;
use crate::stack::Stack;
use fss_bus::{Bus, BusError, RawBatch, RawOutput, RawTopic, Time};
use fss_messages::topic::{Owner, is_shared};
use fss_messages::{Step, text, text_of};
use fss_records::log::Log;
use fss_service::{PortDescription, ProgramEntry};
use miette::{IntoDiagnostic, Result, miette};
use std::collections::BTreeMap;

/// Where a sample of a topic on which many speak names its service.
const SERVICE: std::ops::Range<usize> = 24..40;

/// A sample as the log has it.
struct Sample {
    sequence: u64,
    published_ns: u64,
    bytes: Vec<u8>,
}

/// What a log holds of the topics of programs, by their full names, in the order of their publication.
type Recorded = BTreeMap<String, Vec<Sample>>;

/// Replays every service that does not come with fss, but for those that `is_replayed` already.
///
/// # Errors
/// Where the logs cannot be read, or a program does not describe plain samples.
pub(super) fn replay_all(
    stack: &Stack,
    tape: &Tape,
    logs: &[Log],
    is_replayed: impl Fn(&str) -> bool,
) -> Result<Vec<Verdict>> {
    let topics = |ports: &[PortDescription]| ports.iter().map(PortDescription::to_topic).collect::<Result<Vec<_>>>();
    let mut verdicts = Vec::new();
    for program in stack.programs.iter().filter(|program| !is_replayed(&program.description.service)) {
        let (inputs, outputs) = (topics(&program.description.inputs)?, topics(&program.description.outputs)?);
        let recorded = read(stack, logs, inputs.iter().chain(&outputs))?;
        let player = Player { stack, program, inputs, outputs, recorded };
        verdicts.push(player.replay(tape));
    }
    Ok(verdicts)
}

/// Reads the topics in one pass over each log.
fn read<'a>(stack: &Stack, logs: &[Log], topics: impl Iterator<Item = &'a RawTopic>) -> Result<Recorded> {
    let mut hashes = BTreeMap::new();
    let mut recorded = Recorded::new();
    for topic in topics {
        if let Some(name) = full_name(stack, topic) {
            hashes.insert(name.clone(), format!("{:016x}", topic.definition.hash));
            recorded.insert(name, Vec::new());
        }
    }
    let mut other = None;
    for log in logs {
        log.for_each(|channel, _, bytes| {
            let Some(samples) = recorded.get_mut(&channel.topic) else { return };
            if samples.is_empty() && channel.metadata.get("layout_hash") != hashes.get(&channel.topic) {
                other = Some(channel.topic.clone());
            }
            let number =
                |at: usize| bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |b| u64::from_le_bytes(*b));
            samples.push(Sample { sequence: number(0), published_ns: number(16), bytes: bytes.to_vec() });
        })
        .into_diagnostic()?;
    }
    if let Some(topic) = other {
        return Err(miette!("the log holds {topic} with another layout than its program says"));
    }
    for topic in recorded.values_mut() {
        topic.sort_by_key(|sample| sample.published_ns);
    }
    Ok(recorded)
}

/// The name under which a topic's owner publishes it; none where there is no target.
fn full_name(stack: &Stack, topic: &RawTopic) -> Option<String> {
    let owner = match topic.owner {
        Owner::This => stack.launch.vehicle.as_str(),
        Owner::Target => stack.launch.target_vehicle.as_deref()?,
    };
    Some(if owner.is_empty() { topic.name.clone() } else { format!("/{owner}{}", topic.name) })
}

/// A program with what the log holds of its topics.
struct Player<'a> {
    stack: &'a Stack,
    program: &'a ProgramEntry,
    inputs: Vec<RawTopic>,
    outputs: Vec<RawTopic>,
    recorded: Recorded,
}

/// One life of the program, played again.
struct Life {
    follower: Follower,
    inputs: Vec<RawOutput>,
    /// Sequence of the newest sample that each input was given.
    given: Vec<u64>,
    outputs: Vec<RawBatch>,
}

impl Player<'_> {
    fn replay(&self, tape: &Tape) -> Verdict {
        let name = &self.program.description.service;
        let lives = tape.lives(name);
        let mut verdict = Verdict::of(name, &lives);
        let begin_ns = tape.steps.iter().map(|step| step.stamp_ns).min().unwrap_or(0);
        let mut start = 0;
        for steps in &lives {
            let (first, last) = (steps[0].step, steps[steps.len() - 1].step);
            if first != 1 {
                verdict.gaps.push(format!("steps {first} to {last}: the log lacks the steps before them"));
                continue;
            }
            start += 1;
            let mut life = match self.start(start as u32) {
                Ok(life) => life,
                Err(reason) => {
                    verdict.gaps.push(format!("steps {first} to {last}: {reason:#}"));
                    continue;
                }
            };
            for step in steps {
                if let Err(lack) = self.step(&mut life, step) {
                    verdict.gaps.push(format!("steps {} to {last}: {lack}", step.step));
                    break;
                }
                verdict.steps += 1;
                let time_s = step.stamp_ns.saturating_sub(begin_ns) as f64 * 1e-9;
                self.check(&mut life, step, &mut verdict, (start, time_s));
            }
        }
        verdict
    }

    /// Starts its process, for the how-manieth time.
    fn start(&self, starts: u32) -> Result<Life> {
        let name = &self.program.description.service;
        let help = "replay the log with the program that flew it";
        let elsewhere = || miette!(help = help, "'{name}' is linked into another program than this; {help}");
        let path = self.program.path.as_ref().ok_or_else(elsewhere)?;
        if !path.exists() {
            return Err(miette!("there is no program {}", path.display()));
        }
        let bus = Bus::local().for_stack(&self.stack.launch);
        let follower = Follower::start(self.stack, (path, &self.program.description), &bus, 1, starts)?;
        let inputs = self.inputs.iter().map(|topic| RawOutput::open(&bus, topic)).collect::<Result<_, BusError>>();
        let outputs =
            self.outputs.iter().map(|topic| RawBatch::open(&bus, topic, 256)).collect::<Result<_, BusError>>();
        let (inputs, outputs) = (inputs.into_diagnostic()?, outputs.into_diagnostic()?);
        Ok(Life { follower, inputs, given: vec![0; self.inputs.len()], outputs })
    }

    /// One step as its record has it.
    fn step(&self, life: &mut Life, step: &Step) -> Result<(), String> {
        // What was in hand before the step, though no step had seen it come.
        let unseen: Vec<usize> =
            (0..self.inputs.len()).filter(|&i| step.fresh[i] == 0 && step.input[i] != life.given[i]).collect();
        for &port in &unseen {
            self.give(life, step, port, 1)?;
        }
        if !unseen.is_empty() {
            life.follower.refresh().map_err(|e| e.to_string())?;
        }
        for port in 0..self.inputs.len() {
            self.give(life, step, port, usize::from(step.fresh[port]))?;
        }
        let (now, flush) = (Time::from_ns(step.stamp_ns), Time::from_ns(step.published_ns));
        life.follower.step(now, flush).map_err(|e| e.to_string())
    }

    /// Gives the newest samples of which a step's record speaks.
    fn give(&self, life: &mut Life, step: &Step, port: usize, count: usize) -> Result<(), String> {
        if count == 0 {
            return Ok(());
        }
        let (topic, sequence) = (&self.inputs[port], step.input[port]);
        let lacks = || format!("{} has no sample {sequence} in the log, which step {} used", topic.name, step.step);
        if is_shared(&topic.name) || count == UNCOUNTED {
            return Err(format!("which samples of {} step {} used is not known", topic.name, step.step));
        }
        let samples = full_name(self.stack, topic).and_then(|name| self.recorded.get(&name)).ok_or_else(lacks)?;
        // Another vehicle's times are on its own clock.
        let is_own = topic.owner == Owner::This;
        let is_it = |s: &Sample| s.sequence == sequence && (!is_own || s.published_ns <= step.published_ns);
        let last = samples.iter().rposition(is_it).ok_or_else(lacks)?;
        let first = (last + 1).checked_sub(count).ok_or_else(lacks)?;
        for sample in &samples[first..=last] {
            life.inputs[port].relay(&sample.bytes);
        }
        life.given[port] = sequence;
        Ok(())
    }

    /// Compares what the step published.
    fn check(&self, life: &mut Life, step: &Step, verdict: &mut Verdict, (start, time_s): (usize, f64)) {
        let service: [u8; 16] = text(text_of(&step.service));
        for (topic, output) in self.outputs.iter().zip(&mut life.outputs) {
            output.refresh();
            let all =
                full_name(self.stack, topic).and_then(|name| self.recorded.get(&name)).map_or(&[][..], Vec::as_slice);
            let from = all.partition_point(|sample| sample.published_ns < step.published_ns);
            let to = all.partition_point(|sample| sample.published_ns <= step.published_ns);
            let is_own = |s: &&Sample| !is_shared(&topic.name) || s.bytes.get(SERVICE) == Some(&service[..]);
            let was: Vec<&Sample> = all[from..to].iter().filter(is_own).collect();
            let is: Vec<&[u8]> = output.samples().collect();
            let mut found = |field, recorded, recomputed| {
                let topic = topic.name.clone();
                verdict.add(Difference { start, step: step.step, time_s, topic, field, recorded, recomputed });
            };
            for (was, is) in was.iter().zip(&is).filter(|(was, is)| was.bytes != **is) {
                each_difference(&topic.definition.fields, &was.bytes, is, |field, was, is| found(Some(field), was, is));
            }
            if was.len() != is.len() {
                found(None, format!("{} samples", was.len()), format!("{} samples", is.len()));
            }
            verdict.samples += was.len().min(is.len()) as u64;
        }
    }
}
