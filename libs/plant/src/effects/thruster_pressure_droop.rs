//! `thruster_pressure_droop`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place, alone};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct ThrusterPressureDroop;

const ABOUT: About = About {
    id: "thruster_pressure_droop",
    sentence: "Valves starve each other: each loses thrust for every further open one.",
    place: Place::Thruster,
    index: Index::None,
    parameters: &[Parameter::new("fraction_per_extra_valve", "", "share lost for each further open valve")
        .within(0.0, 1.0)
        .scale(0.05)
        .of_plant()],
};

impl EffectKind for ThrusterPressureDroop {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let _ = index;
        alone(plant.valves.droop_fraction_per_extra_valve)
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.06], &[1e-4])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.supply.droop_per_extra_valve = effect.first();
    }
}
