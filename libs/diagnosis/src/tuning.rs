//! How servos that follow datagrams are tuned. The base feels what a servo makes of a datagram, which hangs on its gains far from
//! linearly within what is known of them: a search that finds other gains is repeated about these.

use crate::uncertain::Uncertain;

/// A gain that moves by less than this share of what is known of it stands still.
const STANDS_STILL: f64 = 0.5;
/// Within so many standard deviations a servo's answer changes in proportion to a gain.
const ALIKE: f64 = 1.0;
/// No gain is taken to be off by more standard deviations than this.
const FARTHEST: f64 = 4.0;

/// Uncertain values of a plant, of which gains are estimated and all others the plant file's, in stated standard deviations; missing
/// ones are the plant file's.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tuning(Vec<f64>);

impl Tuning {
    /// The gains among estimated values.
    pub(crate) fn of(uncertain: &[Uncertain], values: &[f64]) -> Self {
        let gain = |is_gain: bool, value: &f64| if is_gain { value.clamp(-FARTHEST, FARTHEST) } else { 0.0 };
        Self(uncertain.iter().zip(values).map(|(u, value)| gain(u.is_gain, value)).collect())
    }

    /// How far an uncertain value is from the plant file's.
    pub(crate) fn by(&self, value: usize) -> f64 {
        self.0.get(value).copied().unwrap_or(0.0)
    }

    /// Whether a gain is so much alike in both that what a change of it does is.
    pub(crate) fn is_like(&self, other: &Self, value: usize) -> bool {
        (self.by(value) - other.by(value)).abs() <= ALIKE
    }

    pub(crate) fn is_near(&self, other: &Self) -> bool {
        (0..self.0.len().max(other.0.len())).all(|i| (self.by(i) - other.by(i)).abs() <= STANDS_STILL)
    }
}
