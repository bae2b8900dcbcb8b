//! The launch file's `[ros2]`: what ROS 2 computers may see of this stack.

use super::{BRIDGE, Launch, LaunchError};
use fss_messages::topic;
use serde::Deserialize;
use std::net::SocketAddr;
use toml::Spanned;

/// The nodes of ROS 2 and which topics of this stack they see. Nothing comes in from them.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ros2 {
    /// TCP addresses at which nodes find this stack as they find a zenoh router; absent without `connect`: the loopback.
    #[serde(default)]
    listen: Option<Vec<SocketAddr>>,
    /// TCP addresses of zenoh routers of ROS 2, which are called until they answer.
    #[serde(default)]
    pub connect: Vec<SocketAddr>,
    /// `ROS_DOMAIN_ID` of the nodes.
    #[serde(default)]
    pub domain: u32,
    /// The topics that nodes see, without the vehicle's name: `/nav/state`.
    #[serde(default)]
    pub share: Vec<Spanned<String>>,
    /// Whether nodes see `/tf`, `/joint_states`, `/odom` and `/diagnostics` too.
    #[serde(default = "super::yes")]
    pub standard: bool,
}

impl Ros2 {
    /// Where it listens.
    pub fn listen(&self) -> Vec<SocketAddr> {
        match &self.listen {
            Some(listen) => listen.clone(),
            None if self.connect.is_empty() => vec![SocketAddr::from(([127, 0, 0, 1], 7447))],
            None => Vec::new(),
        }
    }

    /// The topics whose samples are needed, those that are shared first.
    pub fn topics(&self) -> Vec<String> {
        let mut topics: Vec<String> = self.share.iter().map(|topic| topic.get_ref().clone()).collect();
        let standard = [topic::NAV_STATE.name, topic::LINKS_STATE.name, topic::MISSION_STATE.name, topic::HEALTH.name];
        for name in standard.into_iter().filter(|_| self.standard) {
            if !topics.iter().any(|topic| topic == name) {
                topics.push(name.to_owned());
            }
        }
        topics
    }
}

impl Launch {
    /// Whether `[ros2]` makes sense.
    pub(super) fn check_ros2(&self) -> Result<(), LaunchError> {
        if self.ros2.is_some() && self.schedule(BRIDGE).is_none() {
            return Err(LaunchError {
                message: "[ros2] is there, but the service is not launched".to_owned(),
                help: "add a [[service]] with name = \"bridge\" and its rate_hz".to_owned(),
                span: None,
            });
        }
        // Whether there are such topics is known when the programs of the stack have been asked.
        Ok(())
    }
}
