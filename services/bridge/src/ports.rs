//! Topics whose samples the bridge knows by the launch file only.

use fss_bus::launch::{ForeignTopic, NODES};
use fss_bus::{
    Batch, Bus, BusError, DeviceOutput, Feed, InputPort, InputPorts, Output, OutputPort, OutputPorts, RawBatch, Step,
    Time,
};
use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{Event, MissionGoal, PeerState, Sample};

/// Device queue of what came from the network.
pub const HEARD_QUEUE: &str = "bridge.heard";
/// Device queue of what goes to the network.
pub const SAID_QUEUE: &str = "bridge.said";
/// Device queue of what goes to nodes of ROS 2.
pub const ROS2_QUEUE: &str = "bridge.ros2";
/// Device queue of what came from nodes of ROS 2.
pub const CALLED_QUEUE: &str = "bridge.called";
/// Room for the longest sample, bytes.
pub const MAX_SAMPLE: usize = 2048;

/// A sample on its way between the service and the network's thread.
#[derive(Clone, Copy)]
pub struct Parcel {
    /// Which of the topics that are shared, or of those that are received.
    pub topic: usize,
    /// Bytes of the sample; more than [`MAX_SAMPLE`] where it is none.
    pub len: usize,
    /// The sample, filled with zeros.
    pub bytes: [u8; MAX_SAMPLE],
}

impl Parcel {
    /// Keeps what fits.
    pub fn new(topic: usize, sample: &[u8]) -> Self {
        let mut bytes = [0; MAX_SAMPLE];
        for (to, from) in bytes.iter_mut().zip(sample) {
            *to = *from;
        }
        Self { topic, len: sample.len(), bytes }
    }

    /// The sample; none where it did not fit.
    pub fn whole(&self) -> Option<&[u8]> {
        self.bytes.get(..self.len)
    }

    /// The sample, or what fits of something longer.
    pub fn sample(&self) -> &[u8] {
        &self.bytes[..self.len.min(MAX_SAMPLE)]
    }
}

/// A sample that came from another vehicle.
#[derive(Clone, Copy)]
pub struct Heard {
    /// The topic, as it stands in the launch file's `receive`, and the sample.
    pub parcel: Parcel,
    /// What came with it, as it came.
    pub envelope: Option<fss_wire::bridge::Envelope>,
    /// When it came, ns, monotonic clock.
    pub received_ns: u64,
}

/// A message that came from a node of ROS 2.
#[derive(Clone, Copy)]
pub struct Called {
    /// The topic, as it stands in the launch file's `[[ros2.receive]]`; none where it does not, and the parcel holds its name.
    pub topic: Option<usize>,
    /// Whether it is of the type that the launch file says.
    pub is_type: bool,
    /// The message.
    pub parcel: Parcel,
    /// What came with it: its number, its publisher as the session, when it was sent by the calendar; none where that could
    /// not be read.
    pub attachment: Option<fss_wire::bridge::Envelope>,
    /// When it came, ns, monotonic clock.
    pub received_ns: u64,
}

/// A sample for whoever listens.
#[derive(Clone, Copy)]
pub struct Said {
    /// The topic, as it stands in the launch file's `share`, and the sample.
    pub parcel: Parcel,
    /// Hash of its layout.
    pub layout: u64,
    /// Counts the topic's samples from 1.
    pub number: u64,
}

/// What the bridge reads: the topics that are shared, and what comes from the network.
pub struct Inputs {
    pub(crate) shared: Vec<Box<dyn SharedTopic>>,
    pub(crate) ros2: Vec<Box<dyn SharedTopic>>,
    /// What came from other vehicles.
    pub(crate) heard: Feed<Heard>,
    /// What came from nodes of ROS 2.
    pub(crate) called: Feed<Called>,
}

/// A topic of this stack, whatever its sample.
pub(crate) trait SharedTopic {
    fn refresh(&mut self);
    fn age_ns(&self, now: Time) -> u64;
    fn layout(&self) -> u64;
    /// Shows each sample that came since the last step.
    fn each(&self, show: &mut dyn FnMut(&[u8]));
}

impl<T: Sample> SharedTopic for Batch<T> {
    fn refresh(&mut self) {
        InputPort::refresh(self);
    }

    fn age_ns(&self, now: Time) -> u64 {
        InputPort::age_ns(self, now)
    }

    fn layout(&self) -> u64 {
        T::HASH
    }

    fn each(&self, show: &mut dyn FnMut(&[u8])) {
        for sample in self.samples() {
            show(sample.as_bytes());
        }
    }
}

/// A topic of a service with messages of its own.
struct ProgramTopic {
    batch: RawBatch,
    layout: u64,
}

impl SharedTopic for ProgramTopic {
    fn refresh(&mut self) {
        self.batch.refresh();
    }

    fn age_ns(&self, now: Time) -> u64 {
        self.batch.age_ns(now)
    }

    fn layout(&self) -> u64 {
        self.layout
    }

    fn each(&self, show: &mut dyn FnMut(&[u8])) {
        self.batch.samples().for_each(show);
    }
}

/// A topic of another vehicle, whatever its sample.
pub(crate) trait HeardTopic {
    fn layout(&self) -> u64;
    fn size(&self) -> usize;
    /// Publishes the sample of these bytes as it is; false where it could not be sent.
    fn relay(&self, bytes: &[u8]) -> bool;
}

impl<T: Sample> HeardTopic for Output<T> {
    fn layout(&self) -> u64 {
        T::HASH
    }

    fn size(&self) -> usize {
        size_of::<T>()
    }

    fn relay(&self, bytes: &[u8]) -> bool {
        T::read_from_bytes(bytes).is_ok_and(|sample| Output::relay(self, &sample))
    }
}

/// Opens the port of a topic that is known by its name.
struct Opener<'a, P: ?Sized> {
    bus: &'a Bus,
    name: &'a str,
    port: Option<Result<Box<P>, BusError>>,
}

impl TopicVisitor for Opener<'_, dyn SharedTopic> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        if topic.name == self.name {
            self.port = Some(Batch::open(self.bus, topic).map(|port| Box::new(port) as Box<dyn SharedTopic>));
        }
    }
}

impl TopicVisitor for Opener<'_, dyn HeardTopic> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        if topic.name == self.name {
            self.port = Some(Output::open(self.bus, topic).map(|port| Box::new(port) as Box<dyn HeardTopic>));
        }
    }
}

impl InputPorts for Inputs {
    const NAMES: &'static [&'static str] = &["heard", "shared"];

    fn open(bus: &Bus) -> Result<Self, BusError> {
        let open = |names: &[String]| {
            let mut ports = Vec::new();
            for name in names {
                let mut opener = Opener::<dyn SharedTopic> { bus, name, port: None };
                topic::visit(&mut opener);
                ports.extend(opener.port.transpose()?);
                for topic in bus.program_topics().iter().filter(|topic| topic.name == *name) {
                    let batch = RawBatch::open(bus, topic, Batch::<Event>::CAPACITY)?;
                    ports.push(Box::new(ProgramTopic { batch, layout: topic.definition.hash }));
                }
            }
            Ok::<_, BusError>(ports)
        };
        let neighbours = bus.neighbours();
        let (shared, ros2) = (open(&neighbours.shared)?, open(&neighbours.ros2)?);
        Ok(Self { shared, ros2, heard: Feed::open(bus, HEARD_QUEUE)?, called: Feed::open(bus, CALLED_QUEUE)? })
    }

    fn refresh(&mut self) {
        self.heard.refresh();
        self.called.refresh();
        for topic in self.shared.iter_mut().chain(&mut self.ros2) {
            topic.refresh();
        }
    }

    fn ages_ns(&self, now: Time, ages: &mut [u64]) {
        let shared = self.shared.iter().map(|topic| topic.age_ns(now));
        for (slot, age_ns) in ages.iter_mut().zip(std::iter::once(0).chain(shared)) {
            *slot = age_ns;
        }
    }

    /// What comes from others is in the log as it was passed on; there is nothing to compute again.
    fn record(&self, _step: &mut Step) -> bool {
        false
    }
}

/// What the bridge writes: other vehicles' topics in their names, what it knows of them, and what goes to the network.
pub struct Outputs {
    /// In the order of the launch file's `receive`, each with the number of its vehicle.
    pub(crate) heard: Vec<(usize, Box<dyn HeardTopic>)>,
    /// In the order in which the vehicles occur there.
    pub(crate) peers: Vec<Output<PeerState>>,
    /// What nodes want, and what is known of them, where the launch file has `[ros2]`.
    pub(crate) nodes: Option<(Output<MissionGoal>, Output<PeerState>)>,
    pub(crate) said: DeviceOutput<Said>,
    pub(crate) ros2: DeviceOutput<Said>,
    pub(crate) events: Output<Event>,
}

impl OutputPorts for Outputs {
    fn open(bus: &Bus) -> Result<Self, BusError> {
        let vehicles = bus.neighbours().vehicles();
        let mut heard = Vec::new();
        for foreign in bus.neighbours().received() {
            let peer = vehicles.iter().position(|vehicle| *vehicle == foreign.vehicle).unwrap_or(0);
            let of_peer = bus.of_vehicle(&foreign.vehicle);
            let mut opener = Opener::<dyn HeardTopic> { bus: &of_peer, name: foreign.topic, port: None };
            topic::visit(&mut opener);
            heard.extend(opener.port.transpose()?.map(|port| (peer, port)));
        }
        let peer_port = |vehicle: &&str| Output::open(&bus.of_vehicle(vehicle), topic::PEER);
        let of_nodes = |foreign: &&ForeignTopic| foreign.vehicle == NODES;
        let nodes = bus.neighbours().heard.iter().find(of_nodes).map(|nodes| {
            Ok::<_, BusError>((Output::open(bus, topic::MISSION_GOAL)?, peer_port(&nodes.vehicle.as_str())?))
        });
        Ok(Self {
            heard,
            nodes: nodes.transpose()?,
            peers: vehicles.iter().map(peer_port).collect::<Result<_, _>>()?,
            said: DeviceOutput::open(bus, SAID_QUEUE)?,
            ros2: DeviceOutput::open(bus, ROS2_QUEUE)?,
            events: Output::open(bus, topic::EVENTS)?,
        })
    }

    fn flush(&mut self, now: Time) -> u64 {
        let peers: u64 = self.peers.iter_mut().map(|peer| peer.flush(now)).sum();
        let nodes = self.nodes.as_mut().map_or(0, |(goal, state)| goal.flush(now) + state.flush(now));
        peers + nodes + self.said.flush(now) + self.ros2.flush(now) + self.events.flush(now)
    }
}
