//! Two vehicles: stacks with names on one computer, and on two that are joined by a cable which is pulled.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{fss, json, refused, succeed, text};
use fss_messages::{Event, NavState, PeerState, Sample, TruthState, text_of};
use fss_records::log::{Log, Samples};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};
use zerocopy::IntoBytes;

const FSS: &str = env!("CARGO_BIN_EXE_fss");
const CHASER: &str = include_str!("../deploy/etc/launch/chaser.toml");
const TARGET: &str = include_str!("../deploy/etc/launch/target.toml");

/// Two stacks are as many as this computer flies at once.
static ONE_PAIR: Mutex<()> = Mutex::new(());

/// Holds its place for so long, in a laboratory that has a target where the other vehicle stands in its own.
fn chaser_mission(hold_s: u32) -> String {
    let target = "x_m = -0.9
[target]
mass_kg = 10
inertia_kg_m2 = 0.15
radius_m = 0.15
";
    holding("watch", &format!("{target}{TARGET_PLACE}"), hold_s)
}

fn target_mission(hold_s: u32) -> String {
    holding("stand", TARGET_PLACE, hold_s)
}

const TARGET_PLACE: &str = "x_m = 0.7\ny_m = 0.2\ntheta_deg = 180";

/// A mission that holds base and arm from such a beginning on.
fn holding(name: &str, initial: &str, hold_s: u32) -> String {
    format!(
        r#"name = "{name}"
[initial]
q_deg = [-30, 60, -60, 30]
{initial}
[[phase]]
name = "hold"
duration_s = {hold_s}
base = {{ goal = "hold" }}
arm = {{ goal = "hold" }}
"#
    )
}

/// A stack in flight; killed where a test ends before it does.
struct Flight {
    child: Child,
    folder: PathBuf,
}

impl Flight {
    /// Starts one with these files, through the command `by` where it is to run elsewhere.
    fn start(by: &[&str], folder: &Path, name: &str, launch: &str, mission: &str) -> Self {
        let file = |kind: &str, text: &str| {
            let path = folder.join(format!("{name}-{kind}.toml"));
            std::fs::write(&path, text).unwrap();
            path
        };
        let (launch, mission) = (file("launch", launch), file("mission", mission));
        let out = folder.join(name);
        let mut words: Vec<&str> = by.to_vec();
        words.push(FSS);
        let child = Command::new(words[0])
            .args(&words[1..])
            .args(["run", mission.to_str().unwrap(), "--quiet", "--launch", launch.to_str().unwrap(), "--out"])
            .arg(&out)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        Self { child, folder: out }
    }

    /// Waits for its end, which must be a good one.
    fn lands(mut self) -> Log {
        let begun = Instant::now();
        while self.child.try_wait().unwrap().is_none() {
            assert!(begun.elapsed() < Duration::from_mins(3), "it does not end");
            std::thread::sleep(Duration::from_millis(50));
        }
        let mut said = String::new();
        std::io::Read::read_to_string(self.child.stderr.as_mut().unwrap(), &mut said).unwrap();
        assert!(self.child.wait().unwrap().success(), "{said}");
        assert_eq!(json(&self.folder.join("summary.json"))["outcome"], "done");
        Log::open(&self.folder.join("run.mcap")).unwrap()
    }

    /// The process of one of its services.
    fn process(&self, service: &str) -> u32 {
        let (words, own_program) = (format!("service\0{service}\0"), format!("fss-{service}\0"));
        let folder = self.folder.canonicalize().unwrap().display().to_string();
        let is_it = |line: &str| (line.contains(&words) || line.contains(&own_program)) && line.contains(&folder);
        let mut processes = std::fs::read_dir("/proc").unwrap().flatten().filter_map(|entry| {
            let id = entry.file_name().to_string_lossy().parse::<u32>().ok()?;
            let line = std::fs::read(entry.path().join("cmdline")).ok()?;
            is_it(&text(&line)).then_some(id)
        });
        processes.next().unwrap_or_else(|| panic!("no process of {service}"))
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

fn samples<T: Sample>(log: &Log, topic: &str) -> Vec<T> {
    let mut samples = Samples::<T>::of(topic);
    log.collect(&mut [&mut samples]).unwrap();
    samples.samples
}

/// What a service said, in order.
fn said(log: &Log, topic: &str, service: &str) -> Vec<String> {
    let events = samples::<Event>(log, topic);
    let own = events.iter().filter(|event| text_of(&event.service) == service);
    own.map(|event| text_of(&event.text).to_owned()).collect()
}

/// Whether these beginnings of sentences were said, one after another, among others.
#[track_caller]
fn says_in_order(said: &[String], wanted: &[&str]) {
    let mut rest = said.iter();
    for words in wanted {
        assert!(rest.any(|sentence| sentence.starts_with(words)), "no '{words}' in its place: {said:#?}");
    }
}

/// Every state of the target in the chaser's log is one of the target's own, byte for byte; how many there are.
#[track_caller]
fn same_bytes(chaser: &Log, target: &Log) -> usize {
    let own = samples::<NavState>(target, "/target/nav/state");
    let heard = samples::<NavState>(chaser, "/target/nav/state");
    for state in &heard {
        let same = own.iter().find(|own| own.sequence == state.sequence).expect("a state that was never published");
        assert_eq!(state.as_bytes(), same.as_bytes());
    }
    assert!(heard.is_sorted_by_key(|state| state.sequence), "they come in order");
    heard.len()
}

#[test]
fn two_stacks_on_one_computer_keep_their_names_and_their_shared_memory_apart() {
    let _alone = ONE_PAIR.lock();
    let folder = tempfile::tempdir().unwrap();
    // Of the target it knows the mass and the size; where it is the target's own laboratory says.
    let mission =
        chaser_mission(16).replace(&format!("radius_m = 0.15\n{TARGET_PLACE}"), "radius_m = 0.15\nx_m = 0\ny_m = 0");
    let chaser = Flight::start(&[], folder.path(), "chaser", CHASER, &mission);
    let target = Flight::start(&[], folder.path(), "target", TARGET, &target_mission(4));
    std::thread::sleep(Duration::from_secs(6));
    let top = text(&fss(&["top", "--once", "--vehicle", "chaser"]).stdout);
    let told = top.split("navigation ").nth(1).and_then(|told| told.split(' ').next()?.parse::<f64>().ok());
    // It holds its place to its dead band of some millimetres.
    assert!(told.is_some_and(|x_m| (x_m + 0.9).abs() < 0.01) && top.contains("bridge"), "{top}");
    let target = target.lands(); // and tidies up, while the chaser flies
    let chaser = chaser.lands();
    let topics = |log: &Log| log.topics().unwrap().into_iter().map(|topic| topic.topic).collect::<Vec<_>>();
    assert!(topics(&chaser).iter().all(|topic| topic.starts_with("/chaser/") || topic.starts_with("/target/")));
    let of_target = topics(&chaser).into_iter().filter(|topic| topic.starts_with("/target/")).collect::<Vec<_>>();
    assert_eq!(of_target, ["/target/nav/state", "/target/peer"]);
    assert!(same_bytes(&chaser, &target) > 200);
    says_in_order(&said(&chaser, "/chaser/events", "bridge"), &["target speaks", "target is stale"]);
    one_table(&chaser, &target);
}

/// The two laboratories share a table: the chaser's target is where the target's own laboratory has its base.
#[track_caller]
fn one_table(chaser: &Log, target: &Log) {
    let seen = samples::<TruthState>(chaser, "/chaser/truth/state");
    let mut together = 0;
    for own in samples::<TruthState>(target, "/target/truth/state").iter().skip(50) {
        let Some(seen) = seen.iter().find(|seen| seen.stamp_ns.abs_diff(own.stamp_ns) < 2_000_000) else { continue };
        let apart_m = (seen.target[0] - own.x_m).hypot(seen.target[1] - own.y_m);
        assert!(apart_m < 1e-3, "the target is seen {apart_m} m beside where it is");
        together += 1;
    }
    assert!(together > 200, "both truths were told at {together} times");
}

#[test]
fn a_table_that_cannot_be_shared_is_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let launch = folder.path().join("launch.toml");
    let tried = |text: &str, words: &[&str]| {
        assert_ne!(text, CHASER);
        std::fs::write(&launch, text).unwrap();
        refused(&["run", "hold", "--launch", launch.to_str().unwrap()], words);
    };
    tried(
        &CHASER.replace("127.0.0.1:54300", "127.0.0.1:53300"),
        &["launch.toml", "are the same", "the other launch file"],
    );
    tried(&CHASER.replace("127.0.0.1:54300", "192.168.10.21:54300"), &["launch.toml", "one clock", "loopback"]);
    let lab = CHASER.find("[[service]]\nname = \"lab\"").unwrap();
    let next = lab + 5 + CHASER[lab + 5..].find("[[service]]").unwrap();
    tried(&format!("{}{}", &CHASER[..lab], &CHASER[next..]), &["launch.toml", "[granite]", "the real table is one"]);
}

/// Two network namespaces and a cable between them; gone when dropped.
struct Cable {
    spaces: [String; 2],
    ends: [String; 2],
}

/// Runs `ip`; what it said where it refuses.
fn ip(words: &str) -> Result<(), String> {
    let output = Command::new("ip").args(words.split(' ')).output().map_err(|e| format!("ip: {e}"))?;
    if output.status.success() { Ok(()) } else { Err(format!("ip {words}: {}", text(&output.stderr).trim())) }
}

impl Cable {
    fn lay() -> Result<Self, String> {
        let id = std::process::id();
        let cable =
            Self { spaces: [format!("fss-c{id}"), format!("fss-t{id}")], ends: [format!("fc{id}"), format!("ft{id}")] };
        let Self { spaces: [chaser, target], ends: [end_c, end_t] } = &cable;
        ip(&format!("netns add {chaser}"))?;
        ip(&format!("netns add {target}"))?;
        ip(&format!("link add {end_c} netns {chaser} type veth peer name {end_t} netns {target}"))?;
        for (space, end, host) in [(chaser, end_c, 1), (target, end_t, 2)] {
            ip(&format!("-n {space} addr add 10.213.7.{host}/24 dev {end}"))?;
            ip(&format!("-n {space} link set {end} up"))?;
            ip(&format!("-n {space} link set lo up"))?;
        }
        Ok(cable)
    }

    fn pull(&self) {
        ip(&format!("-n {} link set {} down", self.spaces[1], self.ends[1])).unwrap();
    }

    fn plug(&self) {
        ip(&format!("-n {} link set {} up", self.spaces[1], self.ends[1])).unwrap();
    }

    /// The ports on which something listens, TCP, and waits for anybody, UDP, beyond the loopback.
    fn open_ports(&self, space: usize) -> (Vec<u16>, Vec<u16>) {
        let read = |table: &str, state: &str| {
            let name = &self.spaces[space];
            let output =
                Command::new("ip").args(["netns", "exec", name, "cat", &format!("/proc/net/{table}")]).output();
            let table = text(&output.unwrap().stdout);
            let lines = table.lines().skip(1).map(|line| line.split_whitespace().collect::<Vec<_>>());
            let open = lines.filter(|words| words[3] == state && !words[1].starts_with("0100007F"));
            open.map(|words| u16::from_str_radix(words[1].rsplit(':').next().unwrap(), 16).unwrap()).collect::<Vec<_>>()
        };
        let both = |a: &str, b: &str, state: &str| [read(a, state), read(b, state)].concat();
        (both("tcp", "tcp6", "0A"), both("udp", "udp6", "07"))
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        for space in &self.spaces {
            let _ = ip(&format!("netns del {space}"));
        }
    }
}

#[test]
fn vehicles_on_two_hosts_hear_each_other_fly_on_when_the_cable_is_pulled_and_hear_again() {
    let _alone = ONE_PAIR.lock();
    let cable = match Cable::lay() {
        Ok(cable) => cable,
        Err(why) => {
            return common::skipped(&format!("network namespaces need root and iproute2: {why}"));
        }
    };
    let folder = tempfile::tempdir().unwrap();
    let by = |space: usize| ["ip", "netns", "exec", cable.spaces[space].as_str()];
    let launch = |text: &str| text.replace("127.0.0.1:7447", "10.213.7.2:7447");
    let chaser = Flight::start(&by(0), folder.path(), "chaser", &launch(CHASER), &chaser_mission(32));
    let target = Flight::start(&by(1), folder.path(), "target", &launch(TARGET), &target_mission(34));
    std::thread::sleep(Duration::from_secs(10));
    assert_eq!(cable.open_ports(0), (vec![], vec![]), "the chaser listens nowhere");
    assert_eq!(cable.open_ports(1), (vec![7447], vec![]), "the target where its launch file says");
    cable.pull();
    std::thread::sleep(Duration::from_secs(6));
    cable.plug();
    std::thread::sleep(Duration::from_secs(7));
    let bridge = chaser.process("bridge").to_string();
    assert!(Command::new("kill").args(["-KILL", &bridge]).status().unwrap().success());
    let chaser = chaser.lands();
    let target = target.lands();

    assert!(same_bytes(&chaser, &target) > 1000);
    assert!(!samples::<NavState>(&target, "/chaser/nav/state").is_empty(), "the target hears the chaser");
    let bridge = said(&chaser, "/chaser/events", "bridge");
    says_in_order(&bridge, &["target speaks", "target is stale", "target speaks", "restarted", "target speaks"]);
    let word = ["the target speaks", "the target's word is stale"];
    let mission = said(&chaser, "/chaser/events", "mission");
    says_in_order(&mission, &[word[0], word[1], word[0], "mission watch is done"]);
    // One kernel, one clock: what the bridge believes of the other clock is the way of a sample.
    let peers = samples::<PeerState>(&chaser, "/target/peer");
    let offsets = peers.iter().filter(|peer| peer.received > 0).map(|peer| peer.clock_offset_ns);
    assert!(offsets.clone().all(|offset_ns| (0..1_000_000_000).contains(&offset_ns)), "{:?}", offsets.max());
    let replayed = succeed(&["replay", chaser.path().to_str().unwrap()]);
    assert!(replayed.lines().any(|line| line.starts_with("mission ") && line.ends_with(" 0")), "{replayed}");
}
