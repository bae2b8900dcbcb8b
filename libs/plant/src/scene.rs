//! The table from above: what pictures, pages and three-dimensional viewers draw of a plant.
//!
//! Every shape is a polygon in the frame of its body, in m. A [`Posture`] says where the bodies are; [`Scene::placed`] lists
//! the shapes with their poses, back to front.

use crate::urdf::LINK_WIDTH_M;
use crate::{Plant, Target, Thruster};
use fss_multibody::{Model, coordinates};
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Colours of what moves, and of the room around the table.
#[derive(Debug, Serialize)]
pub struct Colours {
    /// The base and its way.
    pub base: &'static str,
    /// The end-effector, its way and its goal.
    pub tip: &'static str,
    /// The target and its way.
    pub target: &'static str,
    /// Gas of open valves.
    pub plume: &'static str,
    /// Beyond the granite.
    pub beyond: &'static str,
}

/// The colours, as `#rrggbb`.
pub const COLOURS: Colours =
    Colours { base: "#3377cc", tip: "#cc3333", target: "#2f7d4f", plume: "#e08a1e", beyond: "#d9d5cc" };
/// Of edges.
const INK: &str = "#222222";
const NONE: &str = "none";
/// Length of a plume, and half its width at the end, m.
const PLUME_M: [f64; 2] = [0.2, 0.05];
/// Polygons stay so close to the circles for which they stand, m.
const ROUND_M: f64 = 3e-4;
/// Half the side of a nozzle, m.
const NOZZLE_M: f64 = 0.012;
/// Half the length of the goal's cross, m.
const GOAL_M: f64 = 0.05;
/// Half the width of the target's handle, m, and where it begins, as a share of the radius.
const HANDLE_M: f64 = 0.015;
const HANDLE_FROM: f64 = 0.82;

/// A closed polygon; two corners are a line.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shape {
    /// Its corners, m.
    pub corners_m: Vec<[f64; 2]>,
    /// Colour of the inside, or `none`.
    pub fill: &'static str,
    /// Colour of the edge, or `none`.
    pub stroke: &'static str,
}

/// What stands on the table.
#[derive(Debug, Serialize)]
pub struct Scene {
    /// The granite, in the table frame.
    pub table: Shape,
    /// The base: its body first.
    pub base: Vec<Shape>,
    /// What leaves each thruster while it pushes, in the base frame.
    pub plumes: Vec<Shape>,
    /// Each link, in a frame that lies in its joint and points along it.
    pub links: Vec<Vec<Shape>>,
    /// The end-effector, in its own frame.
    pub tip: Vec<Shape>,
    /// The target with its handle.
    pub target: Vec<Shape>,
    /// Where the end-effector shall be.
    pub goal: Vec<Shape>,
    /// Colours of what the front ends add: ways, plumes, the room.
    pub colours: Colours,
}

/// Where the bodies are: x m, y m, angle rad in the table frame.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Posture {
    /// The base.
    pub base: [f64; 3],
    /// Each link, in its joint and along it, and then the end-effector.
    pub arm: Vec<[f64; 3]>,
    /// The target, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<[f64; 3]>,
    /// Where the end-effector shall be.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub goal: Option<[f64; 3]>,
    /// Thrusters that push, a bit each, the first in the lowest.
    pub pushing: u32,
}

impl Posture {
    /// Of the vehicle alone: its base and encoder angles (rad).
    pub fn of(model: &Model, base: [f64; 3], q_rad: &[f64]) -> Self {
        let poses = model.kinematics(&coordinates(base, q_rad));
        let links = poses.joints.iter().zip(&poses.com[1..]).take(model.link_count());
        let links = links.map(|(joint, com)| [joint.x, joint.y, com.z]);
        Self { base, arm: links.chain([poses.end_effector.into()]).collect(), ..Self::default() }
    }
}

impl Shape {
    fn new(corners_m: impl Into<Vec<[f64; 2]>>, fill: &'static str, stroke: &'static str) -> Self {
        Self { corners_m: corners_m.into(), fill, stroke }
    }

    fn rectangle([x0, y0]: [f64; 2], [x1, y1]: [f64; 2], fill: &'static str, stroke: &'static str) -> Self {
        Self::new([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], fill, stroke)
    }

    fn disc(radius_m: f64, fill: &'static str, stroke: &'static str) -> Self {
        Self::new(arc([0.0; 2], radius_m, 0.0, TAU), fill, stroke)
    }

    /// Its corners with its frame at this pose.
    pub fn at(&self, [x, y, angle]: [f64; 3]) -> Vec<[f64; 2]> {
        let (sin, cos) = angle.sin_cos();
        self.corners_m.iter().map(|[u, v]| [x + cos * u - sin * v, y + sin * u + cos * v]).collect()
    }
}

/// Points of an arc.
pub fn arc(center_m: [f64; 2], radius_m: f64, from_rad: f64, to_rad: f64) -> Vec<[f64; 2]> {
    let steps = ((to_rad - from_rad).abs() / (2.0 * (1.0 - ROUND_M / radius_m).acos())).ceil().max(1.0);
    let angles = (0..=steps as usize).map(|k| from_rad + (to_rad - from_rad) * k as f64 / steps);
    angles.map(|angle| [center_m[0] + radius_m * angle.cos(), center_m[1] + radius_m * angle.sin()]).collect()
}

impl Scene {
    /// Of a plant and the target that floats beside the vehicle.
    pub fn of(plant: &Plant, target: Option<&Target>) -> Self {
        let half = |size: [f64; 2]| size.map(|m| m / 2.0);
        let centred = |[w, h]: [f64; 2], fill, stroke| Shape::rectangle([-w, -h], [w, h], fill, stroke);
        let looks = [[0.0, 0.0], [0.3 * plant.base.size_m[0], 0.0]];
        let mut base = vec![centred(half(plant.base.size_m), "#c9ced6", INK), Shape::new(looks, NONE, INK)];
        base.extend(plant.thrusters.iter().map(nozzle));
        if !plant.links.is_empty() {
            base.push(Shape::new([[0.0, 0.0], plant.base.joint1_xy_m], NONE, INK));
        }
        let cross = [[[-GOAL_M, 0.0], [GOAL_M, 0.0]], [[0.0, -GOAL_M], [0.0, GOAL_M]]];
        Self {
            table: centred(half(plant.table.size_m), "#fbfbfa", "#888888"),
            base,
            plumes: plant.thrusters.iter().map(plume).collect(),
            links: plant.links.iter().map(|link| limb(link.length_m)).collect(),
            tip: vec![Shape::disc(LINK_WIDTH_M / 4.0, COLOURS.tip, NONE)],
            target: target.map_or_else(Vec::new, |target| disc(target.radius_m)),
            goal: cross.map(|line| Shape::new(line, NONE, COLOURS.tip)).into(),
            colours: COLOURS,
        }
    }

    /// The shapes of all bodies but the table, back to front, each with the pose of its frame.
    pub fn placed<'a>(&'a self, posture: &'a Posture) -> impl Iterator<Item = (&'a Shape, [f64; 3])> {
        let all = |shapes: &'a [Shape], pose: Option<[f64; 3]>| {
            pose.into_iter().flat_map(move |p| shapes.iter().map(move |s| (s, p)))
        };
        let plumes = self.pushing(posture.pushing).map(|shape| (shape, posture.base));
        let limbs = self.links.iter().chain([&self.tip]).zip(&posture.arm);
        all(&self.target, posture.target)
            .chain(plumes)
            .chain(all(&self.base, Some(posture.base)))
            .chain(limbs.flat_map(move |(shapes, pose)| all(shapes, Some(*pose))))
            .chain(all(&self.goal, posture.goal))
    }

    /// The plumes of the thrusters that push, a bit each.
    pub fn pushing(&self, mask: u32) -> impl Iterator<Item = &Shape> {
        self.plumes.iter().enumerate().filter(move |(k, _)| mask >> k & 1 != 0).map(|(_, plume)| plume)
    }
}

/// Open valves, a bit each, the first in the lowest.
pub fn mask(valves: &[u8]) -> u32 {
    valves.iter().enumerate().fold(0, |mask, (k, open)| mask | u32::from(*open != 0) << k)
}

fn nozzle(thruster: &Thruster) -> Shape {
    let [x, y] = thruster.position_m;
    Shape::rectangle([x - NOZZLE_M, y - NOZZLE_M], [x + NOZZLE_M, y + NOZZLE_M], "#6c7482", NONE)
}

/// Gas leaves against the force.
fn plume(thruster: &Thruster) -> Shape {
    let ([x, y], [ux, uy], [length, half]) = (thruster.position_m, thruster.unit_direction(), PLUME_M);
    let end = [x - length * ux, y - length * uy];
    let corners = [[x, y], [end[0] - half * uy, end[1] + half * ux], [end[0] + half * uy, end[1] - half * ux]];
    Shape::new(corners, COLOURS.plume, NONE)
}

/// A link with its joint.
fn limb(length_m: f64) -> Vec<Shape> {
    let radius_m = LINK_WIDTH_M / 2.0;
    let ends = [arc([length_m, 0.0], radius_m, -PI / 2.0, PI / 2.0), arc([0.0; 2], radius_m, PI / 2.0, 1.5 * PI)];
    vec![Shape::new(ends.concat(), "#f0f0ee", INK), Shape::disc(LINK_WIDTH_M / 4.0, INK, NONE)]
}

/// A disc with its handle on the rim, at the body's angle 0.
fn disc(radius_m: f64) -> Vec<Shape> {
    const EDGE: &str = "#245c3a";
    let from_m = HANDLE_FROM * radius_m;
    vec![
        Shape::disc(radius_m, "#cfe5d5", EDGE),
        Shape::new([[0.0, 0.0], [from_m, 0.0]], NONE, EDGE),
        Shape::rectangle([from_m, -HANDLE_M], [radius_m, HANDLE_M], EDGE, NONE),
    ]
}
