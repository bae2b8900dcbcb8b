//! What nodes of ROS 2 want of base and arm: taken as the launch file's `[[ros2.receive]]` says, else refused and counted.

use crate::gate::{Arrival, Gate, Peer, Refusal};
use crate::ports::Called;
use fss_bus::Time;
use fss_bus::launch::{NODES, Ros2Receive, Ros2Type};
use fss_messages::{Event, MissionGoal, PeerState};
use fss_ros2::incoming::{Malformed, joint_state, pose_2d, pose_stamped};
use std::f64::consts::{PI, TAU};
use std::time::Duration;
use toml::Spanned;

/// What is refused of one topic is said at most so often, ns.
const SAY_PERIOD_NS: u64 = 5_000_000_000;
/// Counts are published at least so often, ns.
const TELL_PERIOD_NS: u64 = 1_000_000_000;
/// Nodes of which nothing was taken for so long are silent, ns.
const SILENT_NS: u64 = 1_000_000_000;

/// Least and most of what a goal may be; not a number in a goal says nothing, and is within.
#[derive(Clone, Copy)]
struct Bounds {
    base: [[f64; 2]; 3],
    q_rad: [f64; 2],
}

impl Bounds {
    fn of(receive: &Ros2Receive) -> Self {
        let range = |range: &Option<Spanned<[f64; 2]>>, scale: f64| {
            range.as_ref().map_or([-f64::INFINITY, f64::INFINITY], |range| range.get_ref().map(|value| value * scale))
        };
        let degree = 1_f64.to_radians();
        let base = [range(&receive.x_m, 1.0), range(&receive.y_m, 1.0), range(&receive.theta_deg, degree)];
        Self { base, q_rad: range(&receive.q_deg, degree) }
    }

    /// What of a goal is beyond, and its value.
    fn beyond(&self, goal: &MissionGoal) -> Option<(&'static str, f64)> {
        let [x_m, y_m, theta_rad] = goal.base_goal;
        let heading_rad = (theta_rad + PI).rem_euclid(TAU) - PI;
        let base = [("x_m", x_m, 1.0), ("y_m", y_m, 1.0), ("theta_deg", heading_rad, 1_f64.to_degrees())];
        let joints = goal.q_goal_rad.map(|q_rad| (("q_deg", q_rad, 1_f64.to_degrees()), self.q_rad));
        let mut all = base.into_iter().zip(self.base).chain(joints);
        let outside = all.find(|((_, value, _), [low, high])| value < low || value > high);
        outside.map(|((name, value, scale), _)| (name, value * scale))
    }
}

/// A topic that the launch file names.
struct Allowed {
    name: String,
    kind: Ros2Type,
    bounds: Bounds,
    gate: Gate,
    peer: Peer,
    period_ns: u64,
    /// When the next goal would come that keeps the rate, ns.
    due_ns: u64,
    said_ns: u64,
}

/// What is let in of nodes.
pub struct Inward {
    topics: Vec<Allowed>,
    joints: Vec<String>,
    counts: PeerState,
    told: PeerState,
    told_ns: u64,
    said_ns: u64,
}

/// Why something is refused, in words.
enum Words {
    Refused(Refusal),
    Malformed(Malformed),
    Beyond(&'static str, f64),
}

impl Inward {
    /// What these tables let in of goals for an arm with joints of these names.
    pub fn new(receive: &[Ros2Receive], joints: Vec<String>) -> Self {
        let allowed = |receive: &Ros2Receive| Allowed {
            name: receive.topic.get_ref().clone(),
            kind: receive.kind,
            bounds: Bounds::of(receive),
            gate: Gate::new(0, 0),
            peer: Peer::of_nodes(Duration::from_millis(receive.max_age_ms)),
            period_ns: (1e9 / receive.max_rate_hz.get_ref()) as u64,
            due_ns: 0,
            said_ns: 0,
        };
        let counts = PeerState { vehicle: fss_messages::text(NODES), ..PeerState::default() };
        let topics = receive.iter().map(allowed).collect();
        Self { topics, joints, counts, told: counts, told_ns: 0, said_ns: 0 }
    }

    /// The goal that came, or none where it is refused: that is counted, and said now and then.
    pub(crate) fn take(&mut self, now: Time, called: &Called, say: impl FnOnce(Event)) -> Option<MissionGoal> {
        let Some(allowed) = called.topic.and_then(|topic| self.topics.get_mut(topic)) else {
            Refusal::Topic.count(&mut self.counts);
            if is_due(&mut self.said_ns, now) {
                let name = String::from_utf8_lossy(called.parcel.sample());
                let words = format_args!("a message on {name} changes nothing: [[ros2.receive]] does not name it");
                say(Event::new(now.ns(), "bridge", Event::WARNING, words));
            }
            return None;
        };
        match allowed.admit(called, &self.joints) {
            Ok(goal) => {
                self.counts.received += 1;
                let state = allowed.peer.state();
                (self.counts.stamp_ns, self.counts.age_ns) = (called.received_ns, state.age_ns);
                self.counts.clock_offset_ns = state.clock_offset_ns;
                Some(goal)
            }
            Err(words) => {
                words.refusal().count(&mut self.counts);
                if is_due(&mut allowed.said_ns, now) {
                    let words = format_args!("a message on {} is refused: {words}", allowed.name);
                    say(Event::new(now.ns(), "bridge", Event::WARNING, words));
                }
                None
            }
        }
    }

    /// The counts, where they are to be published.
    pub(crate) fn tell(&mut self, now: Time) -> Option<PeerState> {
        let is_silent = now.age_ns(self.counts.stamp_ns) > SILENT_NS;
        self.counts.speaks = u8::from(self.counts.received > 0 && !is_silent);
        if self.counts == self.told && now.age_ns(self.told_ns) < TELL_PERIOD_NS {
            return None;
        }
        (self.told, self.told_ns) = (self.counts, now.ns());
        Some(self.counts)
    }
}

/// Whether it is time to say something again.
fn is_due(said_ns: &mut u64, now: Time) -> bool {
    let is_due = *said_ns == 0 || now.age_ns(*said_ns) >= SAY_PERIOD_NS;
    if is_due {
        *said_ns = now.ns();
    }
    is_due
}

impl Allowed {
    /// The goal, its stamp on this host's clock.
    fn admit(&mut self, called: &Called, joints: &[String]) -> Result<MissionGoal, Words> {
        if !called.is_type {
            return Err(Words::Refused(Refusal::Layout));
        }
        let attachment = called.attachment.ok_or(Words::Refused(Refusal::Form))?;
        let message = called.parcel.whole().ok_or(Words::Refused(Refusal::Form))?;
        let read = match self.kind {
            Ros2Type::PoseStamped => pose_stamped(message),
            Ros2Type::Pose2d => pose_2d(message),
            Ros2Type::JointState => joint_state(message, joints),
        };
        let goal = read.map_err(Words::Malformed)?;
        if let Some((name, value)) = self.bounds.beyond(&goal) {
            return Err(Words::Beyond(name, value));
        }
        // Two may come at once, as on a network; more at once than that are too many a second.
        if called.received_ns.saturating_add(self.period_ns) < self.due_ns {
            return Err(Words::Refused(Refusal::Rate));
        }
        // A message without a stamp was made when it was sent.
        let stamp_ns = if goal.stamp_ns == 0 { attachment.sent_ns } else { goal.stamp_ns };
        let arrival = Arrival { envelope: Some(attachment), len: 0, stamp_ns, received_ns: called.received_ns };
        self.peer.admit(&mut self.gate, &arrival).map_err(Words::Refused)?;
        self.due_ns = self.due_ns.max(called.received_ns).saturating_add(self.period_ns);
        let stamp_ns = called.received_ns.saturating_sub(self.peer.state().age_ns);
        Ok(MissionGoal { stamp_ns, ..goal })
    }
}

impl Words {
    fn refusal(&self) -> Refusal {
        match self {
            Self::Refused(refusal) => *refusal,
            Self::Malformed(_) => Refusal::Form,
            Self::Beyond(..) => Refusal::Bounds,
        }
    }
}

impl core::fmt::Display for Words {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Malformed(why) => write!(f, "{why}"),
            Self::Beyond(name, value) => write!(f, "{name} = {value:.3} is out of bounds"),
            Self::Refused(Refusal::Age(age_ns)) => write!(f, "it is {:.2} s old", *age_ns as f64 * 1e-9),
            Self::Refused(Refusal::Rate) => write!(f, "it comes faster than max_rate_hz"),
            Self::Refused(Refusal::Layout) => write!(f, "it is of another type"),
            Self::Refused(Refusal::Sequence) => write!(f, "it is doubled or overtaken, or another node speaks here"),
            Self::Refused(_) => write!(f, "it cannot be read"),
        }
    }
}
