//! How servos that follow datagrams are tuned. The base feels what a servo makes of a datagram, which hangs on its gains and on the dry
//! friction that it works against, far from linearly within what is known of them: a search that finds others is repeated about these.

use crate::uncertain::{OfServo, Uncertain};

/// A value that moves by less than this share of what is known of it stands still.
const STANDS_STILL: f64 = 0.5;
/// Within so many standard deviations a servo's answer changes in proportion to a value.
const ALIKE: f64 = 1.0;
/// No value is taken to be off by more standard deviations than this.
const FARTHEST: f64 = 4.0;

/// Uncertain values of a plant, of which those of servos are estimated and all others the plant file's, in stated standard deviations;
/// missing ones are the plant file's.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tuning(Vec<f64>);

impl Tuning {
    /// Gains among estimated values, and dry frictions as the joints' own channels tell them: what else acts on a base is taken for friction
    /// there.
    pub(crate) fn of(uncertain: &[Uncertain], values: &[f64], in_joints: &[f64]) -> Self {
        let tuned = |(i, u): (usize, &Uncertain)| {
            let values = match u.of_servo {
                Some(OfServo::Gain) => values,
                Some(OfServo::DryFriction) => in_joints,
                None => &[],
            };
            values.get(i).map_or(0.0, |value| value.clamp(-FARTHEST, FARTHEST))
        };
        Self(uncertain.iter().enumerate().map(tuned).collect())
    }

    /// How far an uncertain value is from the plant file's.
    pub(crate) fn by(&self, value: usize) -> f64 {
        self.0.get(value).copied().unwrap_or(0.0)
    }

    /// Whether a value is so much alike in both that what a change of it does is.
    pub(crate) fn is_like(&self, other: &Self, value: usize) -> bool {
        (self.by(value) - other.by(value)).abs() <= ALIKE
    }

    pub(crate) fn is_near(&self, other: &Self) -> bool {
        (0..self.0.len().max(other.0.len())).all(|i| (self.by(i) - other.by(i)).abs() <= STANDS_STILL)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::uncertain::uncertain;
    use fss_plant::Plant;

    #[test]
    fn gains_are_taken_from_all_channels_and_dry_frictions_from_those_of_the_joints_and_a_mass_is_the_plant_files() {
        let mut plant = Plant::default_laboratory().unwrap();
        let stated = plant.uncertainty.get_or_insert_default();
        (stated.base_mass_kg, stated.coulomb_friction_n_m) = (0.1, 0.01);
        let values = uncertain(&plant, true);
        let tuning = Tuning::of(&values, &vec![1.5; values.len()], &vec![-7.0; values.len()]);
        for (i, value) in values.iter().enumerate() {
            let expected = match value.of_servo {
                Some(OfServo::Gain) => 1.5,
                Some(OfServo::DryFriction) => -FARTHEST,
                None => 0.0,
            };
            assert_eq!(tuning.by(i), expected, "{}", value.name);
        }
        let count = |what: OfServo| values.iter().filter(|value| value.of_servo == Some(what)).count();
        assert_eq!((count(OfServo::Gain), count(OfServo::DryFriction)), (3 * plant.links.len(), plant.links.len()));
    }
}
