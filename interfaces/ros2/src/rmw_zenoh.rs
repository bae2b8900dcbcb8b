//! What `rmw_zenoh` calls topics, and what it says of nodes and publishers.
//!
//! A topic's samples travel under `DOMAIN/TOPIC/TYPE/HASH`, each with an [`attachment`]. A liveliness token tells of each node
//! and each publisher while it is there; `ros2 topic list` reads them.

use sha2::{Digest, Sha256};

/// Bytes of an [`attachment`].
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

/// A publisher of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Publisher {
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

    /// The key under which the publisher's samples travel.
    pub fn key(&self, publisher: &Publisher) -> String {
        let topic = publisher.topic.trim_start_matches('/');
        format!("{}/{topic}/{}/{}", self.domain, dds_type(&publisher.schema), publisher.hash)
    }

    /// The publisher's liveliness token: reliable, volatile, the last ten samples.
    pub fn publisher_token(&self, publisher: &Publisher) -> String {
        let Self { domain, session, name } = self;
        let Publisher { topic, schema, hash, id } = publisher;
        let (topic, kind) = (topic.replace('/', "%"), dds_type(schema));
        format!("@ros2_lv/{domain}/{session}/0/{id}/MP/%/%/{name}/{topic}/{kind}/{hash}/::,10:,:,:,,")
    }
}

/// `fss_msgs/msg/NavState` as DDS writes it.
fn dds_type(schema: &str) -> String {
    let (package, name) = schema.split_once("/msg/").unwrap_or(("", schema));
    format!("{package}::msg::dds_::{name}_")
}

/// What tells publishers apart.
pub fn source_id(publisher_token: &str) -> [u8; 16] {
    let digest = Sha256::digest(publisher_token.as_bytes());
    std::array::from_fn(|i| digest[i])
}

/// What goes beside each sample: its number, the time of publication since 1970, and who published it.
pub fn attachment(number: i64, time_ns: i64, source: &[u8; 16]) -> [u8; ATTACHMENT_LEN] {
    let mut bytes = [0; ATTACHMENT_LEN];
    bytes[..8].copy_from_slice(&number.to_le_bytes());
    bytes[8..16].copy_from_slice(&time_ns.to_le_bytes());
    bytes[16] = 16;
    bytes[17..].copy_from_slice(source);
    bytes
}
