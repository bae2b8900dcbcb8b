//! `base_inertia`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct BaseInertia;

const ABOUT: About = About {
    id: "base_inertia",
    sentence: "The base has another moment of inertia than the plant file says.",
    place: Place::Mass,
    index: Index::None,
    parameters: &[Parameter::new("inertia_kg_m2", "kg m^2", "about the base's centre of mass")
        .within(1e-05, 10000.0)
        .scale(0.03)
        .of_plant()],
};

impl EffectKind for BaseInertia {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let _ = index;
        alone(plant.base.inertia_kg_m2)
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        let inertia = plant.base.inertia_kg_m2;
        Prior::sized(&[0.1 * inertia], &[3e-3 * inertia])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.base.inertia_kg_m2 = effect.first();
    }
}
