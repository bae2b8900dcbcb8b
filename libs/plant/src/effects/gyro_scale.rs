//! `gyro_scale`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct GyroScale;

const ABOUT: About = About {
    id: "gyro_scale",
    sentence: "The gyro reads scale times the rate.",
    place: Place::Sensor,
    index: Index::None,
    parameters: &[Parameter::new("scale", "", "reading over rate")
        .nominal(1.0)
        .within(-10.0, 10.0)
        .scale(0.02)
        .of_plant()],
};

impl EffectKind for GyroScale {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let _ = index;
        alone(plant.sensors.gyro_scale)
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.02], &[1e-3])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.sensors.gyro_scale = effect.first();
    }
}
