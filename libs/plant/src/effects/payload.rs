//! `payload`

use crate::effect::Effect;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;

pub(super) struct Payload;

const ABOUT: About = About {
    id: "payload",
    sentence: "The end-effector carries a body; with an onset, it takes hold of it during the run.",
    place: Place::Mass,
    index: Index::None,
    parameters: &[Parameter::new("mass_kg", "kg", "mass at the end-effector").within(0.0, 1000.0).scale(0.2)],
};

impl EffectKind for Payload {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.payload_kg += effect.first();
    }
}
