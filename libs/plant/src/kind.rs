//! What a kind of effect is: its description, its nominal values, its prior, its action.

use crate::effect::Effect;
use crate::file::Plant;
use crate::physics::Physics;
use crate::prior::Prior;

pub(crate) use crate::about::alone;
pub use crate::about::{About, Index, MAX_PARAMETERS, Parameter, Place};

impl Index {
    /// How many the plant has; 0 where the effect is there once.
    pub fn count(self, plant: &Plant) -> usize {
        match self {
            Self::None | Self::Channel => 0,
            Self::Thruster => plant.thrusters.len(),
            Self::Link | Self::Joint => plant.links.len(),
        }
    }
}

/// A kind of effect: one file in `src/effects`, one line in the catalogue.
pub trait EffectKind: Sync {
    /// Name, sentence, place, index and parameters.
    fn about(&self) -> &'static About;

    /// Values at which the effect changes nothing, in the order of the parameters. `index` counts
    /// from 0; without one, the first.
    fn nominal(&self, plant: &Plant, index: Option<usize>) -> [f64; MAX_PARAMETERS] {
        let _ = (plant, index);
        let mut values = [0.0; MAX_PARAMETERS];
        for (value, parameter) in values.iter_mut().zip(self.about().parameters) {
            *value = parameter.nominal.unwrap_or(0.0);
        }
        values
    }

    /// What is believed of it before any data. `index` counts from 0; without one, all.
    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = (plant, index);
        Prior::of(self.about().parameters)
    }

    /// Builds the effect into what really acts.
    fn act(&self, effect: &Effect, physics: &mut Physics);
}
