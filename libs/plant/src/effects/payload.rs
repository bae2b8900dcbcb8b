//! `payload`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::{Prior, Response};

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

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        let mass = plant.links.last().map_or(1.0, |l| l.mass_kg);
        Prior::sized(&[0.04 * mass], &[1e-4 * mass]).responding(Response::Onset)
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.payload_kg += effect.first();
    }
}
