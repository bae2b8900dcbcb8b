//! `thruster_leak`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct ThrusterLeak;

const ABOUT: About = About {
    id: "thruster_leak",
    sentence: "A closed valve leaks and pushes all the time; the whole thrust is stuck open.",
    place: Place::Thruster,
    index: Index::Thruster,
    parameters: &[Parameter::new("thrust_N", "N", "thrust while closed").within(0.0, 100.0).scale(0.005)],
};

impl EffectKind for ThrusterLeak {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        let thrust = plant.typical_thrust_n();
        Prior::sized(&[0.1 * thrust], &[1e-3 * thrust])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        for i in effect.targets(physics.thrusters.len()) {
            physics.thrusters[i].leak_n = effect.first();
        }
    }
}
