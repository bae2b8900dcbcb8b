//! `base_com`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct BaseCom;

const ABOUT: About = About {
    id: "base_com",
    sentence: "The base's centre of mass is not at the origin of its frame.",
    place: Place::Mass,
    index: Index::None,
    parameters: &[
        Parameter::new("x_m", "m", "centre of mass in the base frame").within(-1.0, 1.0).scale(0.01),
        Parameter::new("y_m", "m", "centre of mass in the base frame").within(-1.0, 1.0).scale(0.01),
    ],
};

impl EffectKind for BaseCom {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[4e-3; 2], &[1e-4; 2]).of_vector()
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        let [x, y, ..] = effect.padded();
        physics.base.com_m = [x, y];
    }
}
