//! The catalogue: every effect that a plant can have, one file each.
//!
//! To add one, write its file and add its line to the list below.

use crate::effect::{Effect, EffectError};
use crate::file::Plant;
use crate::kind::{EffectKind, Index, Place};
use crate::physics::Stream;

mod base_angular_drag;
mod base_com;
mod base_coulomb_drag;
mod base_inertia;
mod base_linear_drag;
mod base_mass;
mod base_quadratic_drag;
mod body_force;
mod clock_offset;
mod drive_kinematic_error;
mod encoder_offset;
mod encoder_scale;
mod gyro_bias;
mod gyro_scale;
mod joint_backlash;
mod joint_coulomb_friction;
mod joint_flexibility;
mod joint_spring;
mod joint_stribeck_friction;
mod joint_viscous_friction;
mod link_com;
mod link_inertia;
mod link_latency;
mod link_mass;
mod marker_offset;
mod marker_yaw;
mod mocap_latency;
mod mocap_rotation;
mod payload;
mod plume_impingement;
mod table_tilt;
mod tether_linear;
mod tether_torsion;
mod thruster_delay;
mod thruster_gain;
mod thruster_leak;
mod thruster_misalignment;
mod thruster_pressure_droop;
mod thruster_pressure_trend;
mod thruster_rise_time;
mod torque_constant;
mod torque_sensor;
mod unmodelled;
mod valve_swap;

static CATALOGUE: &[&dyn EffectKind] = &[
    &table_tilt::TableTilt,
    &base_linear_drag::BaseLinearDrag,
    &base_angular_drag::BaseAngularDrag,
    &base_quadratic_drag::BaseQuadraticDrag,
    &base_coulomb_drag::BaseCoulombDrag,
    &body_force::BodyForce,
    &tether_torsion::TetherTorsion,
    &tether_linear::TetherLinear,
    &base_mass::BaseMass,
    &base_inertia::BaseInertia,
    &base_com::BaseCom,
    &link_mass::LinkMass,
    &link_com::LinkCom,
    &link_inertia::LinkInertia,
    &payload::Payload,
    &joint_coulomb_friction::JointCoulombFriction,
    &joint_viscous_friction::JointViscousFriction,
    &joint_stribeck_friction::JointStribeckFriction,
    &joint_spring::JointSpring,
    &joint_flexibility::JointFlexibility,
    &joint_backlash::JointBacklash,
    &drive_kinematic_error::DriveKinematicError,
    &torque_constant::TorqueConstant,
    &torque_sensor::TorqueSensor,
    &encoder_offset::EncoderOffset,
    &encoder_scale::EncoderScale,
    &thruster_gain::ThrusterGain,
    &thruster_leak::ThrusterLeak,
    &thruster_misalignment::ThrusterMisalignment,
    &thruster_delay::ThrusterDelay,
    &thruster_rise_time::ThrusterRiseTime,
    &thruster_pressure_droop::ThrusterPressureDroop,
    &thruster_pressure_trend::ThrusterPressureTrend,
    &valve_swap::ValveSwap,
    &plume_impingement::PlumeImpingement,
    &mocap_latency::MocapLatency,
    &mocap_rotation::MocapRotation,
    &marker_offset::MarkerOffset,
    &marker_yaw::MarkerYaw,
    &gyro_bias::GyroBias,
    &gyro_scale::GyroScale,
    &link_latency::LinkLatency,
    &clock_offset::ClockOffset,
    &unmodelled::Unmodelled,
];

/// The id of what is none of the catalogue's.
pub const UNMODELLED: &str = "unmodelled";

/// Every kind of effect, in the order of the documentation.
pub fn catalogue() -> &'static [&'static dyn EffectKind] {
    CATALOGUE
}

/// The kind with this id.
pub fn find(id: &str) -> Option<&'static dyn EffectKind> {
    CATALOGUE.iter().copied().find(|k| k.about().id == id)
}

impl Effect {
    /// The effect `id` with its parameters at their plain nominal values, on all indices, from the start.
    pub fn new(id: &str) -> Result<Self, EffectError> {
        let kind = find(id)
            .ok_or_else(|| EffectError { message: format!("there is no effect {id:?}"), help: suggestion(id) })?;
        Ok(Self::of(kind))
    }

    /// An effect of a kind, which has to be of the catalogue, with its parameters' plain nominal values.
    pub fn of(kind: &'static dyn EffectKind) -> Self {
        Self::described_as(kind.about())
    }

    /// The kind.
    pub fn kind(&self) -> &'static dyn EffectKind {
        find(self.id()).unwrap_or(&unmodelled::Unmodelled)
    }

    /// The same with every parameter at the value that changes nothing in `plant`.
    #[must_use]
    pub fn nominal(self, plant: &Plant) -> Self {
        let values = self.kind().nominal(plant, self.index().map(|i| i.saturating_sub(1)));
        self.with(&values)
    }
}

/// The known ids that share the most with a misspelt one.
fn suggestion(id: &str) -> String {
    let pairs = |s: &str| -> Vec<(u8, u8)> { s.as_bytes().windows(2).map(|w| (w[0], w[1])).collect() };
    let wanted = pairs(id);
    let closest = CATALOGUE
        .iter()
        .map(|kind| {
            let known = kind.about().id;
            let own = pairs(known);
            let shared = own.iter().filter(|p| wanted.contains(p)).count();
            (2 * shared * 1000 / (own.len() + wanted.len()).max(1), known)
        })
        .max();
    match closest {
        Some((likeness, known)) if likeness > 500 => format!("did you mean {known}?"),
        _ => "docs/effects.md lists them all".to_owned(),
    }
}

/// Every single cause that `plant` can have, at the value that does nothing: each kind on each index, data stream or pair
/// of valves. What is unmodelled is not among them.
pub fn candidates(plant: &Plant) -> Vec<Effect> {
    let mut all = Vec::new();
    for kind in CATALOGUE.iter().copied().filter(|k| k.about().place != Place::Unknown) {
        let about = kind.about();
        let count = about.index.count(plant);
        match about.index {
            Index::None => all.push(Effect::of(kind)),
            Index::Channel => all.extend(STREAMS.iter().map(|stream| Effect::of(kind).on(stream))),
            _ if about.id == "valve_swap" => {
                for i in 1..=count {
                    all.extend((i + 1..=count).map(|other| Effect::of(kind).at(i).with(&[other as f64])));
                }
            }
            _ => all.extend((1..=count).map(|i| Effect::of(kind).at(i))),
        }
    }
    for effect in &mut all {
        if effect.id() != "valve_swap" {
            *effect = effect.clone().nominal(plant);
        }
    }
    all
}

/// Names of data streams that `clock_offset` knows, as the files of a measured experiment are
/// called; `mocap` is all poses.
pub const STREAMS: &[&str] =
    &["mocap", "base_pose", "ee_pose", "target_pose", "gyro", "joints", "joint_command", "valves"];

/// The streams that a name of [`STREAMS`] stands for.
fn streams(name: Option<&str>) -> &'static [Stream] {
    match name {
        Some("mocap") => &[Stream::BasePose, Stream::EePose, Stream::TargetPose],
        Some("base_pose") => &[Stream::BasePose],
        Some("ee_pose") => &[Stream::EePose],
        Some("target_pose") => &[Stream::TargetPose],
        Some("gyro") => &[Stream::Gyro],
        Some("joints") => &[Stream::Joints],
        Some("joint_command") => &[Stream::JointCommand],
        Some("valves") => &[Stream::Valves],
        _ => &[],
    }
}
