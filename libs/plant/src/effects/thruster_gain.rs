//! `thruster_gain`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct ThrusterGain;

const ABOUT: About = About {
    id: "thruster_gain",
    sentence: "A thruster is weaker or stronger than the plant file says; 0 is stuck shut.",
    place: Place::Thruster,
    index: Index::Thruster,
    parameters: &[Parameter::new("scale", "", "real thrust over nominal thrust")
        .nominal(1.0)
        .within(0.0, 10.0)
        .scale(0.1)],
};

impl EffectKind for ThrusterGain {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[0.2], &[3e-3]).with_points(&[0.0])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.thrusters.len()) {
            physics.thrusters[i].curve_n = physics.thrusters[i].curve_n.map(|c| c * effect.first());
        }
    }
}
