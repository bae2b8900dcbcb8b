//! The live view as a laboratory's tools meet it: over a WebSocket, with nothing of ours in the client.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{refused, text};
use fss_messages::{NavState, Sample, topic};
use fss_records::log::Log;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

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

    /// Waits until it has flown; gives its log.
    fn land(&mut self) -> Log {
        let status = self.process.wait().unwrap();
        assert!(status.success(), "the flight ended with {status}");
        Log::open(&self.log()).unwrap()
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

/// A viewer.
struct Viewer {
    socket: WebSocket<TcpStream>,
    /// What the server has announced, by topic.
    channels: BTreeMap<String, Value>,
    /// Texts that wait to be looked at.
    texts: Vec<Value>,
    /// Samples that came: subscription, time, bytes.
    samples: Vec<(u32, u64, Vec<u8>)>,
}

impl Viewer {
    fn connect(address: SocketAddr) -> Self {
        let begun = Instant::now();
        let stream = loop {
            match TcpStream::connect(address) {
                Ok(stream) => break stream,
                Err(e) => assert!(begun.elapsed() < PATIENCE, "nobody listens at {address}: {e}"),
            }
            std::thread::sleep(Duration::from_millis(50));
        };
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut request = format!("ws://{address}/").into_client_request().unwrap();
        request.headers_mut().insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
        let (socket, response) = tungstenite::client(request, stream).unwrap();
        assert_eq!(response.headers()["sec-websocket-protocol"], "foxglove.sdk.v1");
        Self { socket, channels: BTreeMap::new(), texts: Vec::new(), samples: Vec::new() }
    }

    /// Takes one message.
    fn receive(&mut self) {
        match self.socket.read().unwrap() {
            Message::Text(words) => {
                let value: Value = serde_json::from_str(&words).unwrap();
                for channel in value["channels"].as_array().into_iter().flatten() {
                    self.channels.insert(channel["topic"].as_str().unwrap().to_owned(), channel.clone());
                }
                self.texts.push(value);
            }
            // Opcode 1: subscription, time, body.
            Message::Binary(bytes) if bytes[0] == 1 => {
                let word = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
                self.samples.push((word, u64::from_le_bytes(bytes[5..13].try_into().unwrap()), bytes[13..].to_vec()));
            }
            _ => {}
        }
    }

    fn until(&mut self, what: &str, mut holds: impl FnMut(&Self) -> bool) {
        let begun = Instant::now();
        while !holds(self) {
            assert!(begun.elapsed() < PATIENCE, "waited in vain: {what}; it was told {:?}", self.texts);
            self.receive();
        }
    }

    fn say(&mut self, value: &Value) {
        self.socket.send(Message::text(value.to_string())).unwrap();
    }

    fn subscribe(&mut self, subscription: u32, topic: &str) {
        self.until(topic, |viewer| viewer.channels.contains_key(topic));
        let channel = self.channels[topic]["id"].clone();
        self.say(&json!({ "op": "subscribe", "subscriptions": [{ "id": subscription, "channelId": channel }] }));
    }

    fn of(&self, subscription: u32) -> impl Iterator<Item = &[u8]> {
        self.samples.iter().filter(move |(id, ..)| *id == subscription).map(|(.., bytes)| &bytes[..])
    }
}

/// Reads a message by its ROS 2 definition, as any tool does: fields by name, numbers as they print.
fn decode(definition: &str, message: &[u8]) -> BTreeMap<String, Vec<f64>> {
    assert_eq!(&message[..4], [0, 1, 0, 0], "XCDR1, little endian");
    let (body, mut at) = (&message[4..], 0);
    let mut fields = BTreeMap::new();
    let lines =
        definition.lines().filter(|line| !line.starts_with('#') && !line.split('#').next().unwrap().contains('='));
    for line in lines {
        let mut words = line.split_whitespace();
        let (kind, name) = (words.next().unwrap(), words.next().unwrap());
        let (kind, count) = match kind.split_once('[') {
            Some((kind, count)) => (kind, count.trim_end_matches(']').parse().unwrap()),
            None => (kind, 1),
        };
        let size = match kind {
            "uint8" => 1,
            "uint32" => 4,
            "uint64" | "float64" => 8,
            other => panic!("{other}"),
        };
        at = usize::next_multiple_of(at, size);
        let values = body[at..at + size * count].chunks(size).map(|chunk| {
            let mut word = [0; 8];
            word[..size].copy_from_slice(chunk);
            if kind == "float64" { f64::from_le_bytes(word) } else { u64::from_le_bytes(word) as f64 }
        });
        fields.insert(name.to_owned(), values.collect());
        at += size * count;
    }
    assert_eq!(at, body.len(), "the definition tells of every byte");
    fields
}

#[test]
fn a_viewer_sees_the_flight_as_the_log_will_have_it() {
    let address = free_address();
    let mut flight = Flight::start(52310, &format!("[ground]\nlisten = \"{address}\""));
    let mut viewer = Viewer::connect(address);
    for (subscription, name) in [(1, "/nav/state"), (2, "/tf"), (3, "/robot_description"), (4, "/scene")] {
        viewer.subscribe(subscription, name);
    }
    viewer.until("every topic", |viewer| topic::NAMES.iter().all(|name| viewer.channels.contains_key(*name)));
    viewer.until("a second of navigation", |viewer| viewer.of(1).count() > 200);
    viewer.until("frames", |viewer| [2, 3, 4].iter().all(|id| viewer.of(*id).next().is_some()));

    let channel = &viewer.channels["/nav/state"];
    assert_eq!(
        [&channel["encoding"], &channel["schemaEncoding"], &channel["schemaName"]],
        ["cdr", "ros2msg", "fss_msgs/msg/NavState"]
    );
    let definition = channel["schema"].as_str().unwrap().to_owned();
    let seen: Vec<Vec<u8>> = viewer.of(1).map(<[u8]>::to_vec).collect();
    let frames = text(viewer.of(2).last().unwrap());
    assert!(["map", "base", "link_4", "end_effector"].iter().all(|name| frames.contains(name)), "{frames}");
    assert!(text(viewer.of(3).next().unwrap()).contains("<robot name=\"fss\">"));
    drop(viewer);

    let log = flight.land();
    let logged = log.samples::<NavState>("/nav/state").unwrap();
    let mut times = Vec::new();
    for message in &seen {
        let fields = decode(&definition, message);
        let sequence = fields["sequence"][0];
        let sample = logged.iter().find(|sample| sample.sequence as f64 == sequence).expect("the log has it too");
        assert_eq!(&message[4..], sample.as_bytes(), "sample {sequence}");
        assert_eq!((fields["x_m"][0], fields["std"][6]), (sample.x_m, sample.std[6]));
        times.push(sequence);
    }
    assert!(times.is_sorted_by(|a, b| a + 1.0 == *b), "a viewer that keeps up misses none: {times:?}");
}
