//! What a log holds of a flight, ready to be looked up by step.

use fss_messages::topic::{self, Topic};
use fss_messages::{
    ArmCommand, BaseCommand, Event, GyroRate, LinkDatagram, LinksState, MissionCommand, MissionState, MocapPose,
    NavState, Parameters, Posture, Sample, Step, ThrustersCommand, ThrustersState, text_of,
};
use fss_records::log::{Log, LogError, Samples};

/// The samples of a topic in the order of their publication.
pub struct Recorded<T> {
    /// The topic's name, without the vehicle's.
    pub topic: Topic<T>,
    samples: Vec<T>,
}

impl<T: Sample> Recorded<T> {
    fn new(topic: Topic<T>, mut samples: Vec<T>) -> Self {
        samples.sort_by_key(|sample| sample.header().published_ns);
        Self { topic, samples }
    }

    /// What was published at this time: by one step, unless several services speak on the topic.
    pub fn at(&self, published_ns: u64) -> &[T] {
        let from = self.samples.partition_point(|sample| sample.header().published_ns < published_ns);
        let to = self.samples.partition_point(|sample| sample.header().published_ns <= published_ns);
        &self.samples[from..to]
    }

    /// The newest sample of this sequence that was published by `until_ns`: a publisher that starts anew counts anew.
    pub fn of_sequence(&self, sequence: u64, until_ns: u64) -> Option<&T> {
        let end = self.samples.partition_point(|sample| sample.header().published_ns <= until_ns);
        self.samples[..end].iter().rfind(|sample| sample.header().sequence == sequence)
    }

    /// All from `published_ns` on.
    pub fn since(&self, published_ns: u64) -> &[T] {
        &self.samples[self.samples.partition_point(|sample| sample.header().published_ns < published_ns)..]
    }
}

macro_rules! tape {
    ($( $(#[$doc:meta])* $field:ident: $sample:ident = $topic:ident, )*) => {
        /// The topics that services read and write, and the record of their steps.
        pub struct Tape {
            $( $(#[$doc])* pub $field: Recorded<$sample>, )*
            /// Every step of every service, in the order of the log.
            pub steps: Vec<Step>,
        }

        impl Tape {
            /// Reads the parts of a flight of this vehicle, each in one pass.
            ///
            /// # Errors
            /// Where the log cannot be read, or another build recorded it.
            pub fn read(logs: &[Log], vehicle: &str) -> Result<Self, LogError> {
                let full = |name: &str| if vehicle.is_empty() { name.to_owned() } else { format!("/{vehicle}{name}") };
                $( let mut $field = Samples::<$sample>::of(&full(topic::$topic.name)); )*
                let mut steps = Samples::<Step>::of(&full(topic::STEPS.name));
                for log in logs {
                    log.collect(&mut [$( &mut $field, )* &mut steps])?;
                }
                Ok(Self { $( $field: Recorded::new(topic::$topic, $field.samples), )* steps: steps.samples })
            }
        }
    };
}

tape! {
    mocap_base: MocapPose = MOCAP_BASE,
    mocap_end_effector: MocapPose = MOCAP_END_EFFECTOR,
    mocap_target: MocapPose = MOCAP_TARGET,
    gyro: GyroRate = GYRO,
    nav: NavState = NAV_STATE,
    telemetry: LinkDatagram = LINKS_TELEMETRY,
    links: LinksState = LINKS_STATE,
    mission: MissionState = MISSION_STATE,
    arm: ArmCommand = ARM_COMMAND,
    base: BaseCommand = BASE_COMMAND,
    thrusters: ThrustersCommand = THRUSTERS_COMMAND,
    valves: ThrustersState = THRUSTERS_STATE,
    postures: Posture = CALIBRATION_POSTURE,
    mission_command: MissionCommand = MISSION_COMMAND,
    parameters_command: Parameters = PARAMETERS_COMMAND,
    parameters_state: Parameters = PARAMETERS_STATE,
    events: Event = EVENTS,
}

impl Tape {
    /// The steps of a service, life by life: each start of its process, or what the log still holds of it.
    pub fn lives(&self, service: &str) -> Vec<Vec<Step>> {
        let mut steps: Vec<Step> =
            self.steps.iter().filter(|step| text_of(&step.service) == service).copied().collect();
        steps.sort_by_key(|step| step.published_ns);
        steps.chunk_by(|a, b| b.step == a.step + 1).map(<[Step]>::to_vec).collect()
    }
}
