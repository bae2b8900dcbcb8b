//! What the launch file lets nodes of ROS 2 see, and want.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{json, refused, succeed};
use fss_messages::{Event, LinksState, MissionGoal, MissionState, NavState, PeerState, Sample, text_of, topic};
use fss_records::log::{Log, Samples};
use fss_ros2::cdr::Cdr;
use fss_ros2::rmw_zenoh::{Attachment, Endpoint, Node, source_id};
use fss_ros2::standard::{Definition, JOINT_STATE, POSE_2D, POSE_STAMPED};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use zenoh::Wait;

const LAB: &str = include_str!("../deploy/etc/launch/lab.toml");
const BRIDGE: &str = "\n[[service]]\nname = \"bridge\"\nrate_hz = 50\nphase_us = 4500\n";

#[test]
fn topics_that_nobody_publishes_and_a_bridge_that_is_not_launched_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (share, service, words) in [
        ("/nav/mood", BRIDGE, vec!["launch.toml:", "no topic /nav/mood", "/nav/state"]),
        ("/nav/state", "", vec!["[ros2] is there", "name = \"bridge\""]),
    ] {
        let path = folder.path().join("launch.toml");
        let ros2 = format!("[ros2]\nshare = [\"{share}\"]\n\n[devices]");
        std::fs::write(&path, LAB.replace("[devices]", &ros2) + service).unwrap();
        let out = folder.path().join("out");
        refused(&["run", "--fast", "--launch", path.to_str().unwrap(), "--out", out.to_str().unwrap()], &words);
    }
}

const PORT: u16 = 54_930;
const MISSION: &str = include_str!("../deploy/etc/missions/follow.toml");

fn launch() -> String {
    let ros2 = format!(
        r#"[ros2]
listen = ["127.0.0.1:{PORT}"]
share = ["/nav/state", "/mission/state"]
standard = false
[[ros2.receive]]
topic = "/goal_pose"
type = "geometry_msgs/msg/PoseStamped"
max_rate_hz = 4
x_m = [-1, 1]
y_m = [-1, 1]
[[ros2.receive]]
topic = "/joint_commands"
type = "sensor_msgs/msg/JointState"
max_rate_hz = 100
q_deg = [-70, 70]

[devices]"#
    );
    LAB.replace("[devices]", &ros2).replace("51001", "54931").replace("5110", "5494") + BRIDGE
}

/// A node of ROS 2 with nothing of ROS 2 installed.
struct Client {
    session: zenoh::Session,
    number: i64,
    mission: Arc<Mutex<Option<MissionState>>>,
    nav: Arc<Mutex<Option<NavState>>>,
    _subscribers: Vec<zenoh::pubsub::Subscriber<()>>,
}

fn listen<T: Sample>(session: &zenoh::Session, topic: &str) -> (Arc<Mutex<Option<T>>>, zenoh::pubsub::Subscriber<()>) {
    let newest = Arc::new(Mutex::new(None));
    let to = newest.clone();
    let take = move |sample: zenoh::sample::Sample| {
        *to.lock().unwrap() = T::read_from_bytes(&sample.payload().to_bytes()[4..]).ok();
    };
    let subscriber = session.declare_subscriber(format!("0{topic}/*/*")).callback(take).wait().unwrap();
    (newest, subscriber)
}

fn now_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as u64
}

impl Client {
    /// Joins the stack once it can be reached, and waits until its mission runs.
    fn join() -> Self {
        let config =
            format!(r#"{{mode: "client", connect: {{endpoints: ["tcp/127.0.0.1:{PORT}"], timeout_ms: 20000}}}}"#);
        let session = zenoh::open(zenoh::Config::from_json5(&config).unwrap()).wait().unwrap();
        let (mission, of_mission) = listen(&session, "/mission/state");
        let (nav, of_nav) = listen(&session, "/nav/state");
        let client = Self { session, number: 0, mission, nav, _subscribers: vec![of_mission, of_nav] };
        client.wait_for("the mission runs", |_, mission| mission.state == MissionState::RUNNING);
        client
    }

    fn wait_for(&self, what: &str, is_so: impl Fn(&NavState, &MissionState) -> bool) {
        let begun = Instant::now();
        loop {
            if let (Some(nav), Some(mission)) = (*self.nav.lock().unwrap(), *self.mission.lock().unwrap())
                && is_so(&nav, &mission)
            {
                return;
            }
            assert!(begun.elapsed() < Duration::from_secs(25), "in vain: {what}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Sends a message, its number being `number`.
    fn send_as(&self, number: i64, topic: &str, definition: &Definition, message: &[u8]) {
        let (schema, hash) = (definition.name.to_owned(), definition.hash());
        let node = Node { domain: 0, session: String::new(), name: "led".to_owned() };
        let endpoint = Endpoint { topic: topic.to_owned(), schema, hash, id: 1 };
        let source = source_id(&node.publisher_token(&endpoint));
        let attachment = Attachment { number, time_ns: now_ns() as i64, source }.encode();
        self.session.put(node.key(&endpoint), message).attachment(attachment.as_slice()).wait().unwrap();
    }

    /// Sends the next message, and leaves the time that the rate limits want.
    fn send(&mut self, topic: &str, definition: &Definition, message: &[u8]) {
        self.number += 1;
        self.send_as(self.number, topic, definition, message);
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn pose(pose: [f64; 3]) -> Vec<u8> {
    Cdr::default().header(0, "map").pose(pose, 0.0).message()
}

fn joint_state(names: &[String], q_rad: &[f64]) -> Vec<u8> {
    let numbers = |cdr: Cdr, values: &[f64]| cdr.list(values, |cdr, value| cdr.f64(*value));
    let cdr = Cdr::default().header(now_ns(), "").list(names, |cdr, name| cdr.text(name));
    [q_rad, &[], &[]].into_iter().fold(cdr, numbers).message()
}

/// What must not count: other topics, another type, beyond bounds, malformed, old, too fast, twice.
fn misbehave(client: &mut Client, names: &[String]) {
    let there = [0.2, 0.3, 1.0];
    for _ in 0..5 {
        client.send("/other/goal", &POSE_STAMPED, &pose(there));
    }
    for _ in 0..3 {
        client.send("/other_joints", &JOINT_STATE, &joint_state(names, &[0.0; 4]));
    }
    let flat = there.into_iter().fold(Cdr::default(), Cdr::f64).message();
    client.send("/goal_pose", &POSE_2D, &flat);
    client.send("/goal_pose", &POSE_STAMPED, &pose([5.0, 0.0, 0.0]));
    client.send("/joint_commands", &JOINT_STATE, &joint_state(names, &[1.5; 4]));
    client.send("/goal_pose", &POSE_STAMPED, &pose([f64::NAN, 0.0, 0.0]));
    client.send("/goal_pose", &POSE_STAMPED, &pose(there)[..60]);
    client.send("/goal_pose", &POSE_STAMPED, &[0xff; 5000]);
    let old = Cdr::default().header(now_ns() - 10_000_000_000, "map").pose(there, 0.0).message();
    client.send("/goal_pose", &POSE_STAMPED, &old);
    std::thread::sleep(Duration::from_secs(2));
}

/// A flight; killed where the test ends before it does.
struct Flight(Child);

impl Drop for Flight {
    fn drop(&mut self) {
        if matches!(self.0.try_wait(), Ok(None)) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }
}

fn start(folder: &Path) -> Flight {
    std::fs::write(folder.join("launch.toml"), launch()).unwrap();
    std::fs::write(folder.join("led.toml"), MISSION.replace("= 600", "= 32")).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_fss"));
    command.args(["run", "led.toml", "--quiet", "--launch", "launch.toml", "--out", "out"]).current_dir(folder);
    Flight(command.stdout(Stdio::null()).spawn().unwrap())
}

fn samples<T: Sample>(log: &Log, topic: &str) -> Vec<T> {
    let mut samples = Samples::<T>::of(topic);
    log.collect(&mut [&mut samples]).unwrap();
    samples.samples
}

#[test]
fn base_and_arm_go_where_a_node_wants_them_and_nothing_that_is_not_allowed_moves_them() {
    let folder = tempfile::tempdir().unwrap();
    let mut flight = start(folder.path());
    let mut client = Client::join();
    let names: Vec<String> = [3, 1, 4, 2].map(|joint| format!("joint_{joint}")).to_vec();
    let before = client.mission.lock().unwrap().unwrap();
    misbehave(&mut client, &names);
    let after = client.mission.lock().unwrap().unwrap();
    assert_eq!((after.base_goal, after.q_goal_rad), (before.base_goal, before.q_goal_rad), "nothing of it was a goal");

    let [x, y, theta] = before.base_goal;
    let wanted = [x + 0.06, y - 0.04, theta + 0.1];
    client.send("/goal_pose", &POSE_STAMPED, &pose(wanted));
    client.wait_for("the base is where it was wanted", |nav, mission| {
        mission.base_goal[0] > x + 0.05
            && (nav.x_m - wanted[0]).hypot(nav.y_m - wanted[1]) < 0.01
            && (nav.theta_rad - wanted[2]).abs() < 0.02
    });
    // The same number again, then more at once than may come.
    client.send_as(client.number, "/goal_pose", &POSE_STAMPED, &pose(wanted));
    std::thread::sleep(Duration::from_millis(300));
    for number in 0..10 {
        client.send_as(1000 + number, "/goal_pose", &POSE_STAMPED, &pose(wanted));
    }
    // As a controller streams them, its joints in an order of their own: joints 3, 1, 4, 2.
    let q_rad = [-1.0, -0.45, 0.6, 0.95];
    for _ in 0..100 {
        client.send("/joint_commands", &JOINT_STATE, &joint_state(&names, &q_rad));
    }
    assert!(flight.0.wait().unwrap().success());
    drop(client);
    flew_as_told(&folder.path().join("out"), wanted, [-0.45, 0.95, -1.0, 0.6]);
}

/// What the log has of it.
#[track_caller]
fn flew_as_told(out: &Path, base: [f64; 3], q_rad: [f64; 4]) {
    assert_eq!(json(&out.join("summary.json"))["outcome"], "done");
    let log = Log::open(&out.join("run.mcap")).unwrap();
    let nav = *samples::<NavState>(&log, topic::NAV_STATE.name).last().unwrap();
    assert!((nav.x_m - base[0]).hypot(nav.y_m - base[1]) < 0.02, "{nav:?}, not {base:?}");
    let links = *samples::<LinksState>(&log, topic::LINKS_STATE.name).last().unwrap();
    for (is, wanted) in links.q_rad.iter().zip(q_rad) {
        assert!((is - wanted).abs() < 0.01, "{:?}, not {q_rad:?}", &links.q_rad[..4]);
    }
    let goals = samples::<MissionGoal>(&log, topic::MISSION_GOAL.name);
    let of_base = goals.iter().filter(|goal| goal.base_goal[0].is_finite());
    assert!(of_base.clone().all(|goal| (goal.base_goal[0] - base[0]).abs() < 1e-9), "no other goal was published");
    let peer = *samples::<PeerState>(&log, "/ros2/peer").last().unwrap();
    assert_eq!(peer.received as usize, goals.len());
    assert_eq!(goals.len() - of_base.count(), 100, "{peer:?}");
    assert_eq!((peer.refused_topic, peer.refused_layout, peer.refused_bounds), (8, 1, 2), "{peer:?}");
    assert_eq!((peer.refused_form, peer.refused_age, peer.refused_sequence), (3, 1, 1), "{peer:?}");
    assert!(peer.refused_rate >= 7, "{peer:?}");
    let said = samples::<Event>(&log, topic::EVENTS.name);
    let said: Vec<_> = said.iter().map(|event| text_of(&event.text)).collect();
    for words in
        ["a message on /other/goal changes nothing", "a message on /goal_pose is refused", "follows a goal: x "]
    {
        assert!(said.iter().any(|sentence| sentence.starts_with(words)), "no '{words}': {said:#?}");
    }
    let replayed = succeed(&["replay", log.path().to_str().unwrap()]);
    assert!(replayed.lines().any(|line| line.starts_with("mission ") && line.ends_with(" 0")), "{replayed}");
}

#[test]
fn a_list_that_anyone_on_the_network_could_use_is_refused_at_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("launch.toml");
    std::fs::write(&path, launch().replace(&format!("127.0.0.1:{PORT}"), "0.0.0.0:7447")).unwrap();
    let line = launch().lines().position(|line| line.contains("/goal_pose")).unwrap() + 1;
    let words = [&format!("launch.toml:{line}:"), "ROS 2 does not authenticate", "ssh -L"];
    refused(&["run", "hold", "--launch", path.to_str().unwrap()], &words);
}
