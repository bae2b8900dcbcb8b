//! What causes are worth for runs that were kept out of the fit.

use crate::diagnosis::{Cause, overall};
use crate::misfit::ChannelMisfit;
use fss_multibody::ModelError;
use fss_plant::Plant;

/// A prediction that is better by less is the same.
const NO_WORSE: f64 = 1e-3;

/// Misfits of the validation runs under a plant.
type Predicted<'a> = dyn Fn(&Plant) -> Result<Vec<ChannelMisfit>, ModelError> + 'a;

/// Which of the causes help to predict the validation runs: those that make the prediction worse are left out one after the
/// other; none is kept where the plant `file` without any predicts better than `settled` with them.
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
    let nothing_helps = !kept.is_empty() && overall(&misfit(file)?) < (1.0 - NO_WORSE) * ratio;
    Ok(if nothing_helps { Vec::new() } else { kept })
}
