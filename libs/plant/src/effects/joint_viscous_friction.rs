//! `joint_viscous_friction`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::{FRICTION_SPIKE_SHARE, Prior};

pub(super) struct JointViscousFriction;

const ABOUT: About = About {
    id: "joint_viscous_friction",
    sentence: "A joint has another viscous friction: it resists in proportion to its rate.",
    place: Place::Joint,
    index: Index::Joint,
    parameters: &[Parameter::new("coefficient_N_m_s_rad", "N m s/rad", "torque per rate")
        .within(0.0, 100.0)
        .scale(0.1)
        .of_plant()],
};

impl EffectKind for JointViscousFriction {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let link = plant.links.get(index.unwrap_or(0));
        alone(link.map_or(0.0, |l| l.viscous_friction_n_m_s_rad))
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let joint = index.unwrap_or(0);
        let resistance = plant.typical_joint_friction_n_m(joint) / plant.typical_joint_rate_rad_s(joint);
        Prior::sized(&[resistance], &[FRICTION_SPIKE_SHARE * resistance])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.joints.len()) {
            physics.joints[i].friction.viscous_n_m_s_rad = effect.first();
        }
    }
}
