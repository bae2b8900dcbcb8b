//! `joint_coulomb_friction`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::{FRICTION_SPIKE_SHARE, Prior};

pub(super) struct JointCoulombFriction;

const ABOUT: About = About {
    id: "joint_coulomb_friction",
    sentence: "A joint has another dry friction: it resists with one torque at any speed.",
    place: Place::Joint,
    index: Index::Joint,
    parameters: &[Parameter::new("torque_N_m", "N m", "dry friction").within(0.0, 100.0).scale(0.05).of_plant()],
};

impl EffectKind for JointCoulombFriction {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let link = plant.links.get(index.unwrap_or(0));
        alone(link.map_or(0.0, |l| l.coulomb_friction_n_m))
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let friction = plant.typical_joint_friction_n_m(index.unwrap_or(0));
        Prior::sized(&[friction], &[FRICTION_SPIKE_SHARE * friction])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.joints.len()) {
            physics.joints[i].friction.coulomb_n_m = effect.first();
        }
    }
}
