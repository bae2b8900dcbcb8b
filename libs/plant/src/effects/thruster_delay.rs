//! `thruster_delay`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct ThrusterDelay;

const ABOUT: About = About {
    id: "thruster_delay",
    sentence: "A thruster follows its commands late: a valve opens and closes later than commanded.",
    place: Place::Thruster,
    index: Index::Thruster,
    parameters: &[Parameter::new("delay_s", "s", "command to first movement").within(0.0, 2.0).scale(0.02).of_plant()],
};

impl EffectKind for ThrusterDelay {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let _ = index;
        alone(plant.valves.delay_s)
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.02], &[1e-3])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.thrusters.len()) {
            physics.thrusters[i].delay_s = effect.first();
        }
    }
}
