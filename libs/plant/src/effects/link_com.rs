//! `link_com`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct LinkCom;

const ABOUT: About = About {
    id: "link_com",
    sentence: "A link's centre of mass is elsewhere on its axis than the plant file says.",
    place: Place::Mass,
    index: Index::Link,
    parameters: &[Parameter::new("b_m", "m", "centre of mass before the next joint")
        .within(-2.0, 2.0)
        .scale(0.02)
        .of_plant()],
};

impl EffectKind for LinkCom {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let link = plant.links.get(index.unwrap_or(0));
        alone(link.map_or(0.0, |l| l.com_to_next_joint_m))
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let length = plant.links.get(index.unwrap_or(0)).map_or(0.3, |l| l.length_m);
        Prior::sized(&[0.025 * length], &[1e-3 * length])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.links.len()) {
            physics.links[i].com_to_next_joint_m = effect.first();
        }
    }
}
