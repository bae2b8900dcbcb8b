//! `mocap_rotation`
//!
//! A turn of the whole frame alone cannot be seen: only against a known direction, such as gravity.

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct MocapRotation;

const ABOUT: About = About {
    id: "mocap_rotation",
    sentence: "The camera frame is turned against the table.",
    place: Place::Sensor,
    index: Index::None,
    parameters: &[Parameter::new("angle_rad", "rad", "turn of all poses about the table's origin")
        .within(-3.2, 3.2)
        .scale(0.02)],
};

impl EffectKind for MocapRotation {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.02], &[2e-4])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.sensors.mocap_rotation_rad += effect.first();
    }
}
