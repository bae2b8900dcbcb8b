//! `link_inertia`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct LinkInertia;

const ABOUT: About = About {
    id: "link_inertia",
    sentence: "A link has another moment of inertia than the plant file says.",
    place: Place::Mass,
    index: Index::Link,
    parameters: &[Parameter::new("inertia_kg_m2", "kg m^2", "about the link's centre of mass")
        .within(1e-07, 1000.0)
        .scale(0.01)
        .of_plant()],
};

impl EffectKind for LinkInertia {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let link = plant.links.get(index.unwrap_or(0));
        alone(link.map_or(0.0, |l| l.inertia_kg_m2))
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let inertia = plant.links.get(index.unwrap_or(0)).map_or(0.01, |l| l.inertia_kg_m2);
        Prior::sized(&[0.1 * inertia], &[3e-3 * inertia])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.links.len()) {
            physics.links[i].inertia_kg_m2 = effect.first();
        }
    }
}
