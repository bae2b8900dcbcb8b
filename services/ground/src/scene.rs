//! What decorates a three-dimensional view, slowly: the table, the plumes of open valves, the target.

use crate::channels::{Channel, Channels};
use crate::frames::{TARGET, vehicle_prefix};
use crate::server::Server;
use crate::topics::AllTopics;
use foxglove::Encode;
use foxglove::messages::{
    Color, CylinderPrimitive, Duration, LinePrimitive, Point3, Pose, Quaternion, SceneEntity, SceneUpdate, Timestamp,
    TriangleListPrimitive, Vector3, line_primitive,
};
use fss_bus::{Bus, Time};
use fss_messages::topic;
use fss_plant::Plant;
use fss_plant::urdf::{ARM_HEIGHT_M, BASE};
use fss_ros2::robot::TABLE;

/// Between two pictures of the plumes, ns.
const PERIOD_NS: u64 = 100_000_000;
/// The table is told again after so many pictures, for those who came late.
const TABLE_EVERY: u64 = 10;
/// Length of a plume, m.
const PLUME_M: f64 = 0.12;
/// Half its width at its end, m.
const PLUME_HALF_WIDTH_M: f64 = 0.02;

/// Draws the decorations.
pub(crate) struct Scene {
    channel: Channel,
    base: String,
    target: String,
    table_m: [f64; 2],
    target_radius_m: Option<f64>,
    /// Of each thruster, corner by corner, in the base's frame.
    plumes: Vec<[[f64; 2]; 3]>,
    /// Thrusters that fired since the last picture, one bit each.
    fired: u32,
    next_ns: u64,
    pictures: u64,
}

impl Scene {
    pub(crate) fn new(channels: &mut Channels, plant: &Plant, bus: &Bus) -> Self {
        let plume = |thruster: &fss_plant::Thruster| {
            let ([x, y], [ux, uy]) = (thruster.position_m, thruster.unit_direction());
            // Gas leaves against the force.
            let end = [x - PLUME_M * ux, y - PLUME_M * uy];
            let aside = [-uy * PLUME_HALF_WIDTH_M, ux * PLUME_HALF_WIDTH_M];
            [[x, y], [end[0] + aside[0], end[1] + aside[1]], [end[0] - aside[0], end[1] - aside[1]]]
        };
        let schema = SceneUpdate::get_schema();
        let (name, descriptors) = schema.as_ref().map_or(("", &[][..]), |schema| (&schema.name, &schema.data));
        Self {
            channel: channels.protobuf(&bus.full_name("/scene"), name, descriptors),
            base: format!("{}{BASE}", vehicle_prefix(bus)),
            target: format!("{}{TARGET}", vehicle_prefix(bus)),
            table_m: plant.table.size_m,
            target_radius_m: plant.target.as_ref().map(|target| target.radius_m),
            plumes: plant.thrusters.iter().map(plume).collect(),
            fired: 0,
            next_ns: 0,
            pictures: 0,
        }
    }

    /// Sends a picture where it is time for one.
    pub(crate) fn send(&mut self, now: Time, inputs: &AllTopics, server: &Server) {
        for state in inputs.samples(topic::THRUSTERS_STATE) {
            let open = state.valves.iter().enumerate().filter(|(_, valve)| **valve != 0);
            self.fired |= open.fold(0, |mask, (i, _)| mask | 1 << i);
        }
        if now.ns() < self.next_ns {
            return;
        }
        self.next_ns = now.ns() + PERIOD_NS;
        let mut entities = vec![self.plumes(now)];
        if self.pictures.is_multiple_of(TABLE_EVERY) {
            entities.push(self.table(now));
            entities.extend(self.target_radius_m.map(|radius_m| self.target(now, radius_m)));
        }
        self.pictures += 1;
        self.fired = 0;
        let mut picture = Vec::new();
        // Encoding to memory does not fail.
        let _ = SceneUpdate { deletions: Vec::new(), entities }.encode(&mut picture);
        server.send(self.channel, now.ns(), &picture);
    }

    fn plumes(&self, now: Time) -> SceneEntity {
        let fired = self.plumes.iter().enumerate().filter(|(i, _)| self.fired & (1 << i) != 0);
        let points = fired.flat_map(|(_, corners)| corners.map(|[x, y]| Point3 { x, y, z: ARM_HEIGHT_M })).collect();
        let triangles =
            TriangleListPrimitive { points, color: Some(color([0.4, 0.8, 1.0, 0.8])), ..Default::default() };
        SceneEntity { triangles: vec![triangles], frame_locked: true, ..entity("plumes", &self.base, now) }
    }

    fn table(&self, now: Time) -> SceneEntity {
        let [x, y] = self.table_m.map(|size| size / 2.0);
        let corner = |(x, y)| Point3 { x, y, z: 0.0 };
        let outline = LinePrimitive {
            r#type: line_primitive::Type::LineLoop as i32,
            thickness: 0.02,
            points: [(-x, -y), (x, -y), (x, y), (-x, y)].map(corner).to_vec(),
            color: Some(color([0.6, 0.6, 0.6, 1.0])),
            ..Default::default()
        };
        SceneEntity { lines: vec![outline], ..entity("table", TABLE, now) }
    }

    fn target(&self, now: Time, radius_m: f64) -> SceneEntity {
        let disc = CylinderPrimitive {
            pose: Some(Pose {
                position: Some(Vector3 { x: 0.0, y: 0.0, z: ARM_HEIGHT_M }),
                orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
            }),
            size: Some(Vector3 { x: 2.0 * radius_m, y: 2.0 * radius_m, z: 2.0 * ARM_HEIGHT_M }),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color: Some(color([0.85, 0.55, 0.2, 0.9])),
        };
        SceneEntity { cylinders: vec![disc], frame_locked: true, ..entity("target", &self.target, now) }
    }
}

/// An entity that stays until it is told again.
fn entity(id: &str, frame: &str, now: Time) -> SceneEntity {
    let (seconds, nanoseconds) = ((now.ns() / 1_000_000_000) as u32, (now.ns() % 1_000_000_000) as u32);
    SceneEntity {
        timestamp: Some(Timestamp::new(seconds, nanoseconds)),
        frame_id: frame.to_owned(),
        id: id.to_owned(),
        lifetime: Some(Duration::new(0, 0)),
        ..Default::default()
    }
}

fn color([r, g, b, a]: [f64; 4]) -> Color {
    Color { r, g, b, a }
}
