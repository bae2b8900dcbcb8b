//! `plume_impingement`
//!
//! The plume is a cone against the thrust; a link whose centre of mass lies in it is hit.

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct PlumeImpingement;

const ABOUT: About = About {
    id: "plume_impingement",
    sentence: "A plume that hits the arm pushes it and so gives back a share of the thrust.",
    place: Place::Thruster,
    index: Index::Thruster,
    parameters: &[Parameter::new("fraction", "", "share of the thrust that the arm catches")
        .within(0.0, 1.0)
        .scale(0.1)],
};

impl EffectKind for PlumeImpingement {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.2], &[2e-3])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.thrusters.len()) {
            physics.thrusters[i].plume_fraction = effect.first();
        }
    }
}
