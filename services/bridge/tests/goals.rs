//! What the bridge takes of nodes of ROS 2, and what it refuses.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_bridge::inward::Inward;
use fss_bridge::{Bridge, CALLED_QUEUE, Called, Line, Parcel, Patience};
use fss_bus::launch::Launch;
use fss_bus::{Batch, Bus, Feed, InputPort, Latest, Queue, Runner, Time};
use fss_messages::{Event, MissionGoal, PeerState, text_of, topic};
use fss_ros2::cdr::Cdr;
use fss_wire::bridge::Envelope;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

const MS: u64 = 1_000_000;
/// The calendar, less this host's monotonic clock.
const CALENDAR_NS: u64 = 1_700_000_000_000 * MS;

const LAUNCH: &str = r#"
[devices]
vicon = "127.0.0.1:1"
gyro = "g"
valves = "v"
links_local = "127.0.0.1:2"
links = []
[ros2]
[[ros2.receive]]
topic = "/goal_pose"
type = "geometry_msgs/msg/PoseStamped"
max_rate_hz = 2
x_m = [-1, 1]
y_m = [-0.5, 0.5]
theta_deg = [-90, 90]
[[ros2.receive]]
topic = "/arm/goal"
type = "sensor_msgs/msg/JointState"
max_rate_hz = 50
max_age_ms = 100
q_deg = [-60, 60]
[[service]]
name = "bridge"
rate_hz = 50
"#;

fn pose(stamp_ns: u64, frame: &str, pose: [f64; 3]) -> Vec<u8> {
    Cdr::default().header(stamp_ns, frame).pose(pose, 0.0).message()
}

fn joints(names: &[&str], q_rad: &[f64]) -> Vec<u8> {
    let numbers = |cdr: Cdr, values: &[f64]| cdr.list(values, |cdr, value| cdr.f64(*value));
    let cdr = Cdr::default().header(0, "").list(names, |cdr, name| cdr.text(name));
    [q_rad, &[], &[]].into_iter().fold(cdr, numbers).message()
}

/// A bridge whose nodes are this test.
struct Flown {
    bridge: Runner<Bridge>,
    called: Queue<Called>,
    goals: Batch<MissionGoal>,
    peer: Latest<PeerState>,
    events: Batch<Event>,
    now: Time,
    number: u64,
}

impl Flown {
    fn new() -> Self {
        let launch = Launch::parse(LAUNCH, &["bridge"]).unwrap();
        let bus = Bus::local().for_stack(&launch);
        let inward = Inward::new(&launch.ros2.unwrap().receive, ["joint_1", "joint_2"].map(str::to_owned).to_vec());
        let words = Arc::new(crossbeam_queue::ArrayQueue::new(4));
        let bridge = Bridge::new(bus.neighbours(), Patience::default(), Line::default(), words).with_nodes(inward);
        Self {
            bridge: Runner::new(bridge, &bus).unwrap(),
            called: bus.queue(CALLED_QUEUE, Feed::<Called>::CAPACITY).unwrap(),
            goals: Batch::open(&bus, topic::MISSION_GOAL).unwrap(),
            peer: Latest::open(&bus.of_vehicle("ros2"), topic::PEER).unwrap(),
            events: Batch::open(&bus, topic::EVENTS).unwrap(),
            now: Time::from_ns(77_000 * MS),
            number: 0,
        }
    }

    /// `after_ms` later comes a message as it was sent 3 ms before, changed by `change`; the goals that it made.
    fn call(&mut self, after_ms: u64, topic: usize, message: &[u8], change: impl Fn(&mut Called)) -> Vec<MissionGoal> {
        self.now = self.now.plus_ns(after_ms * MS);
        self.number += 1;
        let received_ns = self.now.ns() - MS;
        let sent_ns = received_ns - 3 * MS + CALENDAR_NS;
        let attachment = Some(Envelope { layout: 0, session: 7, number: self.number, sent_ns });
        let mut called =
            Called { topic: Some(topic), is_type: true, parcel: Parcel::new(topic, message), attachment, received_ns };
        change(&mut called);
        self.called.force_push(called);
        self.bridge.step(self.now);
        self.bridge.flush(self.now);
        self.goals.refresh();
        self.peer.refresh();
        self.events.refresh();
        self.goals.samples().to_vec()
    }

    fn said(&self) -> String {
        self.events.samples().iter().map(|event| text_of(&event.text)).collect::<Vec<_>>().join("; ")
    }

    fn counts(&self) -> PeerState {
        *self.peer.get().unwrap()
    }
}

fn as_it_is(_: &mut Called) {}

#[test]
fn a_pose_within_its_bounds_is_a_goal_of_the_base_and_says_nothing_of_the_arm() {
    let mut flown = Flown::new();
    let goals = flown.call(1000, 0, &pose(0, "map", [0.5, -0.2, 1.0]), as_it_is);
    let [goal] = goals.as_slice() else { panic!("{goals:?}") };
    for (is, wanted) in goal.base_goal.iter().zip([0.5, -0.2, 1.0]) {
        assert!((is - wanted).abs() < 1e-12, "{:?}", goal.base_goal);
    }
    assert!(goal.q_goal_rad.iter().all(|q_rad| q_rad.is_nan()));
    assert_eq!(goal.stamp_ns, flown.now.ns() - MS, "nothing tells the clocks and the shortest way apart");
    let counts = flown.counts();
    assert_eq!((text_of(&counts.vehicle), counts.received, counts.speaks), ("ros2", 1, 1));
}

#[test]
fn joints_are_found_by_their_names_in_any_order_and_those_unnamed_are_left_alone() {
    let mut flown = Flown::new();
    let goal = flown.call(1000, 1, &joints(&["joint_2", "joint_1"], &[0.2, 0.1]), as_it_is)[0];
    assert_eq!(goal.q_goal_rad[..2], [0.1, 0.2]);
    assert!(goal.base_goal.iter().chain(&goal.q_goal_rad[2..]).all(|value| value.is_nan()));
    let goal = flown.call(100, 1, &joints(&["joint_2"], &[-0.3]), as_it_is)[0];
    assert!(goal.q_goal_rad[0].is_nan() && goal.q_goal_rad[1] == -0.3, "{goal:?}");
}

#[test]
fn what_is_not_listed_changes_nothing_and_is_counted() {
    let mut flown = Flown::new();
    let elsewhere = |called: &mut Called| {
        (called.topic, called.parcel) = (None, Parcel::new(0, b"/other/goal"));
    };
    for _ in 0..3 {
        assert!(flown.call(1000, 0, &[], elsewhere).is_empty());
    }
    assert_eq!((flown.counts().refused_topic, flown.counts().received), (3, 0));
    flown.call(4000, 0, &[], elsewhere);
    assert_eq!(flown.said(), "a message on /other/goal changes nothing: [[ros2.receive]] does not name it");
}

#[test]
fn what_is_malformed_out_of_bounds_old_or_of_another_type_is_refused_by_its_reason() {
    let good = pose(0, "map", [0.5, 0.2, 1.0]);
    let turned = |by: f64| pose(0, "", [0.0, 0.0, by]);
    let refused = |topic: usize, message: &[u8], change: fn(&mut Called), count: fn(&PeerState) -> u64, words: &str| {
        let mut flown = Flown::new();
        assert!(flown.call(1000, topic, message, change).is_empty(), "{words}");
        assert_eq!((count(&flown.counts()), flown.counts().received), (1, 0), "{words}: {:?}", flown.counts());
        assert!(flown.said().contains(words), "{}, not '{words}'", flown.said());
    };
    let form: fn(&PeerState) -> u64 = |counts| counts.refused_form;
    for message in [&good[..good.len() - 8], &[good.as_slice(), &[0; 8]].concat(), &good[..3], &[], &[0; 4000]] {
        refused(0, message, as_it_is, form, "");
    }
    let big_endian = [&[0, 0, 0, 0], &good[4..]].concat();
    refused(0, &big_endian, as_it_is, form, "no CDR of its type");
    refused(0, &pose(0, "odom", [0.0; 3]), as_it_is, form, "its frame is not 'map'");
    refused(0, &pose(0, "map", [f64::NAN, 0.0, 0.0]), as_it_is, form, "not finite");
    let leaning = [0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5].into_iter().fold(Cdr::default().header(0, "map"), Cdr::f64);
    refused(0, &leaning.message(), as_it_is, form, "no rotation about z");
    refused(1, &joints(&["joint_9"], &[0.0]), as_it_is, form, "the arm does not have");
    refused(1, &joints(&["joint_1", "joint_1"], &[0.0, 0.1]), as_it_is, form, "twice");
    refused(1, &joints(&["joint_1", "joint_2"], &[0.0]), as_it_is, form, "a position");
    refused(1, &joints(&["joint_1"], &[f64::INFINITY]), as_it_is, form, "not finite");
    refused(0, &good, |called| called.attachment = None, form, "cannot be read");
    let bounds: fn(&PeerState) -> u64 = |counts| counts.refused_bounds;
    refused(0, &pose(0, "map", [1.1, 0.0, 0.0]), as_it_is, bounds, "x_m = 1.100 is out of bounds");
    refused(0, &pose(0, "map", [0.0, -0.6, 0.0]), as_it_is, bounds, "y_m = -0.600");
    refused(0, &turned(-2.0), as_it_is, bounds, "theta_deg = -114.592");
    refused(1, &joints(&["joint_2"], &[1.1]), as_it_is, bounds, "q_deg = 63.025");
    refused(0, &good, |called| called.is_type = false, |counts| counts.refused_layout, "another type");
    let old_ns = CALENDAR_NS + 77_000 * MS - 2000 * MS;
    refused(0, &pose(old_ns, "map", [0.0; 3]), as_it_is, |counts| counts.refused_age, "it is 3.00 s old");
}

#[test]
fn goals_that_come_too_fast_are_refused_and_those_at_the_rate_are_not() {
    let mut flown = Flown::new();
    let goal = pose(0, "map", [0.0; 3]);
    let taken = |flown: &mut Flown, period_ms: u64| {
        flown.now = flown.now.plus_ns(5000 * MS);
        (0..40).map(|_| flown.call(period_ms, 0, &goal, as_it_is).len()).sum::<usize>()
    };
    assert_eq!(taken(&mut flown, 500), 40, "2 Hz are allowed");
    assert!((20..=23).contains(&taken(&mut flown, 250)), "half of 4 Hz pass");
    assert!(flown.counts().refused_rate >= 17);
}

#[test]
fn one_node_at_a_time_is_heard_and_nothing_twice_or_late() {
    let mut flown = Flown::new();
    let goal = pose(0, "map", [0.0; 3]);
    let other = |called: &mut Called| called.attachment.as_mut().unwrap().session = 99;
    assert_eq!(flown.call(1000, 0, &goal, as_it_is).len(), 1);
    assert!(flown.call(1000, 0, &goal, other).is_empty(), "the first spoke a second ago");
    assert_eq!(flown.call(600, 0, &goal, as_it_is).len(), 1);
    assert_eq!(flown.call(2100, 0, &goal, other).len(), 1, "it is silent");
    let again = |called: &mut Called| {
        other(called);
        called.attachment.as_mut().unwrap().number = 4;
    };
    assert!(flown.call(600, 0, &goal, again).is_empty(), "the same number");
    let late = |called: &mut Called| {
        other(called);
        called.attachment.as_mut().unwrap().sent_ns -= 500 * MS;
    };
    assert!(flown.call(600, 0, &goal, late).is_empty(), "half a second longer on its way than the others");
    let counts = flown.counts();
    assert_eq!((counts.received, counts.refused_sequence, counts.refused_age), (3, 2, 1));
}

#[test]
fn random_messages_are_counted_one_by_one_and_what_passes_is_within_bounds() {
    let seed = 20_261_126;
    println!("seed {seed}");
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut flown = Flown::new();
    for _ in 0..20_000 {
        let topic = rng.random_range(0..2);
        let mut message = match topic {
            0 => pose(0, "map", [rng.random_range(-2.0..2.0), rng.random_range(-1.0..1.0), 0.0]),
            _ => joints(&["joint_1", "joint_2"], &[rng.random_range(-2.0..2.0), 0.0]),
        };
        for _ in 0..rng.random_range(0..3) {
            let at = rng.random_range(0..message.len());
            message[at] ^= 1 << rng.random_range(0..8);
        }
        for goal in flown.call(rng.random_range(1..1000), topic, &message, as_it_is) {
            assert!(!goal.base_goal[0].is_finite() || goal.base_goal[0].abs() <= 1.0, "{goal:?}");
            assert!(goal.q_goal_rad.iter().all(|q_rad| q_rad.is_nan() || q_rad.abs() < 1.05), "{goal:?}");
        }
    }
    let s = flown.counts();
    assert!(s.received > 1000, "{s:?}");
    let refused = s.refused_form + s.refused_bounds + s.refused_rate + s.refused_age + s.refused_sequence;
    assert_eq!(s.received + refused, 20_000, "{s:?}");
}

#[test]
fn a_list_that_makes_no_sense_is_refused_where_it_stands_with_what_to_do() {
    for (from, to, words) in [
        ("/goal_pose", "goal pose", "'goal pose' is no topic of ROS 2"),
        ("/arm/goal", "/goal_pose", "/goal_pose is received twice"),
        ("PoseStamped", "Twist", "unknown variant `geometry_msgs/msg/Twist`"),
        ("max_rate_hz = 2\n", "", "missing field `max_rate_hz`"),
        ("max_rate_hz = 2\n", "max_rate_hz = 0\n", "/goal_pose cannot come at 0 Hz"),
        ("y_m = [-0.5, 0.5]\n", "", "/goal_pose has no bounds `y_m`"),
        ("y_m = [-0.5, 0.5]", "y_m = [0.5, -0.5]", "from 0.5 to -0.5 is no range"),
        ("y_m = [-0.5, 0.5]", "y_m = [nan, 0.5]", "is no range"),
        ("q_deg = [-60, 60]", "q_deg = [-60, 60]\nx_m = [0, 1]", "/arm/goal has no `x_m`"),
        ("[ros2]", "[ros2]\nlisten = [\"0.0.0.0:7447\"]", "ROS 2 does not authenticate"),
        ("[ros2]", "[ros2]\nconnect = [\"192.168.1.5:7447\"]", "ROS 2 does not authenticate"),
        ("[devices]", "vehicle = \"ros2\"\n[devices]", "no vehicle can be called 'ros2'"),
    ] {
        let text = LAUNCH.replacen(from, to, 1);
        let refused = Launch::parse(&text, &["bridge"]).unwrap_err();
        assert!(refused.message.contains(words), "{refused}, not '{words}'");
        assert!(refused.span.is_some() || to.starts_with("vehicle"), "{words} has no place");
    }
}

#[test]
fn the_tables_of_the_page_are_read_as_printed() {
    let page = include_str!("../../../docs/ros2.md");
    let tables: String =
        page.split("```toml").skip(1).filter_map(|rest| rest.split("```").next()).collect::<Vec<_>>().join("\n");
    let devices = LAUNCH.split("[ros2]").next().unwrap();
    let ros2 = Launch::parse(&format!("{devices}{tables}"), &["bridge"]).unwrap().ros2.unwrap();
    let names: Vec<_> = ros2.receive.iter().map(|receive| receive.topic.get_ref().as_str()).collect();
    assert_eq!((names, ros2.share.len()), (vec!["/goal_pose", "/joint_commands"], 3));
    assert!(ros2.listen().iter().all(|address| address.ip().is_loopback()), "alone on its host where nothing is said");
}
