//! `marker_yaw`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct MarkerYaw;

const ABOUT: About = About {
    id: "marker_yaw",
    sentence: "The markers are turned on the base: its tracked heading is wrong by a constant.",
    place: Place::Sensor,
    index: Index::None,
    parameters: &[Parameter::new("angle_rad", "rad", "tracked heading less heading").within(-3.2, 3.2).scale(0.01)],
};

impl EffectKind for MarkerYaw {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.02], &[2e-4])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.sensors.marker_yaw_rad = effect.first();
    }
}
