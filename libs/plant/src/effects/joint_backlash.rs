//! `joint_backlash`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct JointBacklash;

const ABOUT: About = About {
    id: "joint_backlash",
    sentence: "A drive has play: within it the link moves freely.",
    place: Place::Joint,
    index: Index::Joint,
    parameters: &[Parameter::new("gap_rad", "rad", "whole width of the play").within(0.0, 0.5).scale(0.005)],
};

impl EffectKind for JointBacklash {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[5e-3], &[1e-4]).of_contact()
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.joints.len()) {
            physics.joints[i].backlash_rad = effect.first();
        }
    }
}
