//! Where the vehicle is, as standard messages: `/tf`, `/joint_states`, `/nav/pose`, `/robot_description`.

use crate::channels::{Channel, Channels};
use crate::topics::AllTopics;
use crate::viewers::Viewers;
use fss_bus::{Bus, Time};
use fss_messages::{MAX_LINKS, MissionState, NavState, topic};
use fss_plant::Plant;
use fss_plant::urdf::{ARM_HEIGHT_M, ArmFrames, BASE, urdf};
use fss_ros2::cdr::Cdr;
use fss_ros2::robot::{Robot, TABLE, tf_message};
use fss_ros2::standard as ros;

/// Name of the frame of the target body.
pub(crate) const TARGET: &str = "target";
/// How often the description is told again, for those who came late, ns.
const DESCRIPTION_PERIOD_NS: u64 = 1_000_000_000;

/// Says where everything is.
pub(crate) struct Frames {
    transforms: Channel,
    joints: Channel,
    pose: Channel,
    description: Channel,
    urdf: String,
    next_description_ns: u64,
    robot: Robot,
}

impl Frames {
    pub(crate) fn new(channels: &mut Channels, plant: &Plant, bus: &Bus) -> Self {
        let mut channel = |name: &str, definition: &ros::Definition| {
            channels.ros(&bus.full_name(name), definition.name, &definition.text())
        };
        Self {
            transforms: channel("/tf", &ros::TF_MESSAGE),
            joints: channel("/joint_states", &ros::JOINT_STATE),
            pose: channel("/nav/pose", &ros::POSE_STAMPED),
            description: channel("/robot_description", &ros::STRING),
            urdf: urdf(plant),
            next_description_ns: 0,
            robot: robot(plant, vehicle_prefix(bus)),
        }
    }

    /// Sends what is new.
    pub(crate) fn send(&mut self, now: Time, inputs: &AllTopics, viewers: &Viewers) {
        if now.ns() >= self.next_description_ns {
            self.next_description_ns = now.ns() + DESCRIPTION_PERIOD_NS;
            viewers.send(self.description, now.ns(), &Cdr::default().text(&self.urdf).message());
        }
        let mut transforms = Vec::new();
        if let Some(nav) = inputs.samples(topic::NAV_STATE).last() {
            let pose = [nav.x_m, nav.y_m, nav.theta_rad];
            if nav.mode != NavState::INITIALISING {
                let message = Cdr::default().header(nav.stamp_ns, TABLE).pose(pose, 0.0).message();
                viewers.send(self.pose, nav.published_ns, &message);
                transforms.push(self.robot.base(nav.stamp_ns, pose));
            }
        }
        if let Some(links) = inputs.samples(topic::LINKS_STATE).last() {
            viewers.send(self.joints, links.published_ns, &self.robot.joint_states(links.stamp_ns, links));
            transforms.extend(self.robot.arm(links.stamp_ns, &links.q_rad));
        }
        if let Some(mission) = inputs.samples(topic::MISSION_STATE).last().filter(|m| m.target_seen != 0) {
            let mission: &MissionState = mission;
            transforms.push(self.robot.target(mission.stamp_ns, mission.target));
        }
        if !transforms.is_empty() {
            viewers.send(self.transforms, now.ns(), &tf_message(&transforms));
        }
    }
}

/// The vehicle of this plant as its URDF describes it.
fn robot(plant: &Plant, prefix: String) -> Robot {
    let ArmFrames { joints, links, origins } = ArmFrames::of(plant, MAX_LINKS);
    let (base, target) = (BASE.to_owned(), TARGET.to_owned());
    Robot { prefix, base, target, joints, links, origins, arm_height_m: ARM_HEIGHT_M }
}

/// The vehicle's name with a slash behind, for its frames; empty where the vehicle has none.
pub(crate) fn vehicle_prefix(bus: &Bus) -> String {
    let name = bus.full_name("/");
    name.trim_start_matches('/').to_owned()
}
