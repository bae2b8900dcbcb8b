//! `thruster_misalignment`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct ThrusterMisalignment;

const ABOUT: About = About {
    id: "thruster_misalignment",
    sentence: "A nozzle points elsewhere, so its force is turned.",
    place: Place::Thruster,
    index: Index::Thruster,
    parameters: &[Parameter::new("angle_rad", "rad", "turn of the force, counter-clockwise")
        .within(-3.2, 3.2)
        .scale(0.05)],
};

impl EffectKind for ThrusterMisalignment {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.1], &[2e-3])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.thrusters.len()) {
            physics.thrusters[i].direction_rad += effect.first();
        }
    }
}
