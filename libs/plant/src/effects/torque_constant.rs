//! `torque_constant`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct TorqueConstant;

const ABOUT: About = About {
    id: "torque_constant",
    sentence: "A motor gives more or less torque for its current than the plant file says.",
    place: Place::Joint,
    index: Index::Joint,
    parameters: &[Parameter::new("scale", "", "real torque over nominal torque for the same current")
        .nominal(1.0)
        .within(0.0, 10.0)
        .scale(0.1)],
};

impl EffectKind for TorqueConstant {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.1], &[3e-3])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.joints.len()) {
            physics.joints[i].torque_scale = effect.first();
        }
    }
}
