//! `link_mass`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct LinkMass;

const ABOUT: About = About {
    id: "link_mass",
    sentence: "A link has another mass than the plant file says.",
    place: Place::Mass,
    index: Index::Link,
    parameters: &[Parameter::new("mass_kg", "kg", "mass of the link").within(0.001, 1000.0).scale(0.2).of_plant()],
};

impl EffectKind for LinkMass {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let link = plant.links.get(index.unwrap_or(0));
        alone(link.map_or(0.0, |l| l.mass_kg))
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let mass = plant.links.get(index.unwrap_or(0)).map_or(1.0, |l| l.mass_kg);
        Prior::sized(&[0.04 * mass], &[1e-3 * mass])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.links.len()) {
            physics.links[i].mass_kg = effect.first();
        }
    }
}
