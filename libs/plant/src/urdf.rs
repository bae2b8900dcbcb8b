//! The vehicle as a URDF, made from the plant file: what three-dimensional viewers draw.
//!
//! One link for the base and one for each `[[link]]`, joined by revolute joints about the vertical whose angles are the
//! encoders': what `/joint_states` says. Heights are for the eye only; the vehicle is planar.

use crate::{Link, Plant};
use std::fmt::Write;

/// Height of the base, m.
pub const BASE_HEIGHT_M: f64 = 0.3;
/// Height at which the arm hangs, m.
pub const ARM_HEIGHT_M: f64 = 0.15;
/// Width of a link, m.
pub(crate) const LINK_WIDTH_M: f64 = 0.06;

/// Name of the base's frame.
pub const BASE: &str = "base";
/// Name of the frame at the arm's end.
pub const END_EFFECTOR: &str = "end_effector";

/// Name of a link's frame: it lies in the link's joint and points along it. Counted from 1.
pub fn link_name(number: usize) -> String {
    format!("link_{number}")
}

/// Name of a joint, counted from 1.
pub fn joint_name(number: usize) -> String {
    format!("joint_{number}")
}

/// The arm's joints by name, the frames that they move and then the end-effector's, and where each frame is in the one
/// before it with encoders at zero: x m, y m, rad.
pub struct ArmFrames {
    /// Names of the joints.
    pub joints: Vec<String>,
    /// Names of the frames.
    pub links: Vec<String>,
    /// Their places.
    pub origins: Vec<[f64; 3]>,
}

impl ArmFrames {
    /// Of a plant's first `most` links.
    pub fn of(plant: &Plant, most: usize) -> Self {
        let count = plant.link_count().min(most);
        let mut origins: Vec<_> = (0..count).map(|i| joint_origin(plant, i)).collect();
        origins.extend(plant.links[..count].last().map(|link| [link.length_m, 0.0, 0.0]));
        let links = (1..=count).map(link_name).chain([END_EFFECTOR.to_owned()]).collect();
        Self { joints: (1..=count).map(joint_name).collect(), links, origins }
    }
}

/// Where a link's frame is in the one before it with its encoder at zero, from 0: x m, y m, angle rad.
pub fn joint_origin(plant: &Plant, link: usize) -> [f64; 3] {
    let offset_rad = plant.links[link].joint_offset_rad;
    match link.checked_sub(1) {
        None => {
            let [x_m, y_m] = plant.base.joint1_xy_m;
            [x_m, y_m, plant.base.joint1_angle_rad + offset_rad]
        }
        Some(before) => [plant.links[before].length_m, 0.0, offset_rad],
    }
}

/// The URDF of a plant's vehicle.
pub fn urdf(plant: &Plant) -> String {
    let mut text = String::from("<?xml version=\"1.0\"?>\n<robot name=\"fss\">\n");
    text.push_str(&base(plant));
    for (i, link) in plant.links.iter().enumerate() {
        let parent = if i == 0 { BASE.to_owned() } else { link_name(i) };
        text.push_str(&link_element(i + 1, link));
        text.push_str(&joint_element(i + 1, &parent, joint_origin(plant, i), link, plant.servo(i).max_rate_rad_s));
    }
    if let Some(last) = plant.links.last() {
        let parent = link_name(plant.links.len());
        let _ = write!(
            text,
            "  <link name=\"{END_EFFECTOR}\"/>\n  <joint name=\"{END_EFFECTOR}_joint\" type=\"fixed\">\n    \
             <parent link=\"{parent}\"/>\n    <child link=\"{END_EFFECTOR}\"/>\n    \
             <origin xyz=\"{} 0 0\" rpy=\"0 0 0\"/>\n  </joint>\n",
            last.length_m
        );
    }
    text.push_str("</robot>\n");
    text
}

fn base(plant: &Plant) -> String {
    let ([length_m, width_m], z_m) = (plant.base.size_m, BASE_HEIGHT_M / 2.0);
    let inertial = inertial([0.0, z_m], plant.base.mass_kg, plant.base.inertia_kg_m2);
    let shape = [length_m, width_m, BASE_HEIGHT_M];
    format!("  <link name=\"{BASE}\">\n{}{inertial}  </link>\n", visual([0.0, z_m], shape, "0.25 0.35 0.55 1"))
}

fn link_element(number: usize, link: &Link) -> String {
    let centre_m = link.length_m - link.com_to_next_joint_m;
    let visual = visual([link.length_m / 2.0, 0.0], [link.length_m, LINK_WIDTH_M, LINK_WIDTH_M], "0.75 0.75 0.78 1");
    let inertial = inertial([centre_m, 0.0], link.mass_kg, link.inertia_kg_m2);
    format!("  <link name=\"{}\">\n{visual}{inertial}  </link>\n", link_name(number))
}

fn joint_element(number: usize, parent: &str, [x, y, angle]: [f64; 3], link: &Link, rate_rad_s: f64) -> String {
    let (name, child, limit) = (joint_name(number), link_name(number), link.joint_limit_rad);
    let (z, effort) = (if number == 1 { ARM_HEIGHT_M } else { 0.0 }, link.max_torque_n_m);
    format!(
        "  <joint name=\"{name}\" type=\"revolute\">\n    <parent link=\"{parent}\"/>\n    <child link=\"{child}\"/>\n    \
         <origin xyz=\"{x} {y} {z}\" rpy=\"0 0 {angle}\"/>\n    <axis xyz=\"0 0 1\"/>\n    \
         <limit lower=\"-{limit}\" upper=\"{limit}\" effort=\"{effort}\" velocity=\"{rate_rad_s}\"/>\n    \
         <dynamics damping=\"{}\" friction=\"{}\"/>\n  </joint>\n",
        link.viscous_friction_n_m_s_rad, link.coulomb_friction_n_m
    )
}

fn visual([x, z]: [f64; 2], [length, width, height]: [f64; 3], color: &str) -> String {
    format!(
        "    <visual>\n      <origin xyz=\"{x} 0 {z}\" rpy=\"0 0 0\"/>\n      <geometry><box size=\"{length} {width} \
         {height}\"/></geometry>\n      <material name=\"\"><color rgba=\"{color}\"/></material>\n    </visual>\n"
    )
}

/// The plant knows the inertia about the vertical; a planar vehicle has no other, and viewers want all three.
fn inertial([x, z]: [f64; 2], mass_kg: f64, inertia: f64) -> String {
    format!(
        "    <inertial>\n      <origin xyz=\"{x} 0 {z}\" rpy=\"0 0 0\"/>\n      <mass value=\"{mass_kg}\"/>\n      \
         <inertia ixx=\"{inertia}\" ixy=\"0\" ixz=\"0\" iyy=\"{inertia}\" iyz=\"0\" izz=\"{inertia}\"/>\n    </inertial>\n"
    )
}
