//! `joint_flexibility`
//!
//! The limit of a large stiffness is the rigid joint; the largest value stands for it.

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::{Prior, Response};

pub(super) struct JointFlexibility;

const ABOUT: About = About {
    id: "joint_flexibility",
    sentence: "A drive is elastic: its motor turns against the link like a spring.",
    place: Place::Joint,
    index: Index::Joint,
    parameters: &[Parameter::new("stiffness_N_m_rad", "N m/rad", "torque per wind-up")
        .nominal(1e5)
        .within(1.0, 100000.0)
        .scale(100.0)],
};

impl EffectKind for JointFlexibility {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let torque = plant.typical_joint_torque_n_m(index.unwrap_or(0));
        Prior::sized(&[0.01 / torque], &[1e-4 / torque]).responding(Response::Inverse)
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.joints.len()) {
            physics.joints[i].stiffness_n_m_rad = Some(effect.first());
        }
    }
}
