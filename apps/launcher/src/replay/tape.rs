//! What a log holds of a flight, ready to be looked up by step.

use fss_bus::launch::Launch;
use fss_messages::topic::{self, Owner, Topic};
use fss_messages::{
    ArmCommand, BaseCommand, Event, GyroRate, LinkDatagram, LinksState, MissionCommand, MissionState, MocapPose,
    NavState, Parameters, PeerState, Posture, Sample, Step, ThrustersCommand, ThrustersState, text_of,
};
use fss_records::log::{Log, LogError, Samples};

/// The samples of a topic in the order of their publication.
pub(super) struct Recorded<T> {
    /// The topic's name, without the vehicle's.
    pub topic: Topic<T>,
    samples: Vec<T>,
}

impl<T: Sample> Recorded<T> {
    fn new(topic: Topic<T>, mut samples: Vec<T>) -> Self {
        // Another vehicle's samples are on its own clock: they stay in the order in which they came.
        if topic.owner == Owner::This {
            samples.sort_by_key(|sample| sample.header().published_ns);
        }
        Self { topic, samples }
    }

    /// Of another vehicle's samples, the first of this sequence from the `from`-th on, and its place.
    pub(super) fn next_of_sequence(&self, sequence: u64, from: usize) -> Option<(usize, &T)> {
        self.samples.iter().enumerate().skip(from).find(|(_, sample)| sample.header().sequence == sequence)
    }

    /// What was published at this time: by one step, unless several services speak on the topic.
    pub(super) fn at(&self, published_ns: u64) -> &[T] {
        let from = self.samples.partition_point(|sample| sample.header().published_ns < published_ns);
        let to = self.samples.partition_point(|sample| sample.header().published_ns <= published_ns);
        &self.samples[from..to]
    }

    /// The newest sample of this sequence that was published by `until_ns`: a publisher that starts anew counts anew.
    pub(super) fn of_sequence(&self, sequence: u64, until_ns: u64) -> Option<&T> {
        let end = self.samples.partition_point(|sample| sample.header().published_ns <= until_ns);
        self.samples[..end].iter().rfind(|sample| sample.header().sequence == sequence)
    }

    /// The newest that was published before `published_ns`.
    pub(super) fn before(&self, published_ns: u64) -> Option<&T> {
        self.samples[..self.samples.partition_point(|sample| sample.header().published_ns < published_ns)].last()
    }

    /// All from `published_ns` on.
    pub(super) fn since(&self, published_ns: u64) -> &[T] {
        &self.samples[self.samples.partition_point(|sample| sample.header().published_ns < published_ns)..]
    }
}

/// The name under which a topic's owner publishes it; one that nobody has where there is no target.
fn full_name<T>(launch: &Launch, topic: &Topic<T>) -> String {
    let owner = match topic.owner {
        Owner::This => launch.vehicle.as_str(),
        Owner::Target => launch.target_vehicle.as_deref().unwrap_or("-"),
    };
    if owner.is_empty() { topic.name.to_owned() } else { format!("/{owner}{}", topic.name) }
}

macro_rules! tape {
    ($( $(#[$doc:meta])* $field:ident: $sample:ident = $topic:expr, )*) => {
        /// The topics that services read and write, and the record of their steps.
        pub(crate) struct Tape {
            $( $(#[$doc])* pub $field: Recorded<$sample>, )*
            /// Every step of every service, in the order of the log.
            pub steps: Vec<Step>,
        }

        impl Tape {
            /// Reads the parts of a flight of this launch file's vehicle, each in one pass.
            ///
            /// # Errors
            /// Where the log cannot be read, or another build recorded it.
            pub(crate) fn read(logs: &[Log], launch: &Launch) -> Result<Self, LogError> {
                $( let mut $field = Samples::<$sample>::of(&full_name(launch, &$topic)); )*
                let mut steps = Samples::<Step>::of(&full_name(launch, &topic::STEPS));
                for log in logs {
                    log.collect(&mut [$( &mut $field, )* &mut steps])?;
                }
                Ok(Self { $( $field: Recorded::new($topic, $field.samples), )* steps: steps.samples })
            }
        }
    };
}

tape! {
    mocap_base: MocapPose = topic::MOCAP_BASE,
    mocap_end_effector: MocapPose = topic::MOCAP_END_EFFECTOR,
    mocap_target: MocapPose = topic::MOCAP_TARGET,
    gyro: GyroRate = topic::GYRO,
    nav: NavState = topic::NAV_STATE,
    telemetry: LinkDatagram = topic::LINKS_TELEMETRY,
    links: LinksState = topic::LINKS_STATE,
    mission: MissionState = topic::MISSION_STATE,
    arm: ArmCommand = topic::ARM_COMMAND,
    base: BaseCommand = topic::BASE_COMMAND,
    thrusters: ThrustersCommand = topic::THRUSTERS_COMMAND,
    valves: ThrustersState = topic::THRUSTERS_STATE,
    postures: Posture = topic::CALIBRATION_POSTURE,
    mission_command: MissionCommand = topic::MISSION_COMMAND,
    parameters_command: Parameters = topic::PARAMETERS_COMMAND,
    parameters_state: Parameters = topic::PARAMETERS_STATE,
    events: Event = topic::EVENTS,
    target_nav: NavState = topic::NAV_STATE.of_target(),
    target_peer: PeerState = topic::PEER.of_target(),
}

impl Tape {
    /// The steps of a service, life by life: each start of its process, or what the log still holds of it.
    pub(super) fn lives(&self, service: &str) -> Vec<Vec<Step>> {
        let mut steps: Vec<Step> =
            self.steps.iter().filter(|step| text_of(&step.service) == service).copied().collect();
        steps.sort_by_key(|step| step.published_ns);
        steps.chunk_by(|a, b| b.step == a.step + 1).map(<[Step]>::to_vec).collect()
    }
}
