//! `joint_stribeck_friction`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::{FRICTION_SPIKE_SHARE, Prior, Response};

pub(super) struct JointStribeckFriction;

const ABOUT: About = About {
    id: "joint_stribeck_friction",
    sentence: "A joint sticks: near rest it resists more than while it slides.",
    place: Place::Joint,
    index: Index::Joint,
    parameters: &[
        Parameter::new("torque_N_m", "N m", "static friction above dry friction").within(0.0, 100.0).scale(0.05),
        Parameter::new("velocity_rad_s", "rad/s", "rate at which it has fallen to 1/e")
            .nominal(0.05)
            .within(0.0001, 10.0)
            .scale(0.02),
    ],
};

impl EffectKind for JointStribeckFriction {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let friction = plant.typical_joint_friction_n_m(index.unwrap_or(0));
        // The law of a friction is known no better than its size.
        let stated = plant.uncertainty.as_ref().map_or(0.0, |uncertainty| uncertainty.coulomb_friction_n_m);
        Prior::sized(&[friction], &[stated.max(2.0 * FRICTION_SPIKE_SHARE * friction)])
            .responding(Response::Scale(&[0.01, 0.03, 0.1]))
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.joints.len()) {
            let [torque, rate, ..] = effect.padded();
            physics.joints[i].friction.stribeck_n_m = torque;
            physics.joints[i].friction.stribeck_rad_s = rate;
        }
    }
}
