//! `gyro_bias`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct GyroBias;

const ABOUT: About = About {
    id: "gyro_bias",
    sentence: "The gyro reads a rate while the base is at rest.",
    place: Place::Sensor,
    index: Index::None,
    parameters: &[Parameter::new("bias_rad_s", "rad/s", "reading at rest").within(-1.0, 1.0).scale(0.001).of_plant()],
};

impl EffectKind for GyroBias {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let _ = index;
        alone(plant.sensors.gyro_bias_rad_s)
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[2e-3], &[5e-5])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.sensors.gyro_bias_rad_s = effect.first();
    }
}
