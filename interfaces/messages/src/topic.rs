//! The topics of a stack: name, what travels on it, who publishes it.

use crate::{
    ArmCommand, BaseCommand, Event, GyroRate, Health, LinkDatagram, LinksState, MissionCommand, MissionGoal,
    MissionState, MocapPose, NavState, Parameters, PeerState, Posture, Sample, Step, ThrustersCommand, ThrustersState,
    TruthState,
};
use core::marker::PhantomData;

/// In whose name a topic is published.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Owner {
    /// This stack's vehicle.
    This,
    /// The vehicle that the launch file names as the target of this one; there may be none, and then nothing ever comes.
    Target,
}

/// A topic: a name and the type of its samples.
#[derive(Clone, Copy, Debug)]
pub struct Topic<T> {
    /// ROS style name, without the vehicle's.
    pub name: &'static str,
    /// Whose it is.
    pub owner: Owner,
    sample: PhantomData<fn() -> T>,
}

impl<T: Sample> Topic<T> {
    /// A topic of this name.
    pub const fn new(name: &'static str) -> Self {
        Self { name, owner: Owner::This, sample: PhantomData }
    }

    /// The same topic of the vehicle that is this one's target.
    pub const fn of_target(self) -> Self {
        Self { name: self.name, owner: Owner::Target, sample: PhantomData }
    }
}

/// Topics on which several services speak; their samples name the service behind the header.
const SHARED: [&str; 4] = [EVENTS.name, HEALTH.name, STEPS.name, PARAMETERS_STATE.name];

/// Whether several services speak on the topic of this name, with or without a vehicle's in front.
pub fn is_shared(name: &str) -> bool {
    SHARED.iter().any(|shared| name.ends_with(shared))
}

/// Whether a topic may have this name: words behind slashes, of lower-case letters, digits and underscores.
pub const fn is_name(name: &str) -> bool {
    let bytes = name.as_bytes();
    let (mut i, mut in_word) = (0, false);
    while i < bytes.len() {
        in_word = match bytes[i] {
            b'/' if i == 0 || in_word => false,
            b'a'..=b'z' | b'0'..=b'9' | b'_' if i > 0 => true,
            _ => return false,
        };
        i += 1;
    }
    in_word
}

macro_rules! topics {
    ($( #[doc = $doc:literal] $constant:ident: $sample:ident = $name:literal, )*) => {
        $( #[doc = $doc] pub const $constant: Topic<$sample> = Topic::new($name); )*

        /// Every topic's name, in the order of the data flow.
        pub const NAMES: &[&str] = &[$($name),*];

        /// Calls the visitor with each topic.
        pub fn visit(visitor: &mut impl TopicVisitor) {
            $( visitor.visit($constant, $doc.trim_ascii()); )*
        }
    };
}

/// Does something with a topic.
pub trait TopicVisitor {
    /// Called once for each topic, with its documentation.
    fn visit<T: Sample>(&mut self, topic: Topic<T>, doc: &'static str);
}

topics! {
    /// Motion capture of the base, as the tracker sent it; published by `fusion`.
    MOCAP_BASE: MocapPose = "/mocap/base",
    /// Motion capture of the end-effector; published by `fusion`.
    MOCAP_END_EFFECTOR: MocapPose = "/mocap/end_effector",
    /// Motion capture of the target body; published by `fusion`.
    MOCAP_TARGET: MocapPose = "/mocap/target",
    /// The fibre-optic gyro's reading; published by `fusion`.
    GYRO: GyroRate = "/gyro",
    /// Navigation state of the base; published by `fusion`.
    NAV_STATE: NavState = "/nav/state",
    /// Telemetry of all links, extrapolated to one time; published by `links`.
    LINKS_STATE: LinksState = "/links/state",
    /// Telemetry as it was received, datagram by datagram; published by `links`.
    LINKS_TELEMETRY: LinkDatagram = "/links/telemetry",
    /// Where the mission stands and what it wants of base and arm; published by `mission`.
    MISSION_STATE: MissionState = "/mission/state",
    /// What the arm controller tells the joints; published by `arm`.
    ARM_COMMAND: ArmCommand = "/arm/command",
    /// The wrench that the base controller wants, and its errors; published by `base`.
    BASE_COMMAND: BaseCommand = "/base/command",
    /// Which valves shall be open; published by `base`.
    THRUSTERS_COMMAND: ThrustersCommand = "/thrusters/command",
    /// Which valves are commanded open at the driver; published by `thrusters`.
    THRUSTERS_STATE: ThrustersState = "/thrusters/state",
    /// Postures in which the arm stood still, for calibration; published by `calibration`.
    CALIBRATION_POSTURE: Posture = "/calibration/posture",
    /// What the ground wants of the mission; published by `ground`.
    MISSION_COMMAND: MissionCommand = "/mission/command",
    /// Where nodes of ROS 2 want base and arm, as far as the launch file lets them; published by `bridge`.
    MISSION_GOAL: MissionGoal = "/mission/goal",
    /// The values that the ground wants of parameters; published by `ground`.
    PARAMETERS_COMMAND: Parameters = "/parameters/command",
    /// The values of parameters in force, each service's own; published by those that have any.
    PARAMETERS_STATE: Parameters = "/parameters/state",
    /// What happened, with severity; published by every service.
    EVENTS: Event = "/events",
    /// Cycles, overruns, latencies and input ages; published by every service.
    HEALTH: Health = "/health",
    /// Each step of each service with the samples that it used, so that it can be computed again; published by every service.
    STEPS: Step = "/steps",
    /// What the bridge of this host hears of the vehicle in whose name it says so; published by `bridge`.
    PEER: PeerState = "/peer",
    /// What the simulated laboratory knows and no service may read; published by `lab`.
    TRUTH_STATE: TruthState = "/truth/state",
}
