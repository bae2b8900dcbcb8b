//! The live view as a laboratory's tools meet it: over a WebSocket, with nothing of ours in the client.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;
#[path = "ground/viewer.rs"]
mod viewer;

use common::{json as json_file, refused, text};
use fss_messages::{Event, Health, NavState, PARAMETERS, Parameters, text_of, topic};
use fss_records::log::Log;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use viewer::{Viewer, decode};
use zerocopy::IntoBytes;

const PATIENCE: Duration = Duration::from_secs(30);

/// A stack that flies in real time, from its own launch file; each has ports of its own.
struct Flight {
    folder: tempfile::TempDir,
    process: Child,
}

impl Flight {
    /// Flies `hold` with these lines in front of the laboratory's launch file's services.
    fn start(ports: u16, ground: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let launch = folder.path().join("launch-test.toml");
        let lab = include_str!("../deploy/etc/launch/lab.toml");
        let lab = lab.replace("51001", &ports.to_string()).replace("5110", &(ports / 10 + 1).to_string());
        std::fs::write(&launch, format!("{lab}\n{ground}\n")).unwrap();
        let process = Command::new(env!("CARGO_BIN_EXE_fss"))
            .args(["run", "hold", "--quiet", "--launch", launch.to_str().unwrap()])
            .args(["--out", folder.path().join("out").to_str().unwrap()])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        Self { folder, process }
    }

    fn log(&self) -> PathBuf {
        self.folder.path().join("out/run.mcap")
    }

    /// Waits until it has flown; gives its log and how it ended.
    fn land(&mut self) -> (Log, String) {
        self.process.wait().unwrap();
        let summary = json_file(&self.folder.path().join("out/summary.json"));
        (Log::open(&self.log()).unwrap(), summary["outcome"].as_str().unwrap().to_owned())
    }

    /// The addresses at which its processes listen for connections, as the kernel tells them.
    fn listening(&self) -> Vec<String> {
        let folder = self.folder.path().join("out").canonicalize().unwrap();
        let mut sockets = Vec::new();
        for process in std::fs::read_dir("/proc").unwrap().flatten() {
            let line = std::fs::read(process.path().join("cmdline")).unwrap_or_default();
            let is_ours = process.file_name() == *self.process.id().to_string()
                || text(&line).split('\0').any(|word| std::path::Path::new(word) == folder);
            let files = std::fs::read_dir(process.path().join("fd")).into_iter().flatten().flatten();
            let links = files.filter(|_| is_ours).filter_map(|file| std::fs::read_link(file.path()).ok());
            sockets
                .extend(links.filter_map(|link| {
                    Some(link.to_str()?.strip_prefix("socket:[")?.trim_end_matches(']').to_owned())
                }));
        }
        assert!(sockets.len() > 2, "the stack has sockets of its devices at least: {sockets:?}");
        let tables = ["/proc/net/tcp", "/proc/net/tcp6"].map(|path| std::fs::read_to_string(path).unwrap_or_default());
        let rows = tables.iter().flat_map(|table| table.lines()).map(|row| row.split_whitespace().collect::<Vec<_>>());
        let ours = rows.filter(|row| row.len() > 9 && row[3] == "0A" && sockets.iter().any(|socket| socket == row[9]));
        ours.map(|row| row[1].to_owned()).collect()
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn free_address() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

/// Asks for values.
fn set(values: &[(&str, f64)]) -> Value {
    let parameters: Vec<_> = values.iter().map(|(name, value)| json!({ "name": name, "value": value })).collect();
    json!({ "op": "setParameters", "parameters": parameters, "id": "set" })
}

/// Each topic and field that the shipped layouts name is announced, and the field is in the topic's definition.
fn layouts_name_what_there_is(channels: &BTreeMap<String, Value>) {
    let has_field = |topic: &str, field: &str, index: Option<usize>| {
        let definition = channels[topic]["schema"].as_str().unwrap();
        definition.lines().any(|line| {
            let mut words = line.split_whitespace();
            let (kind, name) = (words.next().unwrap_or(""), words.next());
            let count = kind.split_once('[').map(|(_, count)| count.trim_end_matches(']').parse::<usize>().unwrap());
            name == Some(field) && index.is_none_or(|i| count.is_some_and(|count| i < count))
        })
    };
    let layout: Value = serde_json::from_str(include_str!("../deploy/etc/layouts/foxglove.json")).unwrap();
    let mut named = 0;
    for panel in layout["configById"].as_object().unwrap().values() {
        for path in panel["paths"].as_array().into_iter().flatten() {
            let path = path["value"].as_str().unwrap();
            let (topic, field) = path.split_once('.').unwrap();
            let (field, index) = match field.split_once('[') {
                Some((field, index)) => (field, index.trim_end_matches(']').parse().ok()),
                None => (field, None),
            };
            assert!(has_field(topic.split('{').next().unwrap(), field, index), "{path}");
            named += 1;
        }
        let topics = panel["topics"].as_object().into_iter().flatten().map(|(topic, _)| topic.as_str());
        let layers = panel["layers"].as_object().into_iter().flatten().filter_map(|(_, layer)| layer["topic"].as_str());
        for topic in topics.chain(layers).chain(panel["topicPath"].as_str()) {
            assert!(channels.contains_key(topic), "{topic}");
            named += 1;
        }
    }
    for curve in include_str!("../deploy/etc/layouts/plotjuggler.xml").split("<curve name=\"").skip(1) {
        let (topic, field) = curve.split('"').next().unwrap().rsplit_once('/').unwrap();
        assert!(has_field(topic, field, None), "{topic} {field}");
        named += 1;
    }
    assert!(named > 40, "{named}");
}

/// In a browser of this computer.
fn a_page_from_elsewhere_is_refused(address: SocketAddr) {
    let page = "GET / HTTP/1.1\r\nUpgrade: websocket\r\nOrigin: https://evil.example\r\n\r\n";
    let mut browser = TcpStream::connect(address).unwrap();
    browser.write_all(page.as_bytes()).unwrap();
    let mut answer = [0; 12];
    browser.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 403");
}

fn a_dashboard_reads_metrics(address: SocketAddr) {
    let mut dashboard = TcpStream::connect(address).unwrap();
    dashboard.write_all(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    let mut answer = String::new();
    dashboard.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 200 OK\r\nContent-Type: text/plain"), "{answer}");
    assert!(answer.contains("fss_cycles_total{service=\"fusion\"} "), "{answer}");
}

fn are_logged_without_a_gap(seen: &[Vec<u8>], definition: &str, logged: &[NavState]) {
    let mut sequences = Vec::new();
    for message in seen {
        let fields = decode(definition, message);
        let sequence = fields["sequence"][0];
        let at = logged.partition_point(|sample| (sample.sequence as f64) < sequence);
        let sample = logged.get(at).expect("the log has it too");
        assert_eq!(&message[4..], sample.as_bytes(), "sample {sequence}");
        assert_eq!((fields["x_m"][0], fields["std"][6]), (sample.x_m, sample.std[6]));
        sequences.push(sequence);
    }
    assert!(sequences.is_sorted_by(|a, b| a + 1.0 == *b), "a viewer that keeps up misses none");
}

fn ground_alone_lost_samples(log: &Log) {
    let mut lost = 0;
    for health in log.samples::<Health>("/health").unwrap() {
        if text_of(&health.service) == "ground" {
            lost = health.dropped;
        } else {
            assert_eq!(health.dropped, 0, "{}", text_of(&health.service));
        }
    }
    assert!(lost > 0, "what the slow viewer did not fetch is counted");
}

#[test]
fn a_viewer_sees_the_flight_as_the_log_will_have_it_and_a_slow_one_disturbs_nobody() {
    let address = free_address();
    let mut flight = Flight::start(52310, &format!("[ground]\nlisten = \"{address}\""));
    let mut viewer = Viewer::connect(address);
    for (subscription, name) in [(1, "/nav/state"), (2, "/tf"), (3, "/robot_description"), (4, "/scene")] {
        viewer.subscribe(subscription, name);
    }
    viewer.until("every topic", |viewer| topic::NAMES.iter().all(|name| viewer.channels.contains_key(*name)));
    // One that wants everything and reads nothing.
    let mut slow = Viewer::connect(address);
    for (subscription, name) in (1..).zip(topic::NAMES) {
        slow.subscribe(subscription, name);
    }
    let slow_at = slow.socket.get_ref().local_addr().unwrap();
    viewer.until("20 s of navigation", |viewer| viewer.of(1).count() > 4000);
    viewer.until("frames", |viewer| [2, 3, 4].iter().all(|id| viewer.of(*id).next().is_some()));
    assert_eq!(
        flight.listening(),
        [format!("0100007F:{:04X}", address.port())],
        "the launch file's address and no other"
    );
    a_page_from_elsewhere_is_refused(address);
    a_dashboard_reads_metrics(address);

    // It only watches: nothing can be set, and no command is offered.
    viewer.say(&set(&[("base_bandwidth_rad_s", 0.6)]));
    viewer.until("the refusal", |viewer| viewer.told("this view only watches"));
    assert!(!viewer.texts.iter().any(|words| words["op"] == "advertiseServices"));

    let channel = &viewer.channels["/nav/state"];
    assert_eq!(
        [&channel["encoding"], &channel["schemaEncoding"], &channel["schemaName"]],
        ["cdr", "ros2msg", "fss_msgs/msg/NavState"]
    );
    let definition = channel["schema"].as_str().unwrap().to_owned();
    let seen: Vec<Vec<u8>> = viewer.of(1).map(<[u8]>::to_vec).collect();
    // Each message has what is new: the base, the arm, or both.
    let frames = text(&viewer.of(2).collect::<Vec<_>>().concat());
    assert!(["map", "base", "link_4", "end_effector"].iter().all(|name| frames.contains(name)));
    assert!(text(viewer.of(3).next().unwrap()).contains("<robot name=\"fss\">"));
    let scene = text(&viewer.of(4).collect::<Vec<_>>().concat());
    assert!(["table", "base", "plumes", "goal"].iter().all(|id| scene.contains(id)), "what stands on the table");
    layouts_name_what_there_is(&viewer.channels);
    drop(viewer);

    let (log, outcome) = flight.land();
    assert_eq!(outcome, "done");
    let logged = log.samples::<NavState>("/nav/state").unwrap();
    are_logged_without_a_gap(&seen, &definition, &logged);
    ground_alone_lost_samples(&log);
    let events = log.samples::<Event>("/events").unwrap();
    let said = |words: &str| events.iter().any(|event| text_of(&event.text).contains(words));
    assert!(!said("samples lost"), "the recorder lost nothing");
    assert!(said(&format!("the viewer at {slow_at} reads too slowly")), "the slow viewer is told of");
    assert!(said("a page of https://evil.example is refused"), "and the foreign page");
}

#[test]
fn a_viewer_tunes_within_bounds_and_aborts_and_the_log_replays_bit_for_bit() {
    let address = free_address();
    let mut flight = Flight::start(52330, &format!("[ground]\nlisten = \"{address}\"\ncommands = true"));
    let mut viewer = Viewer::connect(address);
    viewer.subscribe(1, "/mission/state");
    viewer.until("the flight", |viewer| viewer.of(1).count() > 60);
    viewer.say(&json!({ "op": "subscribeParameterUpdates", "parameterNames": ["base_bandwidth_rad_s"] }));
    viewer.say(&json!({ "op": "getParameters", "parameterNames": [], "id": "all" }));
    viewer.until("all parameters", |viewer| viewer.answer("all").is_some());
    for parameter in PARAMETERS {
        assert_eq!(viewer.answer("all").unwrap()[parameter.name], parameter.default, "{}", parameter.name);
    }

    viewer.say(&set(&[("base_bandwidth_rad_s", 0.6), ("arm_max_rate_rad_s", 0.1)]));
    viewer.until("what the base says", |viewer| {
        let told = viewer.texts.iter().filter(|words| words["op"] == "parameterValues" && words["id"].is_null());
        told.flat_map(|words| words["parameters"].as_array().unwrap()).any(|parameter| parameter["value"] == 0.6)
    });
    viewer.say(&set(&[("base_bandwidth_rad_s", 60.0), ("base_damping_ratio", -1.0), ("no_such_thing", 1.0)]));
    for words in
        ["base_bandwidth_rad_s = 60 refused", "base_damping_ratio = -1 refused", "no parameter 'no_such_thing'"]
    {
        viewer.until(words, |viewer| viewer.told(words));
    }
    viewer.say(&json!({ "op": "getParameters", "parameterNames": ["base_bandwidth_rad_s"], "id": "still" }));
    viewer.until("the answer", |viewer| viewer.answer("still").is_some());
    assert_eq!(viewer.answer("still").unwrap()["base_bandwidth_rad_s"], 0.6);

    viewer.call("/mission/abort");
    let (log, outcome) = flight.land();
    assert_eq!(outcome, "aborted");
    let said: Vec<_> = log.samples::<Event>("/events").unwrap().iter().map(|e| text_of(&e.text).to_owned()).collect();
    for words in [
        &format!("listens at {address} and takes commands"),
        "base_bandwidth_rad_s = 0.6 (was 0.45)",
        "arm_max_rate_rad_s = 0.1 (was 0.3)",
        "base_bandwidth_rad_s = 60 refused: it lies between 0.1 and 1.2",
        "a viewer commands: abort",
        "mission aborted: the ground commands it",
    ] {
        assert!(said.iter().any(|event| event == words), "'{words}' is not among {said:#?}");
    }
    let states = log.samples::<Parameters>("/parameters/state").unwrap();
    let base: Vec<_> = states.iter().filter(|state| text_of(&state.service) == "base").collect();
    assert_eq!((base[0].base_bandwidth_rad_s, base[base.len() - 1].base_bandwidth_rad_s), (0.45, 0.6));
    let replay = common::fss(&["replay", "--json", flight.log().to_str().unwrap()]);
    let answer: Value = serde_json::from_slice(&replay.stdout).unwrap();
    assert_eq!(answer["identical"], true, "{answer:#}");
}

#[test]
fn nothing_listens_unless_the_launch_file_says_where_and_nobody_commands_from_elsewhere() {
    let flight = Flight::start(52350, "");
    std::thread::sleep(Duration::from_secs(4));
    assert_eq!(flight.listening(), Vec::<String>::new());
    drop(flight);

    let folder = tempfile::tempdir().unwrap();
    let launch = folder.path().join("launch.toml");
    let lab = include_str!("../deploy/etc/launch/lab.toml").replace("51001", "52370").replace("5110", "5238");
    let run =
        ["run", "hold", "--quiet", "--launch", launch.to_str().unwrap(), "--out", folder.path().to_str().unwrap()];
    std::fs::write(&launch, format!("{lab}\n[ground]\nlisten = \"0.0.0.0:0\"\ncommands = true\n")).unwrap();
    refused(&run, &["commands are taken from this computer alone", "[ground] listen"]);
    std::fs::write(&launch, format!("{lab}\n[ground]\nlisten = \"127.0.0.1:0\"\norigins = [\"*\"]\n")).unwrap();
    refused(&run, &["'*' is no origin", "https://app.foxglove.dev"]);
    let without = lab.split("[[service]]\nname = \"ground\"").next().unwrap();
    std::fs::write(&launch, format!("{without}\n[ground]\nlisten = \"127.0.0.1:0\"\n")).unwrap();
    refused(&run, &["[ground] says where to listen, but there is no such service", "name = \"ground\""]);
}

#[test]
fn the_document_lists_every_parameter_with_its_bounds() {
    let document = include_str!("../docs/ground.md");
    for p in PARAMETERS {
        let row = format!("| `{}` | {} | {} to {} | {} |", p.name, p.default, p.least, p.most, p.doc);
        assert!(document.contains(&row), "docs/ground.md lacks this row:\n{row}");
    }
}
