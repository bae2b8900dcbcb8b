//! What `rmw_zenoh` calls topics, and what it says of nodes and publishers.
//!
//! A topic's samples travel under `DOMAIN/TOPIC/TYPE/HASH`, each with an [`Attachment`]. A liveliness token tells of each node,
//! publisher and subscription while it is there; `ros2 topic list` reads them.

use sha2::{Digest, Sha256};

/// Bytes of an [`Attachment`].
pub const ATTACHMENT_LEN: usize = 33;

/// A node in the graph of ROS 2.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Node {
    /// `ROS_DOMAIN_ID`.
    pub domain: u32,
    /// The id of its zenoh session.
    pub session: String,
    /// Its name.
    pub name: String,
}

/// A publisher or a subscription of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Endpoint {
    /// The topic, with its slash in front.
    pub topic: String,
    /// The message's type, `package/msg/Name`.
    pub schema: String,
    /// Its RIHS01.
    pub hash: String,
    /// Distinguishes it from other entities of the session.
    pub id: u32,
}

impl Node {
    /// Its liveliness token.
    pub fn token(&self) -> String {
        let Self { domain, session, name } = self;
        format!("@ros2_lv/{domain}/{session}/0/0/NN/%/%/{name}")
    }

    /// The key under which the samples of a topic travel.
    pub fn key(&self, endpoint: &Endpoint) -> String {
        let topic = endpoint.topic.trim_start_matches('/');
        format!("{}/{topic}/{}/{}", self.domain, dds_type(&endpoint.schema), endpoint.hash)
    }

    /// A publisher's liveliness token.
    pub fn publisher_token(&self, publisher: &Endpoint) -> String {
        self.endpoint_token("MP", publisher)
    }

    /// A subscription's liveliness token.
    pub fn subscription_token(&self, subscription: &Endpoint) -> String {
        self.endpoint_token("MS", subscription)
    }

    /// Reliable, volatile, the last ten samples.
    fn endpoint_token(&self, kind: &str, endpoint: &Endpoint) -> String {
        let Self { domain, session, name } = self;
        let Endpoint { topic, schema, hash, id } = endpoint;
        let (topic, schema) = (topic.replace('/', "%"), dds_type(schema));
        format!("@ros2_lv/{domain}/{session}/0/{id}/{kind}/%/%/{name}/{topic}/{schema}/{hash}/::,10:,:,:,,")
    }
}

/// `fss_msgs/msg/NavState` as DDS writes it.
pub fn dds_type(schema: &str) -> String {
    let (package, name) = schema.split_once("/msg/").unwrap_or(("", schema));
    format!("{package}::msg::dds_::{name}_")
}

/// What tells publishers apart.
pub fn source_id(publisher_token: &str) -> [u8; 16] {
    let digest = Sha256::digest(publisher_token.as_bytes());
    std::array::from_fn(|i| digest[i])
}

/// What goes beside each sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attachment {
    /// Counts the publisher's samples.
    pub number: i64,
    /// When it was published, ns since 1970.
    pub time_ns: i64,
    /// Who published it ([`source_id`]).
    pub source: [u8; 16],
}

impl Attachment {
    /// As it travels.
    pub fn encode(&self) -> [u8; ATTACHMENT_LEN] {
        let mut bytes = [0; ATTACHMENT_LEN];
        bytes[..8].copy_from_slice(&self.number.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.time_ns.to_le_bytes());
        bytes[16] = 16;
        bytes[17..].copy_from_slice(&self.source);
        bytes
    }

    /// As it came; none where it is no attachment, or counts below zero.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; ATTACHMENT_LEN] = bytes.try_into().ok()?;
        let (number, rest) = bytes.split_first_chunk()?;
        let (time_ns, rest) = rest.split_first_chunk()?;
        let source = rest.strip_prefix(&[16])?.try_into().ok()?;
        let (number, time_ns) = (i64::from_le_bytes(*number), i64::from_le_bytes(*time_ns));
        (number >= 0 && time_ns >= 0).then_some(Self { number, time_ns, source })
    }
}
