//! `thruster_rise_time`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct ThrusterRiseTime;

const ABOUT: About = About {
    id: "thruster_rise_time",
    sentence: "A valve opens slowly: thrust rises with a time constant. Of a proportional thruster, its lag.",
    place: Place::Thruster,
    index: Index::Thruster,
    parameters: &[Parameter::new("time_s", "s", "time constant of opening, or the lag")
        .within(0.0, 2.0)
        .scale(0.02)
        .of_plant()],
};

impl EffectKind for ThrusterRiseTime {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        alone(plant.timing(index.unwrap_or(0)).rise_s)
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.02], &[1e-3])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.thrusters.len()) {
            let thruster = &mut physics.thrusters[i];
            thruster.rise_s = effect.first();
            if thruster.is_proportional {
                thruster.fall_s = effect.first();
            }
        }
    }
}
