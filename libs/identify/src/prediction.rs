//! What causes are worth for runs that were kept out of the fit.

use crate::diagnosis::overall;
use crate::misfit::ChannelMisfit;
use crate::verdict::{ALL_EXPLAINED, Cause};
use fss_multibody::ModelError;
use fss_plant::Plant;

/// A prediction that is better by less is the same.
const NO_WORSE: f64 = 1e-3;
/// What causes must explain of validation runs that are far from noise.
const LEAST_SHARE: f64 = 0.12;

/// Misfits of the validation runs under a plant.
type Predicted<'a> = dyn Fn(&Plant) -> Result<Vec<ChannelMisfit>, ModelError> + 'a;

/// Which of the causes help to predict the validation runs: those that make the prediction worse are left out one after the
/// other; none is kept where the plant `file` without any predicts better than `settled` with them, or far off noise and nearly
/// as well.
pub(crate) fn predictive(
    file: &Plant,
    settled: &Plant,
    causes: &[Cause],
    misfit: &Predicted<'_>,
) -> Result<Vec<usize>, ModelError> {
    let with = |kept: &[usize]| -> Result<f64, ModelError> {
        let mut plant = settled.clone();
        plant.effects.extend(kept.iter().map(|i| causes[*i].effect.clone()));
        Ok(overall(&misfit(&plant)?))
    };
    let mut kept: Vec<usize> = (0..causes.len()).collect();
    let mut ratio = with(&kept)?;
    while !kept.is_empty() {
        let mut best = (None, (1.0 - NO_WORSE) * ratio);
        for i in 0..kept.len() {
            let mut fewer = kept.clone();
            fewer.remove(i);
            let now = with(&fewer)?;
            if now < best.1 {
                best = (Some(i), now);
            }
        }
        let (Some(idle), now) = best else { break };
        kept.remove(idle);
        ratio = now;
    }
    if kept.is_empty() {
        return Ok(kept);
    }
    let without = overall(&misfit(file)?);
    let nothing_helps = without < (1.0 - NO_WORSE) * ratio || explains_nothing(without, ratio);
    Ok(if nothing_helps { Vec::new() } else { kept })
}

/// Whether much is wrong with a prediction, and causes make next to nothing of it better. Ratios are RMS over noise.
fn explains_nothing(without: f64, with: f64) -> bool {
    let share = (without.powi(2) - with.powi(2)) / (without.powi(2) - 1.0);
    with.powi(2) > ALL_EXPLAINED && share < LEAST_SHARE
}

#[cfg(test)]
mod tests {
    use super::explains_nothing;

    #[test]
    fn what_leaves_a_bad_prediction_as_bad_explains_nothing() {
        assert!(explains_nothing(1.42, 1.41));
        assert!(!explains_nothing(2.1, 1.7), "half of it is something");
        assert!(!explains_nothing(0.78, 0.77), "where all is noise there is nothing to explain");
        assert!(!explains_nothing(9.0, 0.9));
    }
}
