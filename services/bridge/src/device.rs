//! The network: a zenoh session and the thread that owns it.
//!
//! The session is a peer with fixed endpoints: it listens where the launch file says, calls whom the launch file names, and
//! neither scouts nor gossips. State is dropped where the network does not keep up (`CongestionControl::Drop`); topics that
//! end in `/command` are waited for (`Block`), on this thread, while the queue to it loses its oldest.

use crate::Line;
use crate::ports::{Heard, Parcel, Said};
use fss_bus::launch::{Bridge as Endpoints, ForeignTopic};
use fss_bus::{DeviceThread, Queue, realtime};
use fss_messages::Event;
use fss_wire::bridge::{Envelope, key};
use std::io;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use zenoh::Wait;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;

/// How long the thread rests when there is nothing to send.
const REST: Duration = Duration::from_millis(2);
/// After this a network that could not be opened is tried again.
const RETRY: Duration = Duration::from_secs(1);
/// A connection of which nothing was heard for so long is dead, and called anew, ms.
const LEASE_MS: u32 = 2000;
/// The longest message that is looked at, bytes.
const MAX_MESSAGE: u32 = 1 << 16;

/// What the network's thread works with.
pub struct Network {
    /// This vehicle's name.
    pub vehicle: String,
    /// When this bridge started, by the calendar, ns since 1970.
    pub session: u64,
    /// Where it listens and whom it calls.
    pub endpoints: Endpoints,
    /// The topics of others that are received.
    pub receive: Vec<ForeignTopic>,
    /// What is to be sent.
    pub said: Queue<Said>,
    /// What came.
    pub heard: Queue<Heard>,
    /// What is to be told in events.
    pub words: Queue<Event>,
    /// Counts.
    pub line: Line,
}

/// The thread that owns the network; it ends when this is dropped.
#[derive(Debug)]
pub struct Device {
    _thread: DeviceThread,
}

impl Device {
    /// Starts the thread. What it cannot open it tries again, and says so.
    ///
    /// # Errors
    /// Where the thread cannot be made.
    pub fn start(network: Network) -> io::Result<Self> {
        Ok(Self { _thread: DeviceThread::start("bridge-net", move |stop| network.run(stop))? })
    }
}

/// An open session and what speaks and hears through it.
struct Open {
    publishers: Vec<Publisher<'static>>,
    _subscribers: Vec<Subscriber<()>>,
    session: zenoh::Session,
}

impl Network {
    fn run(&self, stop: &AtomicBool) {
        let mut told = false;
        while !stop.load(Ordering::Relaxed) {
            match self.open() {
                Ok(open) => {
                    self.carry(&open, stop);
                    drop(open.publishers);
                    // A connection that cannot be closed in order ends with the process.
                    let _ = open.session.close().wait();
                    return;
                }
                Err(why) => {
                    if !std::mem::replace(&mut told, true) {
                        self.say(Event::WARNING, format_args!("no network yet: {why}"));
                    }
                    std::thread::sleep(RETRY);
                }
            }
        }
    }

    fn open(&self) -> zenoh::Result<Open> {
        let session = zenoh::open(zenoh::Config::from_json5(&config(&self.endpoints))?).wait()?;
        let publisher = |topic: &str| {
            let way = if topic.ends_with("/command") { CongestionControl::Block } else { CongestionControl::Drop };
            session.declare_publisher(key(&self.vehicle, topic)).congestion_control(way).wait()
        };
        let publishers =
            self.endpoints.share.iter().map(|topic| publisher(topic.get_ref())).collect::<zenoh::Result<_>>()?;
        let subscriber = |(topic, foreign): (usize, &ForeignTopic)| {
            let (heard, line) = (self.heard.clone(), self.line.clone());
            let hear = move |sample: zenoh::sample::Sample| {
                if let Some(parcel) = received(topic, &sample)
                    && heard.force_push(parcel).is_some()
                {
                    line.lost.fetch_add(1, Ordering::Relaxed);
                }
            };
            session.declare_subscriber(key(&foreign.vehicle, foreign.topic)).callback(hear).wait()
        };
        let subscribers = self.receive.iter().enumerate().map(subscriber).collect::<zenoh::Result<_>>()?;
        Ok(Open { publishers, _subscribers: subscribers, session })
    }

    /// Sends what is said until it is told to stop.
    fn carry(&self, open: &Open, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            let Some(said) = self.said.pop() else {
                std::thread::sleep(REST);
                continue;
            };
            let (Some(publisher), Ok(now)) = (open.publishers.get(said.parcel.topic), realtime::now()) else {
                continue;
            };
            let Said { layout, number, .. } = said;
            let envelope = Envelope { layout, session: self.session, number, sent_ns: now.ns() };
            let sent = publisher.put(said.parcel.sample()).attachment(envelope.encode().as_slice()).wait();
            let count = if sent.is_ok() { &self.line.sent } else { &self.line.lost };
            count.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn say(&self, severity: u8, words: core::fmt::Arguments<'_>) {
        let now_ns = realtime::now().map_or(0, fss_bus::Time::ns);
        self.words.force_push(Event::new(now_ns, "bridge", severity, words));
    }
}

/// What came, as the gates want it.
fn received(topic: usize, sample: &zenoh::sample::Sample) -> Option<Heard> {
    let received_ns = realtime::now().ok()?.ns();
    let attachment = sample.attachment().map(zenoh::bytes::ZBytes::to_bytes);
    let envelope = attachment.and_then(|bytes| Envelope::decode(&bytes).ok());
    Some(Heard { parcel: Parcel::new(topic, &sample.payload().to_bytes()), envelope, received_ns })
}

/// The session's configuration.
fn config(endpoints: &Endpoints) -> String {
    let list = |addresses: &[SocketAddr]| {
        addresses.iter().map(|address| format!("\"tcp/{address}\"")).collect::<Vec<_>>().join(", ")
    };
    format!(
        r#"{{
            mode: "peer",
            listen: {{ endpoints: [{listen}] }},
            connect: {{
                endpoints: [{connect}], timeout_ms: -1, exit_on_failure: false,
                retry: {{ period_init_ms: 200, period_max_ms: 1000, period_increase_factor: 2 }},
            }},
            scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }},
            transport: {{ link: {{
                tx: {{ lease: {LEASE_MS}, threads: 1 }},
                rx: {{ max_message_size: {MAX_MESSAGE} }},
            }} }},
        }}"#,
        listen = list(&endpoints.listen),
        connect = list(&endpoints.connect),
    )
}
