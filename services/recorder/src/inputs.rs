//! Every topic as an input.

use crate::block::Block;
use crate::tape::Definition;
use fss_bus::{Batch, Bus, BusError, InputPort, InputPorts, RawBatch, Time};
use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{Header, Sample, Step};

/// Length of a service's name in samples that several services publish.
const SERVICE_LEN: usize = 16;

/// All topics of this stack, and those of other vehicles that are heard here, as they are recorded.
pub struct AllTopics {
    topics: Vec<Box<dyn TopicInput>>,
}

impl AllTopics {
    /// The topics, in the order of [`topic::NAMES`], behind them those of other vehicles, and those of programs written elsewhere.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &dyn TopicInput> {
        self.topics.iter().map(AsRef::as_ref)
    }
}

/// One topic whatever its sample.
pub(crate) trait TopicInput {
    fn refresh(&mut self);
    fn age_ns(&self, now: Time) -> u64;
    /// Puts the batch's samples from the `from`-th on into the block; returns the number of the first that did not fit.
    fn write_to(&self, block: &mut Block, topic: usize, from: usize) -> usize;
    /// How many samples the batch has.
    fn len(&self) -> usize;
    /// How many samples are missing between those that came, by their publishers' sequences.
    fn count_gaps(&self, publishers: &mut Publishers) -> u64;
}

/// The last sequence of each publisher of a topic.
#[derive(Clone, Debug)]
pub(crate) struct Publishers(Vec<([u8; SERVICE_LEN], u64)>);

impl Default for Publishers {
    fn default() -> Self {
        Self(Vec::with_capacity(32))
    }
}

impl Publishers {
    /// Takes the next sequence of a publisher; returns how many are missing before it.
    fn follow(&mut self, publisher: [u8; SERVICE_LEN], sequence: u64) -> u64 {
        let Some((_, last)) = self.0.iter_mut().find(|(name, _)| *name == publisher) else {
            self.0.push((publisher, sequence));
            return 0;
        };
        // A smaller sequence is a restarted publisher, not a loss.
        let missing = sequence.saturating_sub(*last).saturating_sub(1);
        *last = sequence;
        missing
    }
}

struct Input<T: Sample> {
    batch: Batch<T>,
    /// Where the sample names its publisher, if several services publish on the topic.
    service_offset: Option<usize>,
    /// Whether it came over the network, which may lose samples.
    is_foreign: bool,
}

impl<T: Sample> TopicInput for Input<T> {
    fn refresh(&mut self) {
        self.batch.refresh();
    }

    fn age_ns(&self, now: Time) -> u64 {
        self.batch.age_ns(now)
    }

    fn write_to(&self, block: &mut Block, topic: usize, from: usize) -> usize {
        let samples = self.batch.samples();
        let fitting = samples.iter().skip(from).take_while(|sample| block.push(topic, sample.as_bytes())).count();
        from + fitting
    }

    fn len(&self) -> usize {
        self.batch.samples().len()
    }

    fn count_gaps(&self, publishers: &mut Publishers) -> u64 {
        if self.is_foreign {
            return 0;
        }
        let missing = |sample: &T| {
            let mut name = [0; SERVICE_LEN];
            if let Some(field) = self.service_offset.and_then(|at| sample.as_bytes().get(at..at + SERVICE_LEN)) {
                name.copy_from_slice(field);
            }
            publishers.follow(name, sample.header().sequence)
        };
        self.batch.samples().iter().map(missing).sum()
    }
}

impl TopicInput for RawBatch {
    fn refresh(&mut self) {
        RawBatch::refresh(self);
    }

    fn age_ns(&self, now: Time) -> u64 {
        RawBatch::age_ns(self, now)
    }

    fn write_to(&self, block: &mut Block, topic: usize, from: usize) -> usize {
        from + self.samples().skip(from).take_while(|sample| block.push(topic, sample)).count()
    }

    fn len(&self) -> usize {
        self.samples().len()
    }

    fn count_gaps(&self, publishers: &mut Publishers) -> u64 {
        let headers = self.samples().filter_map(Header::of_sample);
        headers.map(|header| publishers.follow([0; SERVICE_LEN], header.sequence)).sum()
    }
}

struct Opener<'a> {
    bus: &'a Bus,
    /// The one topic of another vehicle; all of this one where absent.
    only: Option<&'static str>,
    opened: &'a mut Vec<Box<dyn TopicInput>>,
    outcome: Result<(), BusError>,
}

impl TopicVisitor for Opener<'_> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        if self.outcome.is_err() || self.only.is_some_and(|only| only != topic.name) {
            return;
        }
        match Batch::open(self.bus, topic) {
            Ok(batch) => {
                let service_offset = T::FIELDS.iter().find(|field| field.name == "service").map(|field| field.offset);
                let is_foreign = self.only.is_some();
                self.opened.push(Box::new(Input::<T> { batch, service_offset, is_foreign }));
            }
            Err(e) => self.outcome = Err(e),
        }
    }
}

/// Visits all topics of a stack and then, one after another, those of other vehicles that are heard in it.
fn visit_all<E>(bus: &Bus, mut visit: impl FnMut(&Bus, Option<&'static str>) -> Result<(), E>) -> Result<(), E> {
    visit(bus, None)?;
    bus.neighbours().heard.iter().try_for_each(|foreign| visit(&bus.of_vehicle(&foreign.vehicle), Some(foreign.topic)))
}

impl InputPorts for AllTopics {
    const NAMES: &'static [&'static str] = topic::NAMES;

    fn open(bus: &Bus) -> Result<Self, BusError> {
        let mut topics = Vec::new();
        visit_all(bus, |bus, only| {
            let mut opener = Opener { bus, only, opened: &mut topics, outcome: Ok(()) };
            topic::visit(&mut opener);
            opener.outcome
        })?;
        for topic in bus.program_topics() {
            topics.push(Box::new(RawBatch::open(bus, topic, Batch::<Step>::CAPACITY)?));
        }
        Ok(Self { topics })
    }

    fn refresh(&mut self) {
        for topic in &mut self.topics {
            topic.refresh();
        }
    }

    fn ages_ns(&self, now: Time, ages: &mut [u64]) {
        for (slot, topic) in ages.iter_mut().zip(&self.topics) {
            *slot = topic.age_ns(now);
        }
    }

    /// The log itself is what this service took.
    fn record(&self, _step: &mut Step) -> bool {
        false
    }
}

struct Definitions<'a> {
    bus: &'a Bus,
    only: Option<&'static str>,
    found: &'a mut Vec<Definition>,
}

impl TopicVisitor for Definitions<'_> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        if self.only.is_none_or(|only| only == topic.name) {
            self.found.push(Definition {
                topic: self.bus.full_name(topic.name),
                // What the bridge itself says of another vehicle is on this host's clock.
                has_own_clock: self.only.is_some_and(|only| only != topic::PEER.name),
                sample: fss_messages::Definition::of::<T>(),
            });
        }
    }
}

/// How each topic is entered in a log, in the order of [`AllTopics::iter`].
pub(crate) fn definitions(bus: &Bus) -> Vec<Definition> {
    let mut definitions = Vec::new();
    let all: Result<(), std::convert::Infallible> = visit_all(bus, |bus, only| {
        topic::visit(&mut Definitions { bus, only, found: &mut definitions });
        Ok(())
    });
    let Ok(()) = all;
    definitions.extend(bus.program_topics().iter().map(|topic| Definition {
        topic: bus.full_name(&topic.name),
        has_own_clock: false,
        sample: topic.definition.clone(),
    }));
    definitions
}
