//! Whose word counts on where the target is: its own while that is fresh, motion capture's otherwise.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_bus::launch::Launch;
use fss_bus::{Batch, Bus, InputPort, Latest, Output, OutputPort, Runner, Time};
use fss_messages::{Event, MissionState, MocapPose, NavState, PeerState, text_of, topic};
use fss_mission::{Mission, MissionConfig, MissionService};

const PERIOD_NS: u64 = 50_000_000;
/// The clock of the target's host is behind ours by this, or ahead where it is negative.
const OFFSETS_NS: [i64; 2] = [5_000_000_000_000, -900_000_000];
/// By motion capture the target stands here, by its own word 1 cm beside.
const SEEN: [f64; 3] = [0.7, 0.2, 3.0];
const TOLD: [f64; 3] = [0.71, 0.2, 3.0 + std::f64::consts::TAU];

const LAUNCH: &str = r#"
target_vehicle = "target"
service = []
[devices]
vicon = "127.0.0.1:1"
gyro = "g"
valves = "v"
links_local = "127.0.0.1:2"
links = []
"#;

/// A mission that waits, and a target that is seen and may speak.
struct Sky {
    mission: Runner<MissionService>,
    seen: Output<MocapPose>,
    told: Output<NavState>,
    peer: Output<PeerState>,
    state: Latest<MissionState>,
    events: Batch<Event>,
    now: Time,
    offset_ns: i64,
    is_seen: bool,
    speaks: bool,
    mode: u8,
}

impl Sky {
    fn new(offset_ns: i64) -> Self {
        let bus = Bus::local().for_stack(&Launch::parse(LAUNCH, &[]).unwrap());
        let phase = "name = \"test\"\n[[phase]]\nduration_s = 1\nbase = { goal = \"hold\" }\narm = { goal = \"hold\" }";
        let mission = MissionService::new(Mission::parse(phase).unwrap(), MissionConfig::default());
        Self {
            mission: Runner::new(mission, &bus).unwrap(),
            seen: Output::open(&bus, topic::MOCAP_TARGET).unwrap(),
            told: Output::open(&bus, topic::NAV_STATE.of_target()).unwrap(),
            peer: Output::open(&bus, topic::PEER.of_target()).unwrap(),
            state: Latest::open(&bus, topic::MISSION_STATE).unwrap(),
            events: Batch::open(&bus, topic::EVENTS).unwrap(),
            now: Time::from_ns(1_000_000_000),
            offset_ns,
            is_seen: true,
            speaks: true,
            mode: NavState::TRACKING,
        }
    }

    /// Flies on, and gives the target as the mission tells it, and what was said.
    fn fly(&mut self, seconds: f64) -> (MissionState, Vec<String>) {
        for _ in 0..(seconds * 1e9) as u64 / PERIOD_NS {
            self.now = self.now.plus_ns(PERIOD_NS);
            let stamp_ns = self.now.ns() - 10_000_000;
            if self.is_seen {
                let [x_m, y_m, theta_rad] = SEEN;
                self.seen.publish(MocapPose { stamp_ns, x_m, y_m, theta_rad, ..MocapPose::default() });
            }
            if self.speaks {
                let [x_m, y_m, theta_rad] = TOLD;
                let stamp_ns = stamp_ns.wrapping_sub(self.offset_ns as u64);
                let nav = NavState { stamp_ns, x_m, y_m, theta_rad, mode: self.mode, ..NavState::default() };
                self.told.publish(NavState { vx_m_s: 0.1, ..nav });
                self.peer.publish(PeerState { stamp_ns, clock_offset_ns: self.offset_ns, ..PeerState::default() });
            }
            self.seen.flush(self.now);
            self.told.flush(self.now);
            self.peer.flush(self.now);
            self.mission.step(self.now);
            self.mission.flush(self.now);
        }
        self.state.refresh();
        self.events.refresh();
        let words = self.events.samples().iter().map(|event| text_of(&event.text).to_owned());
        (*self.state.get().unwrap(), words.filter(|words| words.contains("target")).collect())
    }
}

const SPEAKS: &str = "the target speaks: its own navigation counts";
const STALE: &str = "the target's word is stale: motion capture counts";

#[test]
fn the_targets_own_word_counts_while_it_is_fresh_whatever_its_clock() {
    // A target that has just been switched on has a clock that starts near zero.
    for offset_ns in OFFSETS_NS {
        let mut sky = Sky::new(offset_ns);
        sky.now = sky.now.plus_ns(offset_ns.max(0) as u64);
        let (state, words) = sky.fly(0.5);
        assert!((state.target[0] - SEEN[0]).abs() < 1e-3 && words.is_empty(), "it is not trusted at once: {words:?}");
        let (state, words) = sky.fly(1.0);
        // Told 10 ms ago at 0.1 m/s, and with the heading counted as motion capture counts it.
        assert!((state.target[0] - TOLD[0] - 0.001).abs() < 1e-9, "{:?}", state.target);
        assert!((state.target[2] - SEEN[2]).abs() < 1e-9, "{:?}", state.target);
        assert_eq!((state.target_rate[0], state.target_seen, words.as_slice()), (0.1, 1, &[SPEAKS.to_owned()][..]));
        sky.speaks = false;
        let (state, words) = sky.fly(0.5);
        assert!((state.target[0] - SEEN[0]).abs() < 1e-3, "{:?}", state.target);
        assert_eq!(words, [STALE]);
        sky.speaks = true;
        assert_eq!(sky.fly(0.9).1, Vec::<String>::new(), "fresh for too short a time");
        assert_eq!(sky.fly(0.5).1, [SPEAKS]);
    }
}

#[test]
fn a_target_that_speaks_is_not_lost_where_motion_capture_does_not_see_it() {
    let mut sky = Sky::new(OFFSETS_NS[1]);
    sky.is_seen = false;
    assert_eq!(sky.fly(2.0).0.target_seen, 1);
    sky.speaks = false;
    assert_eq!(sky.fly(2.0).0.target_seen, 0);
}

#[test]
fn the_word_of_a_target_that_has_lost_its_own_way_does_not_count() {
    let mut sky = Sky::new(OFFSETS_NS[1]);
    sky.fly(2.0);
    sky.mode = NavState::COASTING;
    assert_eq!(sky.fly(0.1).1, [STALE]);
}
