//! Every topic as an input.

use fss_bus::{Batch, Bus, BusError, InputPort, InputPorts, RawBatch, Time};
use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{Header, Sample, Step};
use std::any::Any;

/// All topics of the stack.
pub struct AllTopics {
    topics: Vec<Box<dyn TopicInput>>,
}

/// One topic whatever its sample.
pub(crate) trait TopicInput {
    fn refresh(&mut self);
    fn age_ns(&self, now: Time) -> u64;
    /// Calls `take` with each sample that came since the last step.
    fn for_each(&self, take: &mut dyn FnMut(Header, &[u8]));
    /// Itself, as the type that it is.
    fn as_any(&self) -> &dyn Any;
}

impl<T: Sample> TopicInput for Batch<T> {
    fn refresh(&mut self) {
        InputPort::refresh(self);
    }

    fn age_ns(&self, now: Time) -> u64 {
        InputPort::age_ns(self, now)
    }

    fn for_each(&self, take: &mut dyn FnMut(Header, &[u8])) {
        for sample in self.samples() {
            take(sample.header(), sample.as_bytes());
        }
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}

impl TopicInput for RawBatch {
    fn refresh(&mut self) {
        RawBatch::refresh(self);
    }

    fn age_ns(&self, now: Time) -> u64 {
        RawBatch::age_ns(self, now)
    }

    fn for_each(&self, take: &mut dyn FnMut(Header, &[u8])) {
        for sample in self.samples() {
            if let Some(header) = Header::of_sample(sample) {
                take(header, sample);
            }
        }
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}

impl AllTopics {
    /// The topics, in the order of [`topic::NAMES`], and behind them those of services from elsewhere.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &dyn TopicInput> {
        self.topics.iter().map(AsRef::as_ref)
    }

    /// What came on a topic since the last step, oldest first.
    pub(crate) fn samples<T: Sample>(&self, topic: Topic<T>) -> &[T] {
        let place = topic::NAMES.iter().position(|name| *name == topic.name);
        let input = place.and_then(|i| self.topics.get(i)).and_then(|input| input.as_any().downcast_ref::<Batch<T>>());
        input.map_or(&[], Batch::samples)
    }
}

struct Opener<'a> {
    bus: &'a Bus,
    opened: Result<Vec<Box<dyn TopicInput>>, BusError>,
}

impl TopicVisitor for Opener<'_> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        let Ok(inputs) = &mut self.opened else { return };
        match Batch::open(self.bus, topic) {
            Ok(batch) => inputs.push(Box::new(batch)),
            Err(e) => self.opened = Err(e),
        }
    }
}

impl InputPorts for AllTopics {
    const NAMES: &'static [&'static str] = topic::NAMES;

    fn open(bus: &Bus) -> Result<Self, BusError> {
        let mut opener = Opener { bus, opened: Ok(Vec::new()) };
        topic::visit(&mut opener);
        let mut topics = opener.opened?;
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

    /// What it took changes nothing in flight: there is nothing to compute again.
    fn record(&self, _step: &mut Step) -> bool {
        false
    }
}
