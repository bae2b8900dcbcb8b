//! `encoder_offset`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct EncoderOffset;

const ABOUT: About = About {
    id: "encoder_offset",
    sentence: "An encoder reads a constant angle too much, and the servo follows it.",
    place: Place::Sensor,
    index: Index::Joint,
    parameters: &[Parameter::new("offset_rad", "rad", "reading at zero").within(-10.0, 10.0).scale(0.01)],
};

impl EffectKind for EncoderOffset {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        // Where gravity acts in the plane, joints are set to zero as the arm hangs, and friction holds it beside the vertical.
        let hangs = plant.table.gravity_m_s2 != [0.0; 2];
        Prior::sized(&[0.01], &[if hangs { 1e-3 } else { 2e-4 }])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.joints.len()) {
            physics.joints[i].encoder_offset_rad = effect.first();
        }
    }
}
