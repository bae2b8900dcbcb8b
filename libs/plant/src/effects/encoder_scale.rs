//! `encoder_scale`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct EncoderScale;

const ABOUT: About = About {
    id: "encoder_scale",
    sentence: "An encoder reads scale times the angle, and the servo follows it.",
    place: Place::Sensor,
    index: Index::Joint,
    parameters: &[Parameter::new("scale", "", "reading over angle").nominal(1.0).within(0.01, 10.0).scale(0.02)],
};

impl EffectKind for EncoderScale {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.02], &[2e-4])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.joints.len()) {
            physics.joints[i].encoder_scale = effect.first();
        }
    }
}
