//! `mocap_latency`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct MocapLatency;

const ABOUT: About = About {
    id: "mocap_latency",
    sentence: "Motion capture arrives later than its stamp admits.",
    place: Place::Time,
    index: Index::None,
    parameters: &[Parameter::new("delay_s", "s", "event to sample").within(0.0, 2.0).scale(0.02).of_plant()],
};

impl EffectKind for MocapLatency {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let _ = index;
        alone(plant.sensors.mocap_latency_s)
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.02], &[1e-3])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.sensors.mocap_delay_s = effect.first();
    }
}
