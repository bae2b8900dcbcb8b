//! A viewer that speaks the Foxglove WebSocket protocol by itself, and reads messages by their definitions.

use super::PATIENCE;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

/// A viewer.
pub(crate) struct Viewer {
    pub(crate) socket: WebSocket<TcpStream>,
    /// What the server has announced, by topic.
    pub(crate) channels: BTreeMap<String, Value>,
    /// Texts that wait to be looked at.
    pub(crate) texts: Vec<Value>,
    /// Samples that came: subscription, time, bytes.
    pub(crate) samples: Vec<(u32, u64, Vec<u8>)>,
}

impl Viewer {
    pub(crate) fn connect(address: SocketAddr) -> Self {
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
    pub(crate) fn receive(&mut self) {
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

    pub(crate) fn until(&mut self, what: &str, mut holds: impl FnMut(&Self) -> bool) {
        let begun = Instant::now();
        while !holds(self) {
            assert!(begun.elapsed() < PATIENCE, "waited in vain: {what}; it was told {:?}", self.texts);
            self.receive();
        }
    }

    pub(crate) fn say(&mut self, value: &Value) {
        self.socket.send(Message::text(value.to_string())).unwrap();
    }

    pub(crate) fn subscribe(&mut self, subscription: u32, topic: &str) {
        self.until(topic, |viewer| viewer.channels.contains_key(topic));
        let channel = self.channels[topic]["id"].clone();
        self.say(&json!({ "op": "subscribe", "subscriptions": [{ "id": subscription, "channelId": channel }] }));
    }

    /// Whether a status says this.
    pub(crate) fn told(&self, words: &str) -> bool {
        let statuses = self.texts.iter().filter(|text| text["op"] == "status");
        statuses.filter_map(|status| status["message"].as_str()).any(|message| message.contains(words))
    }

    /// The values that answer a request.
    pub(crate) fn answer(&self, id: &str) -> Option<BTreeMap<String, f64>> {
        let answer = self.texts.iter().find(|words| words["op"] == "parameterValues" && words["id"] == id)?;
        let value = |p: &Value| (p["name"].as_str().unwrap().to_owned(), p["value"].as_f64().unwrap());
        Some(answer["parameters"].as_array().unwrap().iter().map(value).collect())
    }

    /// Calls a service that was announced, with an empty object.
    pub(crate) fn call(&mut self, name: &str) {
        let announced = |viewer: &Self| {
            let services = viewer.texts.iter().flat_map(|words| words["services"].as_array().into_iter().flatten());
            services.filter(|service| service["name"] == name).find_map(|service| service["id"].as_u64())
        };
        self.until(name, |viewer| announced(viewer).is_some());
        let id = announced(self).unwrap() as u32;
        // Opcode 2: service, call, encoding with its length, body.
        let words = [id.to_le_bytes(), 1_u32.to_le_bytes(), 4_u32.to_le_bytes()].concat();
        self.socket.send(Message::binary([&[2][..], &words, b"json{}"].concat())).unwrap();
    }

    pub(crate) fn of(&self, subscription: u32) -> impl Iterator<Item = &[u8]> {
        self.samples.iter().filter(move |(id, ..)| *id == subscription).map(|(.., bytes)| &bytes[..])
    }
}

/// Reads a message by its ROS 2 definition, as any tool does: fields by name, numbers as they print.
pub(crate) fn decode(definition: &str, message: &[u8]) -> BTreeMap<String, Vec<f64>> {
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
