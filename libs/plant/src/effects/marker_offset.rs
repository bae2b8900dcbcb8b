//! `marker_offset`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct MarkerOffset;

const ABOUT: About = About {
    id: "marker_offset",
    sentence: "The tracked point is not the origin of the base frame.",
    place: Place::Sensor,
    index: Index::None,
    parameters: &[
        Parameter::new("x_m", "m", "tracked point in the base frame").within(-1.0, 1.0).scale(0.005),
        Parameter::new("y_m", "m", "tracked point in the base frame").within(-1.0, 1.0).scale(0.005),
    ],
};

impl EffectKind for MarkerOffset {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[4e-3; 2], &[1e-4; 2]).of_vector()
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        let [x, y, ..] = effect.padded();
        physics.sensors.marker_offset_m = [x, y];
    }
}
