//! Where the vehicle is, as standard messages: `/tf`, `/joint_states`, `/nav/pose`, `/robot_description`.

use crate::cdr::Cdr;
use crate::channels::{Channel, Channels};
use crate::ros;
use crate::server::Server;
use crate::topics::AllTopics;
use fss_bus::{Bus, Time};
use fss_messages::{LinksState, MAX_LINKS, MissionState, NavState, topic};
use fss_plant::Plant;
use fss_plant::urdf::{ARM_HEIGHT_M, BASE, END_EFFECTOR, joint_name, joint_origin, link_name, urdf};

/// Name of the table's frame: its origin is the middle of the granite.
pub(crate) const TABLE: &str = "map";
/// Name of the frame of the target body.
pub(crate) const TARGET: &str = "target";
/// How often the description is told again, for those who came late, ns.
const DESCRIPTION_PERIOD_NS: u64 = 1_000_000_000;

/// One transform of `/tf`.
struct Transform {
    time_ns: u64,
    parent: String,
    child: String,
    pose: [f64; 3],
    z_m: f64,
}

/// Says where everything is.
pub(crate) struct Frames {
    transforms: Channel,
    joints: Channel,
    pose: Channel,
    description: Channel,
    urdf: String,
    next_description_ns: u64,
    /// Vehicle's name in front of its frames, with a slash; empty for one alone.
    prefix: String,
    /// Joint by joint, where it is with its encoder at zero; then the end-effector.
    origins: Vec<[f64; 3]>,
}

impl Frames {
    pub(crate) fn new(channels: &mut Channels, plant: &Plant, bus: &Bus) -> Self {
        let mut channel = |name: &str, definition: &ros::Definition| {
            channels.ros(&bus.full_name(name), definition.name, &definition.text())
        };
        let count = plant.link_count().min(MAX_LINKS);
        let mut origins: Vec<_> = (0..count).map(|i| joint_origin(plant, i)).collect();
        origins.extend(plant.links[..count].last().map(|link| [link.length_m, 0.0, 0.0]));
        Self {
            transforms: channel("/tf", &ros::TF_MESSAGE),
            joints: channel("/joint_states", &ros::JOINT_STATE),
            pose: channel("/nav/pose", &ros::POSE_STAMPED),
            description: channel("/robot_description", &ros::STRING),
            urdf: urdf(plant),
            next_description_ns: 0,
            prefix: vehicle_prefix(bus),
            origins,
        }
    }

    /// The vehicle's own frame of this name.
    fn own(&self, name: &str) -> String {
        format!("{}{name}", self.prefix)
    }

    /// Sends what is new.
    pub(crate) fn send(&mut self, now: Time, inputs: &AllTopics, server: &Server) {
        if now.ns() >= self.next_description_ns {
            self.next_description_ns = now.ns() + DESCRIPTION_PERIOD_NS;
            server.send(self.description, now.ns(), &Cdr::default().text(&self.urdf).message());
        }
        let mut transforms = Vec::new();
        if let Some(nav) = inputs.samples(topic::NAV_STATE).last() {
            let pose = [nav.x_m, nav.y_m, nav.theta_rad];
            if nav.mode != NavState::INITIALISING {
                let message = Cdr::default().header(nav.stamp_ns, TABLE).pose(pose, 0.0).message();
                server.send(self.pose, nav.published_ns, &message);
                transforms.push(self.transform(nav.stamp_ns, TABLE.to_owned(), BASE, pose, 0.0));
            }
        }
        if let Some(links) = inputs.samples(topic::LINKS_STATE).last() {
            server.send(self.joints, links.published_ns, &self.joint_states(links));
            self.arm(links, &mut transforms);
        }
        if let Some(mission) = inputs.samples(topic::MISSION_STATE).last().filter(|m| m.target_seen != 0) {
            let mission: &MissionState = mission;
            transforms.push(self.transform(mission.stamp_ns, TABLE.to_owned(), TARGET, mission.target, 0.0));
        }
        if !transforms.is_empty() {
            let each = |cdr: Cdr, t: &Transform| cdr.header(t.time_ns, &t.parent).text(&t.child).pose(t.pose, t.z_m);
            server.send(self.transforms, now.ns(), &Cdr::default().list(&transforms, each).message());
        }
    }

    fn transform(&self, time_ns: u64, parent: String, child: &str, pose: [f64; 3], z_m: f64) -> Transform {
        Transform { time_ns, parent, child: self.own(child), pose, z_m }
    }

    fn arm(&self, links: &LinksState, transforms: &mut Vec<Transform>) {
        let count = self.origins.len().saturating_sub(1);
        for (i, [x_m, y_m, angle_rad]) in self.origins.iter().enumerate() {
            let parent = if i == 0 { self.own(BASE) } else { self.own(&link_name(i)) };
            let (child, q_rad) =
                if i == count { (END_EFFECTOR.to_owned(), 0.0) } else { (link_name(i + 1), links.q_rad[i]) };
            let z_m = if i == 0 { ARM_HEIGHT_M } else { 0.0 };
            transforms.push(self.transform(links.stamp_ns, parent, &child, [*x_m, *y_m, angle_rad + q_rad], z_m));
        }
    }

    fn joint_states(&self, links: &LinksState) -> Vec<u8> {
        let count = self.origins.len().saturating_sub(1);
        let names: Vec<_> = (1..=count).map(joint_name).collect();
        let numbers = |cdr: Cdr, values: &[f64]| cdr.list(values, |cdr, value| cdr.f64(*value));
        let cdr = Cdr::default().header(links.stamp_ns, "").list(&names, |cdr, name| cdr.text(name));
        [&links.q_rad, &links.qd_rad_s, &links.torque_nm]
            .into_iter()
            .fold(cdr, |cdr, values| numbers(cdr, &values[..count]))
            .message()
    }
}

/// The vehicle's name with a slash behind, for its frames; empty where the vehicle has none.
pub(crate) fn vehicle_prefix(bus: &Bus) -> String {
    let name = bus.full_name("/");
    name.trim_start_matches('/').to_owned()
}
