//! One process's access to the topics and device queues of a stack.

use crate::BusError;
use crate::local::LocalTopics;
use crate::port::{Sink, Source};
use crate::shared::{SharedConfig, SharedTopics};
use crossbeam::queue::ArrayQueue;
use fss_messages::Sample;
use fss_messages::topic::Topic;
use std::any::Any;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A bounded lock-free queue between a device's thread and a service.
pub type Queue<T> = Arc<ArrayQueue<T>>;

enum Transport {
    Local(LocalTopics),
    Shared(SharedTopics),
}

/// Topics and device queues, in local or in shared memory.
pub struct Bus {
    transport: Transport,
    vehicle: String,
    queues: RefCell<BTreeMap<&'static str, Box<dyn Any>>>,
}

impl Bus {
    /// Topics in this process's own memory.
    pub fn local() -> Self {
        Self::new(Transport::Local(LocalTopics::default()))
    }

    /// Topics in shared memory.
    ///
    /// # Errors
    /// Where shared memory cannot be joined.
    pub fn shared(config: &SharedConfig) -> Result<Self, BusError> {
        Ok(Self::new(Transport::Shared(SharedTopics::join(config)?)))
    }

    fn new(transport: Transport) -> Self {
        Self { transport, vehicle: String::new(), queues: RefCell::default() }
    }

    /// Puts the vehicle's name in front of every topic: `/chaser/nav/state`. Empty: nothing.
    pub fn for_vehicle(mut self, vehicle: &str) -> Self {
        self.vehicle = if vehicle.is_empty() { String::new() } else { format!("/{vehicle}") };
        self
    }

    /// A topic's name with the vehicle's in front.
    pub fn full_name(&self, topic: &str) -> String {
        format!("{}{topic}", self.vehicle)
    }

    /// The device queue of this name; all who name it share it. The first to open it sets its capacity.
    ///
    /// # Errors
    /// Where it was opened before with another message type.
    pub fn queue<T: Send + 'static>(&self, name: &'static str, capacity: usize) -> Result<Queue<T>, BusError> {
        let mut queues = self.queues.borrow_mut();
        let queue = queues.entry(name).or_insert_with(|| Box::new(Arc::new(ArrayQueue::<T>::new(capacity))));
        queue.downcast_ref::<Queue<T>>().cloned().ok_or_else(|| BusError::Queue(name.to_owned()))
    }

    pub(crate) fn source<T: Sample>(&self, topic: Topic<T>, capacity: usize) -> Result<Source<T>, BusError> {
        let name = self.full_name(topic.name);
        match &self.transport {
            Transport::Local(topics) => {
                topics.subscribe(&name, capacity).map(Source::Local).ok_or_else(|| two_types::<T>(name))
            }
            Transport::Shared(topics) => topics.subscribe(&name, capacity).map(Source::Shared),
        }
    }

    pub(crate) fn sink<T: Sample>(&self, topic: Topic<T>) -> Result<Sink<T>, BusError> {
        let name = self.full_name(topic.name);
        match &self.transport {
            Transport::Local(topics) => topics.publisher(&name).map(Sink::Local).ok_or_else(|| two_types::<T>(name)),
            Transport::Shared(topics) => topics.publisher(&name).map(Sink::Shared),
        }
    }
}

fn two_types<T: Sample>(topic: String) -> BusError {
    BusError::Topic { topic, sample: T::NAME, reason: "it carries another sample already".to_owned() }
}
