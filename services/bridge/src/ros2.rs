//! Nodes of ROS 2: a zenoh session that looks to them as a node named `fss`, and the thread that owns it.
//!
//! A sample travels with four bytes in front, as `rmw_zenoh` has it: it is the message's CDR. Standard messages are made here
//! from navigation, links, mission and health; their stamps are calendar time. Goals of nodes are handed to the service, which
//! judges them; a message of such a type on any other topic is handed over by its topic's name, to be counted.

use crate::{Called, Line, MAX_SAMPLE, Parcel, Said};
use fss_bus::launch::{Ros2, Ros2Type};
use fss_bus::{DeviceThread, Queue, RawTopic, realtime};
use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{CDR_HEADER, Definition, Event, Health, LinksState, MAX_LINKS, MissionState, NavState, Sample};
use fss_plant::Plant;
use fss_plant::urdf::{ARM_HEIGHT_M, ArmFrames, BASE};
use fss_ros2::rmw_zenoh::{Attachment, Endpoint, Node, dds_type, source_id};
use fss_ros2::robot::{Robot, diagnostics, tf_message};
use fss_ros2::standard::{self, DIAGNOSTICS, JOINT_STATE, ODOMETRY, POSE_2D, POSE_STAMPED, TF_MESSAGE};
use fss_ros2::type_hash::rihs01;
use fss_wire::bridge::Envelope;
use std::io;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use zenoh::Wait;
use zenoh::pubsub::Subscriber;
use zenoh::qos::CongestionControl;
use zenoh::sample::{Locality, Sample as ZenohSample};
use zerocopy::FromBytes;

/// How long the thread rests when there is nothing to send.
const REST: Duration = Duration::from_millis(2);
/// After this a network that could not be opened is tried again.
const RETRY: Duration = Duration::from_secs(1);
/// The longest message that is put together, bytes: where this is the nodes' router, images and point clouds pass it.
const MAX_MESSAGE: u32 = 1 << 26;
/// The topics of standard messages, and their definitions.
const STANDARD: [(&str, &standard::Definition); 4] =
    [("/tf", &TF_MESSAGE), ("/joint_states", &JOINT_STATE), ("/odom", &ODOMETRY), ("/diagnostics", &DIAGNOSTICS)];

/// What the thread works with.
pub struct Nodes {
    vehicle: String,
    launch: Ros2,
    robot: Robot,
    /// The message and its RIHS01, of each topic that is shared.
    types: Vec<(String, String)>,
    queues: Queues,
    line: Line,
}

/// The queues between the thread and the service.
pub struct Queues {
    /// What nodes shall see.
    pub said: Queue<Said>,
    /// What came from nodes.
    pub called: Queue<Called>,
    /// What is to be told in events.
    pub words: Queue<Event>,
}

/// The definition of a message that is a goal.
fn definition_of(kind: Ros2Type) -> &'static standard::Definition {
    match kind {
        Ros2Type::PoseStamped => &POSE_STAMPED,
        Ros2Type::Pose2d => &POSE_2D,
        Ros2Type::JointState => &JOINT_STATE,
    }
}

/// The thread; it ends when this is dropped.
#[derive(Debug)]
pub struct Device {
    _thread: DeviceThread,
}

impl Device {
    /// Starts the thread. What it cannot open it tries again, and says so.
    ///
    /// # Errors
    /// Where the thread cannot be made.
    pub fn start(nodes: Nodes) -> io::Result<Self> {
        Ok(Self { _thread: DeviceThread::start("bridge-ros2", move |stop| nodes.run(stop))? })
    }
}

/// A publisher, and how many samples it has sent.
struct Speaker {
    topic: String,
    publisher: zenoh::pubsub::Publisher<'static>,
    source: [u8; 16],
    number: i64,
}

/// An open session and what it says.
struct Open {
    shared: Vec<Speaker>,
    standard: Vec<Speaker>,
    _tokens: Vec<zenoh::liveliness::LivelinessToken>,
    _subscribers: Vec<Subscriber<()>>,
    session: zenoh::Session,
}

impl Nodes {
    /// Those who may see this vehicle; `others` are the topics of services with messages of their own.
    ///
    /// # Errors
    /// Names a topic that is shared and cannot be.
    pub fn new(
        (vehicle, launch): (String, Ros2),
        plant: &Plant,
        others: &[RawTopic],
        queues: Queues,
        line: Line,
    ) -> Result<Self, String> {
        let prefix = if vehicle.is_empty() { String::new() } else { format!("{vehicle}/") };
        let robot = robot(plant, prefix);
        let types = launch.share.iter().map(|topic| type_of(topic.get_ref(), others)).collect::<Result<_, _>>()?;
        Ok(Self { vehicle, launch, robot, types, queues, line })
    }

    fn run(&self, stop: &AtomicBool) {
        let mut told = false;
        while !stop.load(Ordering::Relaxed) {
            match self.open() {
                Ok(mut open) => {
                    self.carry(&mut open, stop);
                    // A connection that cannot be closed in order ends with the process.
                    let _ = open.session.close().wait();
                    return;
                }
                Err(why) => {
                    if !std::mem::replace(&mut told, true) {
                        let now_ns = realtime::now().map_or(0, fss_bus::Time::ns);
                        let words = format_args!("no ROS 2 yet: {why}");
                        self.queues.words.force_push(Event::new(now_ns, "bridge", Event::WARNING, words));
                    }
                    std::thread::sleep(RETRY);
                }
            }
        }
    }

    fn open(&self) -> zenoh::Result<Open> {
        let session = zenoh::open(zenoh::Config::from_json5(&config(&self.launch))?).wait()?;
        let node = Node { domain: self.launch.domain, session: session.zid().to_string(), name: "fss".to_owned() };
        let mut tokens = vec![session.liveliness().declare_token(node.token()).wait()?];
        let front = if self.vehicle.is_empty() { String::new() } else { format!("/{}", self.vehicle) };
        let mut speaker = |topic: &str, schema: &str, hash: String, id: u32| -> zenoh::Result<Speaker> {
            let publisher = Endpoint { topic: format!("{front}{topic}"), schema: schema.to_owned(), hash, id };
            let token = node.publisher_token(&publisher);
            let source = source_id(&token);
            let key = node.key(&publisher);
            let publisher = session.declare_publisher(key).congestion_control(CongestionControl::Drop).wait()?;
            tokens.push(session.liveliness().declare_token(token).wait()?);
            Ok(Speaker { topic: topic.to_owned(), publisher, source, number: 0 })
        };
        let mut shared = Vec::new();
        for ((topic, (schema, hash)), id) in self.launch.share.iter().zip(&self.types).zip(1..) {
            shared.push(speaker(topic.get_ref(), schema, hash.clone(), id)?);
        }
        let mut standard = Vec::new();
        for ((topic, definition), id) in STANDARD.into_iter().zip(1000..).filter(|_| self.launch.standard) {
            standard.push(speaker(topic, definition.name, definition.hash(), id)?);
        }
        let subscribers = self.subscribe(&session, &node, &mut tokens)?;
        Ok(Open { shared, standard, _tokens: tokens, _subscribers: subscribers, session })
    }

    /// Hears the topics that the launch file names, whatever comes on them, and messages that could be goals on all others.
    fn subscribe(
        &self,
        session: &zenoh::Session,
        node: &Node,
        tokens: &mut Vec<zenoh::liveliness::LivelinessToken>,
    ) -> zenoh::Result<Vec<Subscriber<()>>> {
        let (domain, mut subscribers) = (self.launch.domain, Vec::new());
        let names: Vec<String> = self.launch.receive.iter().map(|receive| receive.topic.get_ref().clone()).collect();
        for (topic, (receive, id)) in self.launch.receive.iter().zip(2000..).enumerate() {
            let definition = definition_of(receive.kind);
            let (schema, hash) = (definition.name.to_owned(), definition.hash());
            let subscription = Endpoint { topic: receive.topic.get_ref().clone(), schema, hash, id };
            tokens.push(session.liveliness().declare_token(node.subscription_token(&subscription)).wait()?);
            let key = node.key(&subscription);
            subscribers.push(self.hear(session, format!("{domain}{}/*/*", subscription.topic), move |sample| {
                Some((Some(topic), sample.key_expr().as_str() == key, payload(topic, sample)))
            })?);
        }
        for definition in [&POSE_STAMPED, &POSE_2D, &JOINT_STATE] {
            let (kind, names) = (dds_type(definition.name), names.clone());
            subscribers.push(self.hear(session, format!("{domain}/**/{kind}/*"), move |sample| {
                let (_, rest) = sample.key_expr().as_str().split_once('/')?;
                let name = format!("/{}", rest.rsplitn(3, '/').nth(2)?);
                (!names.contains(&name)).then(|| (None, false, Parcel::new(0, name.as_bytes())))
            })?);
        }
        Ok(subscribers)
    }

    /// Hands over what `look` makes of each message of other sessions: topic, whether it is of its type, parcel.
    fn hear(
        &self,
        session: &zenoh::Session,
        key: String,
        look: impl Fn(&ZenohSample) -> Option<(Option<usize>, bool, Parcel)> + Send + Sync + 'static,
    ) -> zenoh::Result<Subscriber<()>> {
        let (called, lost) = (self.queues.called.clone(), self.line.lost.clone());
        let hear = move |sample: ZenohSample| {
            let (Some((topic, is_type, parcel)), Ok(now)) = (look(&sample), realtime::now()) else { return };
            // What is only counted leaves room for what may be a goal.
            if topic.is_none() && called.len() > called.capacity() / 2 {
                lost.fetch_add(1, Ordering::Relaxed);
                return;
            }
            let attached = sample.attachment().and_then(|bytes| Attachment::decode(&bytes.to_bytes()));
            let attachment = attached.map(envelope);
            if called.force_push(Called { topic, is_type, parcel, attachment, received_ns: now.ns() }).is_some() {
                lost.fetch_add(1, Ordering::Relaxed);
            }
        };
        session.declare_subscriber(key).allowed_origin(Locality::Remote).callback(hear).wait()
    }

    /// Sends what is said until it is told to stop.
    fn carry(&self, open: &mut Open, stop: &AtomicBool) {
        let names = self.launch.topics();
        let mut message = Vec::new();
        while !stop.load(Ordering::Relaxed) {
            let Some(said) = self.queues.said.pop() else {
                std::thread::sleep(REST);
                continue;
            };
            let (sample, mut is_sent) = (said.parcel.sample(), true);
            if let Some(speaker) = open.shared.get_mut(said.parcel.topic) {
                message.clear();
                message.extend_from_slice(&CDR_HEADER);
                message.extend_from_slice(sample);
                is_sent = speaker.say(&message);
            }
            let Some(name) = names.get(said.parcel.topic) else { continue };
            for (topic, message) in self.standard(name, sample) {
                if let Some(speaker) = open.standard.iter_mut().find(|speaker| speaker.topic == topic) {
                    is_sent &= speaker.say(&message);
                }
            }
            let count = if is_sent { &self.line.sent } else { &self.line.lost };
            count.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// The standard messages that a sample gives.
    fn standard(&self, topic: &str, sample: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
        let robot = &self.robot;
        if topic == topic::NAV_STATE.name
            && let Ok(nav) = NavState::read_from_bytes(sample)
            && nav.mode != NavState::INITIALISING
        {
            let time_ns = calendar_ns(nav.stamp_ns);
            let pose = [nav.x_m, nav.y_m, nav.theta_rad];
            return vec![("/odom", robot.odometry(time_ns, &nav)), ("/tf", tf_message(&[robot.base(time_ns, pose)]))];
        }
        if topic == topic::LINKS_STATE.name
            && let Ok(links) = LinksState::read_from_bytes(sample)
        {
            let time_ns = calendar_ns(links.stamp_ns);
            let arm: Vec<_> = robot.arm(time_ns, &links.q_rad).collect();
            return vec![("/joint_states", robot.joint_states(time_ns, &links)), ("/tf", tf_message(&arm))];
        }
        if topic == topic::MISSION_STATE.name
            && let Ok(mission) = MissionState::read_from_bytes(sample)
            && mission.target_seen != 0
        {
            return vec![("/tf", tf_message(&[robot.target(calendar_ns(mission.stamp_ns), mission.target)]))];
        }
        if topic == topic::HEALTH.name
            && let Ok(health) = Health::read_from_bytes(sample)
        {
            return vec![("/diagnostics", diagnostics(calendar_ns(health.stamp_ns), &health))];
        }
        Vec::new()
    }
}

impl Speaker {
    fn say(&mut self, message: &[u8]) -> bool {
        self.number += 1;
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let time_ns = since.as_nanos() as i64;
        let attached = Attachment { number: self.number, time_ns, source: self.source }.encode();
        self.publisher.put(message).attachment(attached.as_slice()).wait().is_ok()
    }
}

/// The message that came; where it is longer than any goal, its length alone.
fn payload(topic: usize, sample: &ZenohSample) -> Parcel {
    let bytes = sample.payload();
    if bytes.len() > MAX_SAMPLE {
        return Parcel { len: bytes.len(), ..Parcel::new(topic, &[]) };
    }
    Parcel::new(topic, &bytes.to_bytes())
}

/// What came with a message as the gates want it: the publisher is the session, and numbers count from 1.
fn envelope(attached: Attachment) -> Envelope {
    let (id, _) = attached.source.split_first_chunk().unwrap_or((&[0; 8], &[]));
    let (number, sent_ns) = (attached.number as u64 + 1, attached.time_ns as u64);
    Envelope { layout: 0, session: u64::from_le_bytes(*id), number, sent_ns }
}

/// A time of this host's monotonic clock as calendar time, ns since 1970.
fn calendar_ns(stamp_ns: u64) -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let now_ns = realtime::now().map_or(0, fss_bus::Time::ns);
    (since.as_nanos() as u64).saturating_sub(now_ns).saturating_add(stamp_ns)
}

/// The message of a topic, and its RIHS01.
fn type_of(topic: &str, others: &[RawTopic]) -> Result<(String, String), String> {
    struct Find<'a>(&'a str, Option<Definition>);
    impl TopicVisitor for Find<'_> {
        fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
            if topic.name == self.0 {
                self.1 = Some(Definition::of::<T>());
            }
        }
    }
    let mut find = Find(topic, None);
    topic::visit(&mut find);
    let other = || others.iter().find(|other| other.name == topic).map(|other| other.definition.clone());
    let definition = find.1.or_else(other).ok_or_else(|| format!("no service publishes {topic}"))?;
    if definition.size > MAX_SAMPLE {
        return Err(format!("a sample of {topic} has {} bytes, more than {MAX_SAMPLE}", definition.size));
    }
    let schema = definition.schema();
    let hash = rihs01(&schema, &definition.text, &[]).map_err(|e| format!("{topic}: {e}"))?;
    Ok((schema, hash))
}

/// The vehicle of this plant as its URDF describes it.
fn robot(plant: &Plant, prefix: String) -> Robot {
    let ArmFrames { joints, links, origins } = ArmFrames::of(plant, MAX_LINKS);
    let (base, target) = (BASE.to_owned(), "target".to_owned());
    Robot { prefix, base, target, joints, links, origins, arm_height_m: ARM_HEIGHT_M }
}

/// The session's configuration: where it listens it is the router that nodes of ROS 2 look for.
fn config(launch: &Ros2) -> String {
    let list = |addresses: &[SocketAddr]| {
        addresses.iter().map(|address| format!("\"tcp/{address}\"")).collect::<Vec<_>>().join(", ")
    };
    let listen = launch.listen();
    let mode = if listen.is_empty() { "peer" } else { "router" };
    format!(
        r#"{{
            mode: "{mode}",
            listen: {{ endpoints: [{listen}] }},
            connect: {{
                endpoints: [{connect}], timeout_ms: -1, exit_on_failure: false,
                retry: {{ period_init_ms: 200, period_max_ms: 1000, period_increase_factor: 2 }},
            }},
            scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: true }} }},
            transport: {{ link: {{ rx: {{ max_message_size: {MAX_MESSAGE} }} }} }},
        }}"#,
        listen = list(&listen),
        connect = list(&launch.connect),
    )
}
