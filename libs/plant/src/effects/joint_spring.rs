//! `joint_spring`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place};
use crate::physics::{JointLaw, Physics};
use crate::prior::{Prior, Response};

pub(super) struct JointSpring;

const ABOUT: About = About {
    id: "joint_spring",
    sentence: "Something elastic, such as a cable, turns a joint back towards an angle.",
    place: Place::Joint,
    index: Index::Joint,
    parameters: &[
        Parameter::new("stiffness_N_m_rad", "N m/rad", "torque per angle").within(0.0, 1000.0).scale(0.1),
        Parameter::new("rest_rad", "rad", "joint angle without torque").within(-10.0, 10.0).scale(0.3),
    ],
};

impl EffectKind for JointSpring {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let torque = plant.typical_joint_torque_n_m(index.unwrap_or(0));
        Prior::sized(&[0.05 * torque; 2], &[1e-3 * torque; 2]).responding(Response::Strength)
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.joints.len()) {
            physics.joint_laws.push(JointLaw { joint: i, law, values: effect.padded() });
        }
    }
}

fn law(p: &[f64; MAX_PARAMETERS], _t_s: f64, q_rad: f64, _qd_rad_s: f64) -> f64 {
    -p[0] * (q_rad - p[1])
}
