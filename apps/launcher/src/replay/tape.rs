//! What a log holds of a flight, ready to be looked up by step.

use fss_bus::launch::Launch;
use fss_bus::{InputPorts, OutputPorts, PortVisitor, Service};
use fss_messages::topic::{self, Owner, Topic};
use fss_messages::{Sample, Step, text_of};
use fss_records::log::{Collect, Log, LogError, Samples};
use miette::{Result, miette};
use std::any::Any;
use std::collections::HashMap;

/// The samples of a topic in the order of their publication.
pub(crate) struct Recorded<T> {
    /// The topic, whose name is without the vehicle's.
    pub topic: Topic<T>,
    samples: Samples<T>,
}

/// A topic whatever its sample.
trait AnyRecorded: Any {
    fn collect(&mut self) -> &mut dyn Collect;
    fn sort(&mut self);
}

impl<T: Sample> AnyRecorded for Recorded<T> {
    fn collect(&mut self) -> &mut dyn Collect {
        &mut self.samples
    }

    fn sort(&mut self) {
        // Another vehicle's samples are on its own clock: they stay in the order in which they came.
        if self.topic.owner == Owner::This {
            self.samples.samples.sort_by_key(|sample| sample.header().published_ns);
        }
    }
}

impl<T: Sample> Recorded<T> {
    /// Of another vehicle's samples, the place of the first of this sequence from the `from`-th on.
    pub(crate) fn next_of_sequence(&self, sequence: u64, from: usize) -> Option<usize> {
        let rest = self.samples.samples.get(from..)?;
        rest.iter().position(|sample| sample.header().sequence == sequence).map(|place| from + place)
    }

    /// The `count` samples up to the one of this place; none where there are not so many.
    pub(crate) fn up_to(&self, place: usize, count: usize) -> Option<&[T]> {
        self.samples.samples.get((place + 1).checked_sub(count)?..=place)
    }

    /// What was published at this time: by one step, unless several services speak on the topic.
    pub(crate) fn at(&self, published_ns: u64) -> &[T] {
        let from = self.samples.samples.partition_point(|sample| sample.header().published_ns < published_ns);
        let to = self.samples.samples.partition_point(|sample| sample.header().published_ns <= published_ns);
        &self.samples.samples[from..to]
    }

    /// The place of the newest sample of this sequence that was published by `until_ns`: a publisher that starts anew counts anew.
    pub(crate) fn of_sequence(&self, sequence: u64, until_ns: u64) -> Option<usize> {
        let end = self.samples.samples.partition_point(|sample| sample.header().published_ns <= until_ns);
        self.samples.samples[..end].iter().rposition(|sample| sample.header().sequence == sequence)
    }

    /// The newest that was published before `published_ns`.
    pub(crate) fn before(&self, published_ns: u64) -> Option<&T> {
        self.samples.samples
            [..self.samples.samples.partition_point(|sample| sample.header().published_ns < published_ns)]
            .last()
    }

    /// All from `published_ns` on.
    pub(crate) fn since(&self, published_ns: u64) -> &[T] {
        &self.samples.samples
            [self.samples.samples.partition_point(|sample| sample.header().published_ns < published_ns)..]
    }
}

/// The topics that services read and write, and the record of their steps.
pub(crate) struct Tape {
    launch: Launch,
    topics: HashMap<(&'static str, Owner), Box<dyn AnyRecorded>>,
    /// Every step of every service, in the order of the log.
    pub steps: Vec<Step>,
}

impl PortVisitor for Tape {
    fn topic<T: Sample>(&mut self, topic: Topic<T>) {
        let samples = Samples::<T>::of(&self.full_name(&topic));
        self.topics.entry((topic.name, topic.owner)).or_insert_with(|| Box::new(Recorded { topic, samples }));
    }

    fn device(&mut self, _queue: &'static str) {}
}

impl Tape {
    /// Of a flight of this launch file's vehicle, without any topic.
    pub(crate) fn new(launch: &Launch) -> Self {
        Self { launch: launch.clone(), topics: HashMap::new(), steps: Vec::new() }
    }

    /// The name under which a topic's owner publishes it; one that nobody has where there is no target.
    fn full_name<T>(&self, topic: &Topic<T>) -> String {
        let owner = match topic.owner {
            Owner::This => self.launch.vehicle.as_str(),
            Owner::Target => self.launch.target_vehicle.as_deref().unwrap_or("-"),
        };
        if owner.is_empty() { topic.name.to_owned() } else { format!("/{owner}{}", topic.name) }
    }

    /// Adds the topics of a service's ports.
    pub(crate) fn with_ports_of<S: Service>(mut self) -> Self {
        S::Inputs::visit(&mut self);
        S::Outputs::visit(&mut self);
        self
    }

    /// Reads the parts of the flight, each in one pass.
    ///
    /// # Errors
    /// Where the log cannot be read, or another build recorded it.
    pub(crate) fn read(mut self, logs: &[Log]) -> Result<Self, LogError> {
        let mut steps = Samples::<Step>::of(&self.full_name(&topic::STEPS));
        let mut all: Vec<&mut dyn Collect> = self.topics.values_mut().map(|recorded| recorded.collect()).collect();
        all.push(&mut steps);
        logs.iter().try_for_each(|log| log.collect(&mut all))?;
        self.topics.values_mut().for_each(|recorded| recorded.sort());
        self.steps = steps.samples;
        Ok(self)
    }

    /// What was recorded of a topic.
    ///
    /// # Errors
    /// Where no service that is replayed has a port of it.
    pub(crate) fn topic<T: Sample>(&self, topic: Topic<T>) -> Result<&Recorded<T>> {
        let recorded: Option<&dyn Any> = self.topics.get(&(topic.name, topic.owner)).map(|r| &**r as &dyn Any);
        recorded.and_then(|r| r.downcast_ref()).ok_or_else(|| miette!("no service has a port of {}", topic.name))
    }

    /// The steps of a service, life by life: each start of its process, or what the log still holds of it.
    pub(crate) fn lives(&self, service: &str) -> Vec<Vec<Step>> {
        let mut steps: Vec<Step> =
            self.steps.iter().filter(|step| text_of(&step.service) == service).copied().collect();
        steps.sort_by_key(|step| step.published_ns);
        steps.chunk_by(|a, b| b.step == a.step + 1).map(<[Step]>::to_vec).collect()
    }
}
