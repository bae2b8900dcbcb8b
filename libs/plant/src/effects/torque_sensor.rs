//! `torque_sensor`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct TorqueSensor;

const ABOUT: About = About {
    id: "torque_sensor",
    sentence: "A torque sensor reads scale times the torque plus a bias.",
    place: Place::Sensor,
    index: Index::Joint,
    parameters: &[
        Parameter::new("bias_N_m", "N m", "reading without torque").within(-100.0, 100.0).scale(0.05),
        Parameter::new("scale", "", "reading over torque").nominal(1.0).within(-10.0, 10.0).scale(0.1),
    ],
};

impl EffectKind for TorqueSensor {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let torque = plant.typical_joint_torque_n_m(index.unwrap_or(0));
        Prior::sized(&[0.03 * torque, 0.1], &[5e-4 * torque, 3e-3])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.joints.len()) {
            let [bias, scale, ..] = effect.padded();
            physics.joints[i].torque_sensor_bias_n_m = bias;
            physics.joints[i].torque_sensor_scale = scale;
        }
    }
}
