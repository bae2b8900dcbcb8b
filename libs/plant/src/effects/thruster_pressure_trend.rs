//! `thruster_pressure_trend`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct ThrusterPressureTrend;

const ABOUT: About = About {
    id: "thruster_pressure_trend",
    sentence: "The supply pressure drifts: all thrusts change steadily with time.",
    place: Place::Thruster,
    index: Index::None,
    parameters: &[Parameter::new("fraction_per_s", "1/s", "relative change of thrust a second, negative is falling")
        .within(-1.0, 1.0)
        .scale(0.002)],
};

impl EffectKind for ThrusterPressureTrend {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[4e-3], &[1e-5])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.supply.trend_per_s = effect.first();
        physics.supply.trend_since_s = effect.onset_s().unwrap_or(0.0);
    }
}
