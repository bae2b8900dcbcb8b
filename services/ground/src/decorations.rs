//! What decorates a three-dimensional view, slowly: the [`Scene`] of the plant, but for the arm, which the URDF has.

use crate::channels::{Channel, Channels};
use crate::frames::{TARGET, vehicle_prefix};
use crate::topics::AllTopics;
use crate::viewers::Viewers;
use foxglove::Encode;
use foxglove::messages::{
    Color, Duration, LinePrimitive, Point3, SceneEntity, SceneUpdate, Timestamp, TriangleListPrimitive, line_primitive,
};
use fss_bus::{Bus, Time};
use fss_messages::topic;
use fss_plant::Plant;
use fss_plant::scene::{Scene, Shape, mask};
use fss_plant::urdf::{ARM_HEIGHT_M, BASE, BASE_HEIGHT_M};
use fss_ros2::robot::TABLE;

/// Between two pictures, ns.
const PERIOD_NS: u64 = 100_000_000;
/// What does not change is told again after so many pictures, for those who came late.
const AGAIN_EVERY: u64 = 10;
/// Width of an edge, pixels.
const EDGE_PX: f64 = 1.5;
/// Above a body that the URDF has, so that both are seen, m.
const ABOVE_M: f64 = 0.001;

/// Draws the scene, but for what the URDF has.
pub(crate) struct Decorations {
    channel: Channel,
    base: String,
    target: String,
    scene: Scene,
    /// Thrusters that pushed since the last picture, one bit each.
    pushed: u32,
    /// Where the end-effector shall be: x m, y m, angle rad.
    goal: [f64; 3],
    next_ns: u64,
    pictures: u64,
}

impl Decorations {
    pub(crate) fn new(channels: &mut Channels, plant: &Plant, bus: &Bus) -> Self {
        let schema = SceneUpdate::get_schema();
        let (name, descriptors) = schema.as_ref().map_or(("", &[][..]), |schema| (&schema.name, &schema.data));
        Self {
            channel: channels.protobuf(&bus.full_name("/scene"), name, descriptors),
            base: format!("{}{BASE}", vehicle_prefix(bus)),
            target: format!("{}{TARGET}", vehicle_prefix(bus)),
            scene: Scene::of(plant, plant.target.as_ref()),
            pushed: 0,
            goal: [0.0; 3],
            next_ns: 0,
            pictures: 0,
        }
    }

    /// Sends a picture where it is time for one.
    pub(crate) fn send(&mut self, now: Time, inputs: &AllTopics, viewers: &Viewers) {
        let states = inputs.samples(topic::THRUSTERS_STATE);
        self.pushed = states.iter().fold(self.pushed, |all, state| all | mask(&state.valves));
        self.goal = inputs.samples(topic::ARM_COMMAND).last().map_or(self.goal, |command| command.ee_goal);
        if now.ns() < self.next_ns {
            return;
        }
        self.next_ns = now.ns() + PERIOD_NS;
        let scene = &self.scene;
        let plumes = scene.pushing(self.pushed).map(|plume| (plume, [0.0; 3]));
        // Without a task the goal is all zero.
        let goal = scene.goal.iter().filter(|_| self.goal != [0.0; 3]).map(|line| (line, self.goal));
        let mut entities = vec![
            entity("plumes", &self.base, now, plumes, ARM_HEIGHT_M),
            entity("goal", TABLE, now, goal, ARM_HEIGHT_M),
        ];
        if self.pictures.is_multiple_of(AGAIN_EVERY) {
            let fixed = |shapes: &[Shape], id: &str, frame: &str, z_m: f64| {
                entity(id, frame, now, shapes.iter().map(|shape| (shape, [0.0; 3])), z_m)
            };
            let table = Shape { fill: "none", ..scene.table.clone() };
            entities.push(fixed(&[table], "table", TABLE, 0.0));
            entities.push(fixed(&scene.base, "base", &self.base, BASE_HEIGHT_M + ABOVE_M));
            if !scene.target.is_empty() {
                entities.push(fixed(&scene.target, "target", &self.target, ARM_HEIGHT_M));
            }
        }
        self.pictures += 1;
        self.pushed = 0;
        let mut picture = Vec::new();
        // Encoding to memory does not fail.
        let _ = SceneUpdate { deletions: Vec::new(), entities }.encode(&mut picture);
        viewers.send(self.channel, now.ns(), &picture);
    }
}

/// An entity of shapes at a height, each at its pose in the entity's frame; it stays until it is told again.
fn entity<'a>(
    id: &str,
    frame: &str,
    now: Time,
    shapes: impl Iterator<Item = (&'a Shape, [f64; 3])>,
    z_m: f64,
) -> SceneEntity {
    let (seconds, nanoseconds) = ((now.ns() / 1_000_000_000) as u32, (now.ns() % 1_000_000_000) as u32);
    let mut entity = SceneEntity {
        timestamp: Some(Timestamp::new(seconds, nanoseconds)),
        frame_id: frame.to_owned(),
        id: id.to_owned(),
        lifetime: Some(Duration::new(0, 0)),
        frame_locked: true,
        ..Default::default()
    };
    for (k, (shape, pose)) in shapes.enumerate() {
        // Each lies on the one before.
        let z = z_m + ABOVE_M * k as f64;
        let points: Vec<_> = shape.at(pose).into_iter().map(|[x, y]| Point3 { x, y, z }).collect();
        if let Some(color) = color(shape.fill) {
            // The outlines are convex: a fan about the first corner.
            let fan = points.windows(2).skip(1).flat_map(|pair| [points[0], pair[0], pair[1]]).collect();
            entity.triangles.push(TriangleListPrimitive { points: fan, color: Some(color), ..Default::default() });
        }
        if let Some(color) = color(shape.stroke) {
            entity.lines.push(LinePrimitive {
                r#type: line_primitive::Type::LineLoop as i32,
                thickness: EDGE_PX,
                scale_invariant: true,
                points,
                color: Some(color),
                ..Default::default()
            });
        }
    }
    entity
}

/// Of `#rrggbb`; `none` is none.
fn color(text: &str) -> Option<Color> {
    let rgb = u32::from_str_radix(text.strip_prefix('#')?, 16).ok()?;
    let part = |shift: u32| f64::from(rgb >> shift & 0xff) / 255.0;
    Some(Color { r: part(16), g: part(8), b: part(0), a: 1.0 })
}
