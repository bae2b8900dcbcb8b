//! What of a plant's effects acts: its values with these built in.

use crate::effect::Effect;
use crate::file::Plant;
use crate::physics::Physics;
use fss_multibody::{Model, ModelError};

impl Physics {
    /// The plant with all of its effects that act at `t_s`.
    pub fn at(plant: &Plant, t_s: f64) -> Self {
        Self::with(plant, plant.effects.iter().filter(|e| e.is_active(t_s)))
    }

    /// The plant without any effect.
    pub fn nominal(plant: &Plant) -> Self {
        Self::with(plant, [])
    }

    /// The plant's nominal values with exactly these effects.
    pub fn with<'a>(plant: &Plant, effects: impl IntoIterator<Item = &'a Effect>) -> Self {
        let mut physics = Self::of_values(plant);
        for effect in effects {
            effect.kind().act(effect, &mut physics);
        }
        physics
    }

    /// The plant's nominal values with `effects`, between the onsets of these: each with the time from which it holds.
    pub fn stages(plant: &Plant, effects: &[Effect]) -> Vec<(f64, Self)> {
        let mut starts: Vec<f64> = effects.iter().filter_map(Effect::onset_s).collect();
        starts.push(0.0);
        starts.sort_by(f64::total_cmp);
        starts.dedup();
        let active = |t: f64| Self::with(plant, effects.iter().filter(move |e| e.is_active(t)));
        starts.into_iter().map(|t| (t, active(t))).collect()
    }
}

impl Plant {
    /// The mechanism with the effects that the plant has from the start.
    ///
    /// # Errors
    /// When effects make a mass or an inertia impossible.
    pub fn model(&self) -> Result<Model, ModelError> {
        Physics::at(self, 0.0).model(0.0)
    }
}
