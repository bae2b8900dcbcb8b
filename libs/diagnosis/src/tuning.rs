//! How servos that follow datagrams are tuned. The base feels what a servo makes of a datagram, which hangs on its gains far from
//! linearly within what is known of them: they are estimated by Gauss-Newton steps, each about the gains of the one before.

use crate::problem::Problem;
use crate::search::Search;
use crate::servo_response::datagrams;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::Plant;

/// Gauss-Newton steps at the most.
const STEPS: usize = 4;
/// A gain that moves by less than this share of what is known of it stands still.
const STANDS_STILL: f64 = 0.5;
/// No gain is taken to be off by more standard deviations than this.
const FARTHEST: f64 = 4.0;

/// Uncertain values of a plant, of which gains are estimated and all others the plant file's, in stated standard deviations.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tuning(pub(crate) Vec<f64>);

impl Tuning {
    /// The gains that suit runs best without causes; nothing where no datagram commands a joint.
    ///
    /// # Errors
    /// Where the plant's values or effects make a mass or an inertia impossible.
    pub(crate) fn without_causes(plant: &Plant, runs: &[Run]) -> Result<Self, ModelError> {
        let mut tuning = Self::default();
        if runs.iter().all(|run| datagrams(plant, run).is_none()) {
            return Ok(tuning);
        }
        let mut hyper = None;
        for _ in 0..STEPS {
            let problem = Problem::of_bases(plant, runs, &tuning)?;
            if problem.is_empty() {
                break;
            }
            let (found, values) = Search::new(&problem).values_without_causes(hyper.as_deref())?;
            hyper = Some(found);
            let next = Self::of(&problem, &values);
            let stands_still = next.is_near(&tuning);
            tuning = next;
            if stands_still {
                break;
            }
        }
        Ok(tuning)
    }

    /// The gains among estimated values.
    pub(crate) fn of(problem: &Problem, values: &[f64]) -> Self {
        let gain = |is_gain: bool, value: &f64| if is_gain { value.clamp(-FARTHEST, FARTHEST) } else { 0.0 };
        Self(problem.uncertain.iter().zip(values).map(|(u, value)| gain(u.is_gain, value)).collect())
    }

    pub(crate) fn is_near(&self, other: &Self) -> bool {
        let value = |of: &Self, i: usize| of.0.get(i).copied().unwrap_or(0.0);
        (0..self.0.len().max(other.0.len())).all(|i| (value(self, i) - value(other, i)).abs() <= STANDS_STILL)
    }
}
