//! `link_latency`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct LinkLatency;

const ABOUT: About = About {
    id: "link_latency",
    sentence: "Link telemetry is older than its stamp admits.",
    place: Place::Time,
    index: Index::Link,
    parameters: &[Parameter::new("delay_s", "s", "event to stamp").within(0.0, 5.0).scale(0.05).of_plant()],
};

impl EffectKind for LinkLatency {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let _ = index;
        alone(plant.sensors.link_latency_s)
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.02], &[1e-3])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.links.len()) {
            physics.sensors.link_delay_s[i] = effect.first();
        }
    }
}
