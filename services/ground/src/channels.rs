//! What viewers may ask for: channels, each with its schema.

use crate::frame::text;
use base64::prelude::{BASE64_STANDARD, Engine};
use serde_json::{Value, json};

/// A channel, by the order of announcement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Channel(pub(crate) u64);

/// All of them.
#[derive(Default)]
pub(crate) struct Channels(Vec<Value>);

impl Channels {
    /// Adds a channel of ROS 2 messages.
    pub(crate) fn ros(&mut self, topic: &str, message: &str, definition: &str) -> Channel {
        self.add(topic, "cdr", message, "ros2msg", definition)
    }

    /// Adds a channel of protobuf messages, known by their file descriptors.
    pub(crate) fn protobuf(&mut self, topic: &str, message: &str, descriptors: &[u8]) -> Channel {
        self.add(topic, "protobuf", message, "protobuf", &BASE64_STANDARD.encode(descriptors))
    }

    fn add(&mut self, topic: &str, encoding: &str, message: &str, schema_encoding: &str, schema: &str) -> Channel {
        let channel = Channel(self.0.len() as u64 + 1);
        self.0.push(json!({
            "id": channel.0, "topic": topic, "encoding": encoding,
            "schemaName": message, "schemaEncoding": schema_encoding, "schema": schema,
        }));
        channel
    }

    /// Whether one has this number.
    pub(crate) fn has(&self, channel: Channel) -> bool {
        (1..=self.0.len() as u64).contains(&channel.0)
    }

    /// What tells a viewer of them.
    pub(crate) fn announcement(&self) -> Vec<u8> {
        text(&json!({ "op": "advertise", "channels": self.0 }))
    }
}
