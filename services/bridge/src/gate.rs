//! What is taken of another vehicle or of a node, and what is refused: form, layout, session, number, age, in this order.

use crate::clock::PeerClock;
use fss_bus::launch::NODES;
use fss_messages::PeerState;
use fss_wire::bridge::Envelope;
use std::time::Duration;

/// A bridge whose session is older than the known one is believed only after the known one was silent for so long, ns.
const SESSION_SILENCE_NS: u64 = 2_000_000_000;

/// Why a sample is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Envelope or sample cannot be read.
    Form,
    /// Another build's layout, or another type of message.
    Layout,
    /// On a topic that the launch file does not name.
    Topic,
    /// Sooner after the one before than the launch file allows.
    Rate,
    /// Beyond the launch file's bounds.
    Bounds,
    /// Doubled, overtaken on the way, or from a bridge that has been replaced.
    Sequence,
    /// Too old when it came; its age, ns.
    Age(u64),
}

impl Refusal {
    /// Where it is counted.
    pub(crate) fn count(self, counts: &mut PeerState) {
        let count = match self {
            Self::Form => &mut counts.refused_form,
            Self::Layout => &mut counts.refused_layout,
            Self::Topic => &mut counts.refused_topic,
            Self::Rate => &mut counts.refused_rate,
            Self::Bounds => &mut counts.refused_bounds,
            Self::Sequence => &mut counts.refused_sequence,
            Self::Age(_) => &mut counts.refused_age,
        };
        *count += 1;
    }
}

/// What came of a topic, as far as the gates look at it.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// What went with the sample; none where that could not be read.
    pub envelope: Option<Envelope>,
    /// The sample's length, bytes.
    pub len: usize,
    /// The sample's stamp on the sender's monotonic clock, ns.
    pub stamp_ns: u64,
    /// When it came, on this host's monotonic clock, ns.
    pub received_ns: u64,
}

/// The gate of one topic of another vehicle.
#[derive(Clone, Copy, Debug)]
pub struct Gate {
    layout: u64,
    len: usize,
    session: u64,
    number: u64,
}

impl Gate {
    /// For samples of this layout and length.
    pub fn new(layout: u64, len: usize) -> Self {
        Self { layout, len, session: 0, number: 0 }
    }
}

/// Another vehicle, as what comes of it shows.
#[derive(Clone, Copy, Debug, Default)]
pub struct Peer {
    clock: PeerClock,
    session: u64,
    max_age_ns: u64,
    /// Whether sessions have no order: another one is believed only after the known one was silent.
    takes_turns: bool,
    /// What is counted; its stamp is when the last sample was taken.
    counts: PeerState,
}

impl Peer {
    /// Of which samples older than `max_age` are refused.
    pub fn new(vehicle: &str, max_age: Duration) -> Self {
        let counts = PeerState { vehicle: fss_messages::text(vehicle), ..PeerState::default() };
        Self { max_age_ns: max_age.as_nanos() as u64, counts, ..Self::default() }
    }

    /// Nodes of ROS 2, of which one at a time is heard.
    pub(crate) fn of_nodes(max_age: Duration) -> Self {
        Self { takes_turns: true, ..Self::new(NODES, max_age) }
    }

    /// Takes a sample or refuses it, and counts it.
    ///
    /// # Errors
    /// Why it is refused.
    pub fn admit(&mut self, gate: &mut Gate, arrival: &Arrival) -> Result<(), Refusal> {
        let outcome = self.judge(gate, arrival);
        match outcome {
            Ok(()) => {
                self.counts.received += 1;
                self.counts.stamp_ns = arrival.received_ns;
            }
            Err(refusal) => refusal.count(&mut self.counts),
        }
        outcome
    }

    fn judge(&mut self, gate: &mut Gate, arrival: &Arrival) -> Result<(), Refusal> {
        let envelope = arrival.envelope.ok_or(Refusal::Form)?;
        if envelope.layout != gate.layout {
            return Err(Refusal::Layout);
        }
        // Nothing is sent before it was measured.
        let waited_ns = envelope.sent_ns.checked_sub(arrival.stamp_ns).ok_or(Refusal::Form)?;
        if arrival.len != gate.len {
            return Err(Refusal::Form);
        }
        if envelope.session != self.session {
            self.begin_session(envelope.session, arrival.received_ns)?;
        }
        if gate.session != envelope.session {
            (gate.session, gate.number) = (envelope.session, 0);
        }
        if envelope.number <= gate.number {
            return Err(Refusal::Sequence);
        }
        gate.number = envelope.number;
        let offset_ns = self.clock.observe(envelope.sent_ns, arrival.received_ns);
        let difference_ns = arrival.received_ns.wrapping_sub(envelope.sent_ns) as i64;
        let age_ns = waited_ns.saturating_add(difference_ns.saturating_sub(offset_ns).max(0) as u64);
        (self.counts.clock_offset_ns, self.counts.age_ns) = (offset_ns, age_ns);
        if age_ns > self.max_age_ns { Err(Refusal::Age(age_ns)) } else { Ok(()) }
    }

    /// A bridge that started anew counts anew, and its host may have started anew with it: its clock is another.
    fn begin_session(&mut self, session: u64, now_ns: u64) -> Result<(), Refusal> {
        let is_silent = now_ns.saturating_sub(self.counts.stamp_ns) > SESSION_SILENCE_NS;
        if (self.takes_turns || session < self.session) && !is_silent {
            return Err(Refusal::Sequence);
        }
        (self.session, self.clock) = (session, PeerClock::default());
        Ok(())
    }

    /// When the last sample was taken, ns on this host's clock; 0 before the first.
    pub fn heard_ns(&self) -> u64 {
        self.counts.stamp_ns
    }

    /// What is known of it.
    pub fn state(&self) -> PeerState {
        self.counts
    }
}
