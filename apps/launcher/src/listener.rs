//! Hears a flight in this process: what a log would hold of it as far as its figures need it, without a log.

use crate::summary::Records;
use fss_bus::virtual_time::Tick;
use fss_bus::{Batch, Bus, BusError, InputPort, Time};
use fss_messages::Sample;
use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_records::log::TopicInfo;
use std::any::Any;

/// The topics whose samples are kept; of the others it is enough to count them.
const KEPT: [&str; 6] = [
    topic::TRUTH_STATE.name,
    topic::NAV_STATE.name,
    topic::MISSION_STATE.name,
    topic::ARM_COMMAND.name,
    topic::HEALTH.name,
    topic::EVENTS.name,
];

/// Stands where the recorder stands.
pub(crate) struct Listener {
    topics: Vec<Box<dyn Hear>>,
}

/// One topic whatever its sample.
trait Hear {
    fn hear(&mut self);
    /// What it has heard, and the samples that it kept, a `Vec` of them.
    fn told(self: Box<Self>) -> (TopicInfo, Box<dyn Any>);
}

struct Heard<T: Sample> {
    batch: Batch<T>,
    is_kept: bool,
    samples: Vec<T>,
    info: TopicInfo,
}

impl<T: Sample> Hear for Heard<T> {
    fn hear(&mut self) {
        self.batch.refresh();
        let samples = self.batch.samples();
        for published_ns in samples.iter().map(|sample| sample.header().published_ns) {
            self.info.first_ns = self.info.first_ns.min(published_ns);
            self.info.last_ns = self.info.last_ns.max(published_ns);
        }
        self.info.count += samples.len() as u64;
        if self.is_kept {
            self.samples.extend_from_slice(samples);
        }
    }

    fn told(self: Box<Self>) -> (TopicInfo, Box<dyn Any>) {
        (self.info, Box::new(self.samples))
    }
}

struct Opener<'a> {
    bus: &'a Bus,
    opened: Result<Vec<Box<dyn Hear>>, BusError>,
}

impl TopicVisitor for Opener<'_> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        let Ok(topics) = &mut self.opened else { return };
        let info = TopicInfo {
            topic: self.bus.full_name(topic.name),
            schema: String::new(),
            count: 0,
            first_ns: u64::MAX,
            last_ns: 0,
        };
        match Batch::open(self.bus, topic) {
            Ok(batch) => {
                topics.push(Box::new(Heard { batch, is_kept: KEPT.contains(&topic.name), samples: Vec::new(), info }));
            }
            Err(e) => self.opened = Err(e),
        }
    }
}

impl Listener {
    /// Listens to all topics.
    ///
    /// # Errors
    /// Where the bus refuses one.
    pub(crate) fn new(bus: &Bus) -> Result<Self, BusError> {
        let mut opener = Opener { bus, opened: Ok(Vec::new()) };
        topic::visit(&mut opener);
        Ok(Self { topics: opener.opened? })
    }

    /// What it has heard.
    pub(crate) fn told(self) -> Records {
        let mut records = Records::default();
        for (info, samples) in self.topics.into_iter().map(Hear::told) {
            if info.count > 0 {
                records.add(info, samples);
            }
        }
        records
    }
}

impl Tick for Listener {
    fn tick(&mut self, _now: Time) -> Result<(), BusError> {
        for topic in &mut self.topics {
            topic.hear();
        }
        Ok(())
    }
}
