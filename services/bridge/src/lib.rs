//! Samples to and from other vehicles, over the network.
//!
//! The launch file's `[bridge]` says which topics of this stack others may hear, and which of theirs are wanted here. A
//! sample travels as it lies in shared memory, under the zenoh key `fss/VEHICLE/TOPIC`, with an envelope beside it
//! ([`fss_wire::bridge`]). What comes passes gates ([`gate`]): another build's layout, what is doubled or was overtaken, and what
//! is too old are refused and counted. What passes is published here with the same bytes in the other vehicle's name,
//! `/target/nav/state`, times on the other host's clock and all; `/target/peer` ([`PeerState`]) says what brings them to the clock of
//! this host, and how the vehicle is heard.
//!
//! The launch file's `[ros2]` says what nodes of ROS 2 see of this stack ([`ros2`]), and which of their messages are goals here
//! ([`inward`]): they pass the same gates and bounds, and are published on `/mission/goal`.
//!
//! No service of this stack obeys what is published in another vehicle's name. The bridge never runs in real time, its
//! queues are bounded and lose their oldest, and no other process waits for it: a vehicle flies on when it is gone.

pub mod clock;
pub mod device;
pub mod gate;
pub mod inward;
mod ports;
pub mod ros2;

pub use ports::{
    CALLED_QUEUE, Called, HEARD_QUEUE, Heard, Inputs, MAX_SAMPLE, Outputs, Parcel, ROS2_QUEUE, SAID_QUEUE, Said,
};

use fss_bus::launch::ForeignTopic;
use fss_bus::{Neighbours, Queue, Service, Time};
use fss_messages::{Event, PeerState};
use gate::{Arrival, Gate, Peer, Refusal};
use inward::Inward;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// What is known of another vehicle is said at least so often, ns.
const TELL_PERIOD_NS: u64 = 200_000_000;

/// How patient the bridge is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Patience {
    /// Samples that are older when they come are refused.
    pub max_age: Duration,
    /// A vehicle of which nothing was taken for so long is silent.
    pub silent_after: Duration,
}

/// What the network's thread has to say to the service.
#[derive(Clone, Debug, Default)]
pub struct Line {
    /// Samples handed to the network.
    pub sent: Arc<AtomicU64>,
    /// Samples lost because a queue was full, or because the network could not be opened.
    pub lost: Arc<AtomicU64>,
}

/// The service.
pub struct Bridge {
    peers: Vec<Known>,
    topics: Vec<Incoming>,
    /// Samples of each shared topic so far.
    numbers: Vec<u64>,
    silent_ns: u64,
    inward: Option<Inward>,
    line: Line,
    words: Queue<Event>,
}

/// Another vehicle, and what was said of it.
struct Known {
    name: String,
    peer: Peer,
    speaks: bool,
    /// The last refusal by age since it was heard, ns.
    too_old_ns: Option<u64>,
    told_layout: bool,
    told_ns: u64,
}

/// A topic of another vehicle; its port has the same place in [`Outputs`].
struct Incoming {
    name: &'static str,
    gate: Option<Gate>,
}

impl Bridge {
    /// Between a stack and its neighbours; `words` are what the network's thread wants to say.
    pub fn new(neighbours: &Neighbours, patience: Patience, line: Line, words: Queue<Event>) -> Self {
        let known = |vehicle: &str| Known {
            name: vehicle.to_owned(),
            peer: Peer::new(vehicle, patience.max_age),
            speaks: false,
            too_old_ns: None,
            told_layout: false,
            told_ns: 0,
        };
        let incoming = |foreign: &ForeignTopic| Incoming { name: foreign.topic, gate: None };
        Self {
            peers: neighbours.vehicles().into_iter().map(known).collect(),
            topics: neighbours.received().map(incoming).collect(),
            numbers: vec![0; neighbours.shared.len()],
            silent_ns: patience.silent_after.as_nanos() as u64,
            inward: None,
            line,
            words,
        }
    }

    /// The same with goals of nodes of ROS 2.
    pub fn with_nodes(self, inward: Inward) -> Self {
        Self { inward: Some(inward), ..self }
    }

    /// Lets through the goals of nodes that may pass, and says what is known of nodes.
    fn take_goals(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        let (Some(inward), Some((goals, state))) = (&mut self.inward, &mut outputs.nodes) else { return };
        for called in inputs.called.messages() {
            if let Some(goal) = inward.take(now, called, |event| outputs.events.publish(event)) {
                goals.publish(goal);
            }
        }
        if let Some(counts) = inward.tell(now) {
            let (sent, lost) = (self.line.sent.load(Ordering::Relaxed), self.line.lost.load(Ordering::Relaxed));
            state.publish(PeerState { sent, lost, ..counts });
        }
    }

    /// Lets through what may pass.
    fn take(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        for heard in inputs.heard.messages() {
            let (Some(topic), Some((peer, port))) =
                (self.topics.get_mut(heard.parcel.topic), outputs.heard.get(heard.parcel.topic))
            else {
                continue;
            };
            let Some(known) = self.peers.get_mut(*peer) else { continue };
            let gate = topic.gate.get_or_insert_with(|| Gate::new(port.layout(), port.size()));
            let arrival = Arrival {
                envelope: heard.envelope,
                len: heard.parcel.len,
                stamp_ns: stamp_of(heard.parcel.sample()),
                received_ns: heard.received_ns,
            };
            match known.peer.admit(gate, &arrival) {
                Ok(()) => {
                    if !port.relay(heard.parcel.sample()) {
                        self.line.lost.fetch_add(1, Ordering::Relaxed);
                    }
                }
                Err(Refusal::Age(age_ns)) => known.too_old_ns = Some(age_ns),
                Err(Refusal::Layout) if !known.told_layout => {
                    known.told_layout = true;
                    let (vehicle, name) = (&known.name, topic.name);
                    let words =
                        format_args!("{vehicle}'s {name} has another layout and is refused: use one build for both");
                    outputs.events.publish(event(now, Event::ERROR, words));
                }
                Err(_) => {}
            }
        }
    }

    /// Hands on what is shared.
    fn give(&mut self, inputs: &Inputs, outputs: &mut Outputs) {
        for (topic, shared) in inputs.ros2.iter().enumerate() {
            let layout = shared.layout();
            shared
                .each(&mut |sample| outputs.ros2.send(Said { parcel: Parcel::new(topic, sample), layout, number: 0 }));
        }
        for (topic, (shared, number)) in inputs.shared.iter().zip(&mut self.numbers).enumerate() {
            let layout = shared.layout();
            shared.each(&mut |sample| {
                *number += 1;
                outputs.said.send(Said { parcel: Parcel::new(topic, sample), layout, number: *number });
            });
        }
    }

    /// Says who is heard and who is not.
    fn tell(&mut self, now: Time, outputs: &mut Outputs) {
        while let Some(words) = self.words.pop() {
            outputs.events.publish(words);
        }
        for (known, port) in self.peers.iter_mut().zip(&mut outputs.peers) {
            let heard_ns = known.peer.heard_ns();
            let is_fresh = heard_ns > known.told_ns;
            let speaks = heard_ns > 0 && now.age_ns(heard_ns) <= self.silent_ns;
            if speaks != known.speaks {
                known.speaks = speaks;
                outputs.events.publish(known.turn(now));
                known.too_old_ns = None;
            }
            if is_fresh || now.age_ns(known.told_ns) >= TELL_PERIOD_NS {
                known.told_ns = now.ns();
                let mut state = known.peer.state();
                state.speaks = u8::from(speaks);
                state.sent = self.line.sent.load(Ordering::Relaxed);
                state.lost = self.line.lost.load(Ordering::Relaxed);
                port.publish(state);
            }
        }
    }
}

impl Known {
    /// What to say where it begins or ceases to be heard.
    fn turn(&self, now: Time) -> Event {
        let name = &self.name;
        if self.speaks {
            return event(now, Event::INFO, format_args!("{name} speaks"));
        }
        match self.too_old_ns {
            Some(age_ns) => {
                let age_s = age_ns as f64 * 1e-9;
                event(
                    now,
                    Event::WARNING,
                    format_args!("{name} is stale: what comes of it is {age_s:.2} s old, and refused"),
                )
            }
            None => event(now, Event::WARNING, format_args!("{name} is stale: nothing comes of it")),
        }
    }
}

fn event(now: Time, severity: u8, words: core::fmt::Arguments<'_>) -> Event {
    Event::new(now.ns(), Bridge::NAME, severity, words)
}

/// The stamp with which each sample goes, behind its sequence; the latest possible one where there is none.
fn stamp_of(sample: &[u8]) -> u64 {
    sample.get(8..).and_then(<[u8]>::first_chunk).map_or(u64::MAX, |bytes| u64::from_le_bytes(*bytes))
}

impl Service for Bridge {
    type Inputs = Inputs;
    type Outputs = Outputs;
    const NAME: &'static str = "bridge";

    fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        self.take(now, inputs, outputs);
        self.take_goals(now, inputs, outputs);
        self.give(inputs, outputs);
        self.tell(now, outputs);
    }
}
