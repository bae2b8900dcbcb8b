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

/// How many samples of one topic a step may take where it wants every one; fewer than a step's record can count.
const TAKEN: usize = 64;

/// An input, as bytes: its newest sample, which stays until a newer one comes, and all that came for the step.
pub struct RawInput {
    batch: RawBatch,
    size: usize,
    /// The samples that came, one behind the other; in whole words, so that each is aligned as a sample is.
    taken: Box<[u64]>,
    count: usize,
    /// The newest one.
    newest: Box<[u64]>,
    any: bool,
}

impl RawInput {
    /// Takes `every` sample; only the newest where not.
    fn open(bus: &Bus, topic: &RawTopic, every: bool) -> Result<Self, BusError> {
        // A buffer of one overflows to the newest sample.
        let (size, capacity) = (topic.definition.size, if every { TAKEN } else { 1 });
        let words = |samples: usize| vec![0; samples * size.div_ceil(size_of::<u64>())].into_boxed_slice();
        let batch = RawBatch::open(bus, topic, capacity)?;
        Ok(Self { batch, size, taken: words(capacity), count: 0, newest: words(1), any: false })
    }

    fn refresh(&mut self) {
        self.batch.refresh();
        self.count = self.batch.samples().len();
        for (place, sample) in self.taken.as_mut_bytes().chunks_exact_mut(self.size).zip(self.batch.samples()) {
            place.copy_from_slice(sample);
        }
        if let Some(newest) = self.batch.samples().last() {
            self.newest.as_mut_bytes().copy_from_slice(newest);
            self.any = true;
        }
    }

    /// The newest sample, however old.
    pub fn get(&self) -> Option<&[u8]> {
        self.any.then(|| self.newest.as_bytes())
    }

    /// The newest sample if it came since the last step.
    pub fn fresh(&self) -> Option<&[u8]> {
        self.get().filter(|_| self.count > 0)
    }

    /// The samples that came since the last step, oldest first; at most the newest one where not every one is taken.
    pub fn samples(&self) -> impl ExactSizeIterator<Item = &[u8]> {
        self.taken.as_bytes().chunks_exact(self.size).take(self.count)
    }

    fn header(&self) -> Option<Header> {
        self.get().and_then(Header::of_sample)
    }
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
    inputs: Vec<RawInput>,
    outputs: Vec<RawStaged>,
    events: Output<Event>,
    now: Time,
}

impl RawPorts {
    /// Opens the inputs, at most [`MAX_PORTS`], each with whether every sample is taken, and the outputs.
    ///
    /// # Errors
    /// Where the bus refuses one.
    pub fn open(name: &str, inputs: &[(RawTopic, bool)], outputs: &[RawTopic], bus: &Bus) -> Result<Self, BusError> {
        let inputs = inputs.iter().take(MAX_PORTS).map(|(topic, every)| RawInput::open(bus, topic, *every));
        Ok(Self {
            name: name.to_owned(),
            inputs: inputs.collect::<Result<_, _>>()?,
            outputs: outputs.iter().map(|topic| RawStaged::open(bus, topic)).collect::<Result<_, _>>()?,
            events: Output::open(bus, topic::EVENTS)?,
            now: Time::default(),
        })
    }

    /// Takes what has come on the inputs; it is `now` until the next time.
    pub fn take(&mut self, now: Time) {
        self.inputs.iter_mut().for_each(RawInput::refresh);
        self.now = now;
    }

    /// Sends what was published at `now`; returns how many samples could not be sent.
    pub fn flush(&mut self, now: Time) -> u64 {
        let outputs: u64 = self.outputs.iter_mut().map(|output| output.flush(now)).sum();
        outputs + self.events.flush(now)
    }

    /// An input, by its place in the list of topics.
    pub fn input(&self, place: usize) -> Option<&RawInput> {
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
    /// Opens the ports, as [`RawPorts::open`] does.
    ///
    /// # Errors
    /// Where the bus refuses one.
    pub fn new(
        service: S,
        name: &str,
        inputs: &[(RawTopic, bool)],
        outputs: &[RawTopic],
        bus: &Bus,
    ) -> Result<Self, BusError> {
        let ports = RawPorts::open(name, inputs, outputs, bus)?;
        let record = Step { service: text(name), ..Step::default() };
        Ok(Self { service, ports, record, records: Output::open(bus, topic::STEPS)? })
    }
}

impl<S: RawService> Run for RawRunner<S> {
    fn name(&self) -> &str {
        &self.ports.name
    }

    fn refresh(&mut self) {
        self.ports.take(self.ports.now);
    }

    fn step(&mut self, now: Time) {
        self.ports.take(now);
        self.service.step(now, &mut self.ports);
        self.record.step += 1;
        self.record.stamp_ns = now.ns();
        for (i, input) in self.ports.inputs.iter().enumerate() {
            self.record.input[i] = input.header().map_or(0, |header| header.sequence);
            self.record.fresh[i] = input.count as u8;
        }
        self.records.publish(self.record);
    }

    fn flush(&mut self, now: Time) -> u64 {
        self.ports.flush(now) + self.records.flush(now)
    }

    fn ages_ns(&self, now: Time, ages: &mut [u64]) {
        for (slot, input) in ages.iter_mut().zip(&self.ports.inputs) {
            *slot = input.header().map_or(u64::MAX, |header| now.age_ns(header.stamp_ns));
        }
    }
}
