//! One process's access to the topics and device queues of a stack.

use crate::BusError;
use crate::launch::{ForeignTopic, Launch};
use crate::local::{LocalTopics, kind_of};
use crate::port::{Sink, Source};
use crate::raw::RawTopic;
use crate::shared::{READERS, SharedConfig, SharedTopics};
use crossbeam_queue::ArrayQueue;
use fss_messages::Sample;
use fss_messages::topic::{self, Owner, Topic};
use std::any::Any;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::Arc;

/// A bounded lock-free queue between a device's thread and a service.
pub type Queue<T> = Arc<ArrayQueue<T>>;

enum Transport {
    Local(LocalTopics),
    Shared(SharedTopics),
}

type Queues = Rc<RefCell<BTreeMap<&'static str, Box<dyn Any>>>>;

/// What a stack has to do with other vehicles, as its launch file says.
#[derive(Clone, Debug, Default)]
pub struct Neighbours {
    /// The vehicle that is this one's target.
    pub target: Option<String>,
    /// The topics of this stack that others may hear.
    pub shared: Vec<String>,
    /// The topics of this stack that nodes of ROS 2 see, or that standard messages are made of.
    pub ros2: Vec<String>,
    /// The topics of others that are heard here, in the names of their vehicles.
    pub heard: Vec<ForeignTopic>,
}

impl Neighbours {
    /// The topics that come over the network: all that are heard except what the bridge itself says.
    pub fn received(&self) -> impl Iterator<Item = &ForeignTopic> {
        self.heard.iter().filter(|foreign| foreign.topic != topic::PEER.name)
    }

    /// The vehicles of which something comes, in the order in which they occur.
    pub fn vehicles(&self) -> Vec<&str> {
        let mut vehicles: Vec<&str> = Vec::new();
        for foreign in self.received() {
            if !vehicles.contains(&foreign.vehicle.as_str()) {
                vehicles.push(&foreign.vehicle);
            }
        }
        vehicles
    }
}

/// Topics and device queues, in local or in shared memory.
pub struct Bus {
    transport: Rc<Transport>,
    vehicle: String,
    neighbours: Neighbours,
    program_topics: Vec<RawTopic>,
    /// The most readers that a topic may have.
    readers: usize,
    queues: Queues,
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
        let (transport, vehicle) = (Rc::new(transport), String::new());
        let (neighbours, program_topics, queues) = (Neighbours::default(), Vec::new(), Queues::default());
        Self { transport, vehicle, neighbours, program_topics, readers: READERS, queues }
    }

    /// As the stack of this launch file has it: its vehicle's name, its neighbours', its limits.
    pub fn for_stack(self, launch: &Launch) -> Self {
        let readers = launch.shared_memory.readers;
        Self { neighbours: launch.neighbours(), readers, ..self.for_vehicle(&launch.vehicle) }
    }

    /// Puts the vehicle's name in front of every topic: `/chaser/nav/state`. Empty: nothing.
    pub fn for_vehicle(mut self, vehicle: &str) -> Self {
        self.vehicle = if vehicle.is_empty() { String::new() } else { format!("/{vehicle}") };
        self
    }

    /// The same memory and queues, with another vehicle's name in front of every topic.
    pub fn of_vehicle(&self, vehicle: &str) -> Self {
        let (transport, queues) = (self.transport.clone(), self.queues.clone());
        let (neighbours, program_topics) = (Neighbours::default(), Vec::new());
        let readers = self.readers;
        Self { transport, vehicle: String::new(), neighbours, program_topics, readers, queues }.for_vehicle(vehicle)
    }

    /// What the stack has to do with other vehicles.
    pub fn neighbours(&self) -> &Neighbours {
        &self.neighbours
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

    /// The same with the topics of programs that were written elsewhere.
    pub fn with_program_topics(self, topics: Vec<RawTopic>) -> Self {
        Self { program_topics: topics, ..self }
    }

    /// The topics that programs written elsewhere publish in this stack.
    pub fn program_topics(&self) -> &[RawTopic] {
        &self.program_topics
    }

    /// The name under which a topic's owner publishes it; none where the stack has no target.
    fn name_of(&self, topic: &str, owner: Owner) -> Option<String> {
        match owner {
            Owner::This => Some(self.full_name(topic)),
            Owner::Target => self.neighbours.target.as_ref().map(|target| format!("/{target}{topic}")),
        }
    }

    pub(crate) fn source<T: Sample>(&self, topic: Topic<T>, capacity: usize) -> Result<Source<T>, BusError> {
        let Some(name) = self.name_of(topic.name, topic.owner) else { return Ok(Source::Silent) };
        match &*self.transport {
            Transport::Local(topics) => {
                let port = topics.subscribe(&name, kind_of::<T>(), capacity);
                port.map(Source::Local).ok_or_else(|| two_types(name, T::TYPE_NAME))
            }
            Transport::Shared(topics) => topics.subscribe(&name, capacity, self.readers).map(Source::Shared),
        }
    }

    pub(crate) fn sink<T: Sample>(&self, topic: Topic<T>) -> Result<Sink<T>, BusError> {
        let Some(name) = self.name_of(topic.name, topic.owner) else { return Ok(Sink::Silent) };
        match &*self.transport {
            Transport::Local(topics) => {
                let port = topics.publisher(&name, kind_of::<T>());
                port.map(Sink::Local).ok_or_else(|| two_types(name, T::TYPE_NAME))
            }
            Transport::Shared(topics) => topics.publisher(&name, self.readers).map(Sink::Shared),
        }
    }

    /// Opens a port of a topic that is known by its definition; `silent` where its owner is a vehicle that there is not.
    pub(crate) fn open_raw<P>(
        &self,
        topic: &RawTopic,
        silent: P,
        local: impl FnOnce(&LocalTopics, &str, (&str, usize)) -> Option<P>,
        shared: impl FnOnce(&SharedTopics, &str, (&str, usize), usize) -> Result<P, BusError>,
    ) -> Result<P, BusError> {
        let Some(name) = self.name_of(&topic.name, topic.owner) else { return Ok(silent) };
        let type_name = topic.definition.type_name();
        let kind = (type_name.as_str(), topic.definition.size);
        match &*self.transport {
            Transport::Local(topics) => local(topics, &name, kind).ok_or_else(|| two_types(name, &type_name)),
            Transport::Shared(topics) => shared(topics, &name, kind, self.readers),
        }
    }
}

fn two_types(topic: String, type_name: &str) -> BusError {
    let reason = "it carries another sample already".to_owned();
    BusError::Topic { topic, sample: type_name.to_owned(), reason }
}
