//! `base_mass`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct BaseMass;

const ABOUT: About = About {
    id: "base_mass",
    sentence: "The base has another mass than the plant file says.",
    place: Place::Mass,
    index: Index::None,
    parameters: &[Parameter::new("mass_kg", "kg", "mass of the base with a full tank")
        .within(0.01, 10000.0)
        .scale(0.5)
        .of_plant()],
};

impl EffectKind for BaseMass {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let _ = index;
        alone(plant.base.mass_kg)
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        let mass = plant.base.mass_kg;
        Prior::sized(&[0.06 * mass], &[1e-3 * mass])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.base.mass_kg = effect.first();
    }
}
