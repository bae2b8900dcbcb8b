//! A service whose ports are known by their definitions only: its step is written in another language.

use crate::raw::{RawBatch, RawOutput, RawTopic};
use crate::runner::Run;
use crate::{Bus, BusError, Output, OutputPort, Time};
use fss_messages::{Event, Header, MAX_PORTS, Step, text, topic};
use zerocopy::IntoBytes;

/// How many samples of a topic one step may publish, as for an [`Output`].
const STAGED: usize = Output::<Event>::CAPACITY;
/// Length of a sample's header, bytes.
const HEADER: usize = size_of::<Header>();

/// The newest sample of an input, as bytes; it stays until a newer one comes.
pub struct RawLatest {
    batch: RawBatch,
    /// In whole words, so that it is aligned as a sample is.
    sample: Box<[u64]>,
    any: bool,
    fresh: bool,
}

impl RawLatest {
    fn open(bus: &Bus, topic: &RawTopic) -> Result<Self, BusError> {
        let sample = vec![0; topic.definition.size.div_ceil(size_of::<u64>())].into_boxed_slice();
        // A buffer of one overflows to the newest sample.
        Ok(Self { batch: RawBatch::open(bus, topic, 1)?, sample, any: false, fresh: false })
    }

    fn refresh(&mut self) {
        self.batch.refresh();
        let newest = self.batch.samples().last();
        self.fresh = newest.is_some();
        self.any |= self.fresh;
        if let Some(newest) = newest {
            self.sample.as_mut_bytes().copy_from_slice(newest);
        }
    }

    /// The newest sample, however old.
    pub fn get(&self) -> Option<&[u8]> {
        self.any.then(|| self.sample.as_bytes())
    }

    /// The newest sample if it came since the last step.
    pub fn fresh(&self) -> Option<&[u8]> {
        self.get().filter(|_| self.fresh)
    }

    fn header(&self) -> Option<Header> {
        self.get().and_then(header_of)
    }
}

/// The header with which each sample starts.
fn header_of(sample: &[u8]) -> Option<Header> {
    let number = |at: usize| Some(u64::from_le_bytes(*sample.get(at..)?.first_chunk()?));
    Some(Header { sequence: number(0)?, stamp_ns: number(8)?, published_ns: number(16)? })
}

/// What a step publishes on one topic, until the step has ended.
struct RawStaged {
    output: RawOutput,
    size: usize,
    staged: Vec<u8>,
    sequence: u64,
    dropped: u64,
}

impl RawStaged {
    fn open(bus: &Bus, topic: &RawTopic) -> Result<Self, BusError> {
        let size = topic.definition.size;
        let staged = Vec::with_capacity(STAGED * size);
        Ok(Self { output: RawOutput::open(bus, topic)?, size, staged, sequence: 0, dropped: 0 })
    }

    fn publish(&mut self, sample: &[u8]) -> bool {
        let fits = sample.len() == self.size && self.staged.len() + self.size <= self.staged.capacity();
        if fits {
            self.staged.extend_from_slice(sample);
        } else {
            self.dropped += 1;
        }
        fits
    }

    fn flush(&mut self, now: Time) -> u64 {
        let mut dropped = std::mem::take(&mut self.dropped);
        if self.staged.is_empty() {
            self.output.let_go();
        }
        for sample in self.staged.chunks_exact_mut(self.size) {
            self.sequence += 1;
            sample[..8].copy_from_slice(&self.sequence.to_le_bytes());
            sample[16..HEADER].copy_from_slice(&now.ns().to_le_bytes());
            dropped += u64::from(!self.output.relay(sample));
        }
        self.staged.clear();
        dropped
    }
}

/// The ports of such a service.
pub struct RawPorts {
    name: String,
    inputs: Vec<RawLatest>,
    outputs: Vec<RawStaged>,
    events: Output<Event>,
    now: Time,
}

impl RawPorts {
    /// An input, by its place in the list of topics.
    pub fn input(&self, place: usize) -> Option<&RawLatest> {
        self.inputs.get(place)
    }

    /// Publishes a sample on an output, by its place in the list of topics; the port sets its sequence and time of publication. False
    /// where there is no such output, the sample is not of its size, or the step has published too many.
    pub fn publish(&mut self, place: usize, sample: &[u8]) -> bool {
        self.outputs.get_mut(place).is_some_and(|output| output.publish(sample))
    }

    /// Says that something happened, with one of the severities of [`Event`].
    pub fn event(&mut self, severity: u8, message: &str) {
        self.events.publish(Event::new(self.now.ns(), &self.name, severity, format_args!("{message}")));
    }
}

/// A pure step on ports that are known by their definitions only.
pub trait RawService {
    /// One step at `now`.
    fn step(&mut self, now: Time, ports: &mut RawPorts);
}

/// Such a service and its open ports.
pub struct RawRunner<S> {
    service: S,
    ports: RawPorts,
    record: Step,
    records: Output<Step>,
}

impl<S: RawService> RawRunner<S> {
    /// Opens the ports; of inputs there are at most [`MAX_PORTS`].
    ///
    /// # Errors
    /// Where the bus refuses one.
    pub fn new(service: S, name: &str, topics: [&[RawTopic]; 2], bus: &Bus) -> Result<Self, BusError> {
        let [inputs, outputs] = topics;
        let inputs = inputs.iter().take(MAX_PORTS).map(|topic| RawLatest::open(bus, topic));
        let ports = RawPorts {
            name: name.to_owned(),
            inputs: inputs.collect::<Result<_, _>>()?,
            outputs: outputs.iter().map(|topic| RawStaged::open(bus, topic)).collect::<Result<_, _>>()?,
            events: Output::open(bus, topic::EVENTS)?,
            now: Time::default(),
        };
        let record = Step { service: text(name), ..Step::default() };
        Ok(Self { service, ports, record, records: Output::open(bus, topic::STEPS)? })
    }
}

impl<S: RawService> Run for RawRunner<S> {
    fn name(&self) -> &str {
        &self.ports.name
    }

    fn refresh(&mut self) {
        self.ports.inputs.iter_mut().for_each(RawLatest::refresh);
    }

    fn step(&mut self, now: Time) {
        self.refresh();
        self.ports.now = now;
        self.service.step(now, &mut self.ports);
        self.record.step += 1;
        self.record.stamp_ns = now.ns();
        for (i, input) in self.ports.inputs.iter().enumerate() {
            self.record.input[i] = input.header().map_or(0, |header| header.sequence);
            self.record.fresh[i] = u8::from(input.fresh);
        }
        self.records.publish(self.record);
    }

    fn flush(&mut self, now: Time) -> u64 {
        let outputs: u64 = self.ports.outputs.iter_mut().map(|output| output.flush(now)).sum();
        outputs + self.ports.events.flush(now) + self.records.flush(now)
    }

    fn ages_ns(&self, now: Time, ages: &mut [u64]) {
        for (slot, input) in ages.iter_mut().zip(&self.ports.inputs) {
            *slot = input.header().map_or(u64::MAX, |header| now.age_ns(header.stamp_ns));
        }
    }
}
