//! The launch file's `[ros2]`: what ROS 2 computers may see of this stack, and what they may want of it.

use super::{BRIDGE, Launch, LaunchError};
use fss_messages::topic;
use serde::Deserialize;
use std::net::SocketAddr;
use toml::Spanned;

/// The nodes of ROS 2, which topics of this stack they see, and which of theirs are goals here.
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
    /// The topics of nodes that are goals of base and arm; absent: nothing comes in.
    #[serde(default)]
    pub receive: Vec<Ros2Receive>,
    /// Whether nodes see `/tf`, `/joint_states`, `/odom` and `/diagnostics` too.
    #[serde(default = "super::yes")]
    pub standard: bool,
}

/// A topic of nodes that is a goal here, and its bounds; goals beyond them are refused.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ros2Receive {
    /// The topic, as nodes call it.
    pub topic: Spanned<String>,
    /// Its message.
    #[serde(rename = "type")]
    pub kind: Ros2Type,
    /// What comes faster is refused, messages a second.
    pub max_rate_hz: Spanned<f64>,
    /// What is older when it comes is refused, ms.
    #[serde(default = "super::default_max_age_ms")]
    pub max_age_ms: u64,
    /// Of a pose, m.
    pub x_m: Option<Spanned<[f64; 2]>>,
    /// Of a pose, m.
    pub y_m: Option<Spanned<[f64; 2]>>,
    /// Of a pose, within -180 and 180 degrees; absent: any.
    pub theta_deg: Option<Spanned<[f64; 2]>>,
    /// Of each joint's encoder angle, degrees.
    pub q_deg: Option<Spanned<[f64; 2]>>,
}

/// Messages that are goals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum Ros2Type {
    /// A pose of the base in the table's frame.
    #[serde(rename = "geometry_msgs/msg/PoseStamped")]
    PoseStamped,
    /// A pose of the base on the table.
    #[serde(rename = "geometry_msgs/msg/Pose2D")]
    Pose2d,
    /// Encoder angles of the joints.
    #[serde(rename = "sensor_msgs/msg/JointState")]
    JointState,
}

/// In whose name the bridge says what it hears of nodes: `/ros2/peer`.
pub const NODES: &str = "ros2";
/// The fastest that goals may be allowed to come, Hz.
const FASTEST_HZ: f64 = 1000.0;

impl Ros2Receive {
    /// Whether all that it says makes sense together.
    fn check(&self) -> Result<(), LaunchError> {
        let refuse =
            |message: String, help: &str, span| Err(LaunchError { message, help: help.to_owned(), span: Some(span) });
        let topic = self.topic.get_ref();
        let is_word = |word: &str| !word.is_empty() && word.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
        if !topic.strip_prefix('/').is_some_and(|words| words.split('/').all(is_word)) {
            return refuse(
                format!("'{topic}' is no topic of ROS 2"),
                "it reads /word or /word/word",
                self.topic.span(),
            );
        }
        let rate_hz = *self.max_rate_hz.get_ref();
        if !(rate_hz > 0.0 && rate_hz <= FASTEST_HZ) {
            let help = format!("more than 0 and at most {FASTEST_HZ} Hz");
            return refuse(format!("{topic} cannot come at {rate_hz} Hz"), &help, self.max_rate_hz.span());
        }
        let is_pose = self.kind != Ros2Type::JointState;
        let bounds = [
            ("x_m", &self.x_m, is_pose, true),
            ("y_m", &self.y_m, is_pose, true),
            ("theta_deg", &self.theta_deg, is_pose, false),
            ("q_deg", &self.q_deg, !is_pose, true),
        ];
        for (key, range, is_its, is_needed) in bounds {
            match range {
                None if is_its && is_needed => {
                    let help = format!("add {key} = [LEAST, MOST]: without bounds nothing comes in");
                    return refuse(format!("{topic} has no bounds `{key}`"), &help, self.topic.span());
                }
                Some(range) if !is_its => {
                    let help = "a pose has x_m, y_m and theta_deg, a JointState has q_deg";
                    return refuse(format!("a message of {topic} has no `{key}`"), help, range.span());
                }
                Some(range)
                    if !range.get_ref().iter().all(|v| v.is_finite()) || range.get_ref()[0] > range.get_ref()[1] =>
                {
                    let [low, high] = range.get_ref();
                    return refuse(
                        format!("from {low} to {high} is no range"),
                        "give the lower end first",
                        range.span(),
                    );
                }
                _ => {}
            }
        }
        Ok(())
    }
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
        self.ros2.as_ref().map_or(Ok(()), |ros2| self.check_receive(ros2))?;
        // Whether there are such topics is known when the programs of the stack have been asked.
        Ok(())
    }

    /// Whether goals may come in as `[ros2]` says.
    fn check_receive(&self, ros2: &Ros2) -> Result<(), LaunchError> {
        let refuse = |message: String, help: &str, span| Err(LaunchError { message, help: help.to_owned(), span });
        let Some(first) = ros2.receive.first() else { return Ok(()) };
        let far = |address: &&SocketAddr| !address.ip().is_loopback();
        if let Some(far) = ros2.listen().iter().chain(&ros2.connect).find(far) {
            let message = format!("whoever reaches {far} could command this vehicle: ROS 2 does not authenticate");
            let help = "receive on the loopback only, and let the ROS 2 computer in by ssh -L 7447:127.0.0.1:7447 HOST";
            return refuse(message, help, Some(first.topic.span()));
        }
        let mut others = self.bridge.iter().flat_map(|bridge| &bridge.receive);
        if self.vehicle == NODES || others.any(|topic| topic.get_ref().vehicle == NODES) {
            let message =
                format!("no vehicle can be called '{NODES}': the bridge says what it hears of nodes in that name");
            return refuse(message, "give the vehicle another name", None);
        }
        for (i, receive) in ros2.receive.iter().enumerate() {
            receive.check()?;
            let topic = receive.topic.get_ref();
            if ros2.receive[..i].iter().any(|other| other.topic.get_ref() == topic) {
                let message = format!("{topic} is received twice");
                return refuse(message, "remove one of the two tables", Some(receive.topic.span()));
            }
        }
        Ok(())
    }
}
