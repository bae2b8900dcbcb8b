//! The launch file's `[bridge]`: what this vehicle has to do with others over the network.

use super::ros2::NODES;
use super::{Launch, LaunchError, Ros2};
use crate::Neighbours;
use fss_messages::topic;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use std::net::SocketAddr;
use std::ops::Range;
use std::time::Duration;
use toml::Spanned;

/// The service that carries samples from host to host.
const SERVICE: &str = "bridge";
/// What a vehicle's name has room for in a sample.
const LONGEST_NAME: usize = 15;

/// What the bridge listens on, whom it calls, and what passes.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bridge {
    /// TCP addresses at which other vehicles' bridges may call; nothing else listens.
    #[serde(default)]
    pub listen: Vec<SocketAddr>,
    /// TCP addresses of other vehicles' bridges, which are called until they answer.
    #[serde(default)]
    pub connect: Vec<SocketAddr>,
    /// The topics of this stack that others may hear, without the vehicle's name: `/nav/state`.
    #[serde(default)]
    pub share: Vec<Spanned<String>>,
    /// The topics of other vehicles that are wanted here, with their names: `/target/nav/state`.
    #[serde(default)]
    pub receive: Vec<Spanned<ForeignTopic>>,
    /// Samples that are older when they come are refused, ms.
    #[serde(default = "super::default_max_age_ms")]
    pub max_age_ms: u64,
    /// A vehicle of which nothing was taken for so long is silent, ms.
    #[serde(default = "default_silent_ms")]
    pub silent_ms: u64,
}

const fn default_silent_ms() -> u64 {
    1000
}

impl Bridge {
    /// Samples that are older when they come are refused.
    pub fn max_age(&self) -> Duration {
        Duration::from_millis(self.max_age_ms)
    }

    /// A vehicle of which nothing was taken for so long is silent.
    pub fn silent_after(&self) -> Duration {
        Duration::from_millis(self.silent_ms)
    }
}

/// A topic of another vehicle; as text `/VEHICLE/TOPIC`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ForeignTopic {
    /// The vehicle.
    pub vehicle: String,
    /// The topic's name without the vehicle's.
    pub topic: &'static str,
}

impl<'de> Deserialize<'de> for ForeignTopic {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        String::deserialize(from)?.try_into().map_err(D::Error::custom)
    }
}

impl TryFrom<String> for ForeignTopic {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let split = text.strip_prefix('/').and_then(|name| name.split_once('/'));
        let (vehicle, _) = split.ok_or_else(|| format!("'{text}' is no /VEHICLE/TOPIC, such as /target/nav/state"))?;
        let topic = own_topic(&text[1 + vehicle.len()..])
            .ok_or_else(|| format!("'{text}': there is no topic {}", &text[1 + vehicle.len()..]))?;
        if is_name(vehicle) {
            Ok(Self { vehicle: vehicle.to_owned(), topic })
        } else {
            Err(format!("'{vehicle}' is no vehicle's name: {NAME_RULE}"))
        }
    }
}

const NAME_RULE: &str = "letters, digits and underscores, a letter first, at most 15";

fn is_name(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.len() <= LONGEST_NAME
        && text.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
}

fn own_topic(name: &str) -> Option<&'static str> {
    topic::NAMES.iter().find(|known| **known == name).copied()
}

impl Launch {
    /// What the stack has to do with other vehicles.
    pub fn neighbours(&self) -> Neighbours {
        let received = || self.bridge.iter().flat_map(|bridge| &bridge.receive).map(Spanned::get_ref);
        let shared = self.bridge.iter().flat_map(|bridge| &bridge.share);
        let mut heard: Vec<ForeignTopic> = received().cloned().collect();
        // With what comes of a vehicle goes what the bridge says of it.
        let nodes = self.ros2.as_ref().map(|_| NODES.to_owned());
        for vehicle in received().map(|topic| topic.vehicle.clone()).chain(nodes) {
            let peer = ForeignTopic { vehicle, topic: topic::PEER.name };
            if !heard.contains(&peer) {
                heard.push(peer);
            }
        }
        Neighbours {
            target: self.target_vehicle.clone(),
            shared: shared.map(|topic| topic.get_ref().clone()).collect(),
            ros2: self.for_ros2(),
            heard,
        }
    }

    fn for_ros2(&self) -> Vec<String> {
        self.ros2.as_ref().map(Ros2::topics).unwrap_or_default()
    }

    /// Whether names and topics of this and of other vehicles make sense.
    pub(super) fn check_neighbours(&self) -> Result<(), LaunchError> {
        let refuse = |message: String, help: &str, span: Option<Range<usize>>| {
            Err(LaunchError { message, help: help.to_owned(), span })
        };
        for name in std::iter::once(&self.vehicle).filter(|name| !name.is_empty()).chain(&self.target_vehicle) {
            if !is_name(name) {
                return refuse(format!("'{name}' is no vehicle's name"), NAME_RULE, None);
            }
        }
        let Some(bridge) = &self.bridge else {
            return match self.schedule(SERVICE) {
                Some(service) if self.ros2.is_none() => refuse(
                    "'bridge' has nothing to carry".to_owned(),
                    "add [bridge] with listen or connect, share and receive, or [ros2]",
                    Some(service.name.span()),
                ),
                _ => Ok(()),
            };
        };
        if self.vehicle.is_empty() {
            let help = "give it a name that no other on the network has: vehicle = \"chaser\"";
            return refuse("a vehicle with a bridge needs a name".to_owned(), help, None);
        }
        if self.schedule(SERVICE).is_none() {
            let help = "add a [[service]] with name = \"bridge\" and its rate_hz";
            return refuse("[bridge] is there, but the service is not launched".to_owned(), help, None);
        }
        for shared in &bridge.share {
            if own_topic(shared.get_ref()).is_none() {
                let message = format!("there is no topic {} to share", shared.get_ref());
                return refuse(
                    message,
                    "topics are written without the vehicle's name: /nav/state",
                    Some(shared.span()),
                );
            }
        }
        for foreign in &bridge.receive {
            if foreign.get_ref().vehicle == self.vehicle || foreign.get_ref().topic == topic::PEER.name {
                let message = "what this stack says itself cannot come from another".to_owned();
                return refuse(message, "receive = [\"/OTHER_VEHICLE/TOPIC\"]", Some(foreign.span()));
            }
        }
        let is_heard = |target: &String| {
            let mut heard = bridge.receive.iter().map(Spanned::get_ref);
            heard.any(|topic| topic.vehicle == *target && topic.topic == topic::NAV_STATE.name)
        };
        match self.target_vehicle.as_ref().filter(|target| !is_heard(target)) {
            Some(target) => refuse(
                format!("the target vehicle '{target}' is not heard"),
                &format!("add \"/{target}/nav/state\" to [bridge] receive"),
                None,
            ),
            None => Ok(()),
        }
    }
}
