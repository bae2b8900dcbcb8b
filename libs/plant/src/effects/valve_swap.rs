//! `valve_swap`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::{Prior, Response};

pub(super) struct ValveSwap;

const ABOUT: About = About {
    id: "valve_swap",
    sentence: "Two valve lines are exchanged: each command opens the other valve.",
    place: Place::Thruster,
    index: Index::Thruster,
    parameters: &[Parameter::new("other_index", "", "the other thruster").within(0.0, 1000.0)],
};

impl EffectKind for ValveSwap {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::sized(&[], &[]).responding(Response::Discrete)
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        let Some(own) = effect.index().and_then(|i| i.checked_sub(1)) else {
            return;
        };
        let other = effect.first() as usize;
        let count = physics.thrusters.len();
        if let Some(other) = other.checked_sub(1)
            && own < count
            && other < count
        {
            let line = physics.thrusters[own].line;
            physics.thrusters[own].line = physics.thrusters[other].line;
            physics.thrusters[other].line = line;
        }
    }
}
