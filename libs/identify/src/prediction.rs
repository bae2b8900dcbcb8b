//! What a model is worth for runs that were kept out of the fit.

use crate::misfit::of_run;
use crate::verdict::{ALL_EXPLAINED, Cause};
use fss_diagnosis::diagnosis::ChannelMisfit;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::Plant;
use rayon::prelude::*;

/// A prediction that is better by less is the same.
const NO_WORSE: f64 = 1e-3;
/// What causes must explain of validation runs that are far from noise.
const LEAST_SHARE: f64 = 0.12;

/// Runs that a model was fitted to, and runs kept for judging it.
#[derive(Clone, Copy)]
pub(crate) struct Runs<'a> {
    pub(crate) fitted: &'a [Run],
    pub(crate) validation: &'a [Run],
}

/// What a model is measured by.
pub(crate) struct Data<'a> {
    /// As they were measured.
    pub(crate) as_read: Runs<'a>,
    /// The same, but that the arm moves as the masses found let it, where they do.
    pub(crate) carried_out: Runs<'a>,
}

/// How far runs are from a model.
pub(crate) struct Told {
    pub(crate) fitted: Vec<ChannelMisfit>,
    pub(crate) validation: Vec<ChannelMisfit>,
}

impl Told {
    /// Of the runs that judge the model: those kept for it, or the fitted ones where there are none.
    pub(crate) fn judged(&self) -> &[ChannelMisfit] {
        if self.validation.is_empty() { &self.fitted } else { &self.validation }
    }
}

impl Data<'_> {
    /// How far all runs are from a plant.
    pub(crate) fn told(&self, plant: &Plant) -> Result<Told, ModelError> {
        told_of(plant, self.carried_out)
    }

    /// The same of the runs as they were measured.
    pub(crate) fn told_as_read(&self, plant: &Plant) -> Result<Told, ModelError> {
        told_of(plant, self.as_read)
    }

    /// How far the runs kept for it are from a plant, channel by channel.
    pub(crate) fn predicted(&self, plant: &Plant) -> Result<Vec<ChannelMisfit>, ModelError> {
        misfit(plant, self.carried_out.validation)
    }
}

fn told_of(plant: &Plant, runs: Runs) -> Result<Told, ModelError> {
    Ok(Told { fitted: misfit(plant, runs.fitted)?, validation: misfit(plant, runs.validation)? })
}

fn misfit(plant: &Plant, runs: &[Run]) -> Result<Vec<ChannelMisfit>, ModelError> {
    let all: Result<Vec<_>, _> = runs.par_iter().map(|run| of_run(plant, run)).collect();
    Ok(all?.into_iter().flatten().collect())
}

/// RMS of the ratios of all channels; those of unknown noise decide nothing.
pub(crate) fn overall(misfits: &[ChannelMisfit]) -> f64 {
    let ratios: Vec<f64> = misfits.iter().map(ChannelMisfit::ratio).filter(|r| r.is_finite()).collect();
    (ratios.iter().map(|r| r * r).sum::<f64>() / ratios.len().max(1) as f64).sqrt()
}

/// Which of the causes help to predict the validation runs: those that make the prediction worse are left out one after the
/// other; none is kept where the plant `file` without any predicts better than `settled` with them, or far off noise and nearly
/// as well.
pub(crate) fn predictive(
    file: &Plant,
    settled: &Plant,
    causes: &[Cause],
    data: &Data,
) -> Result<Vec<usize>, ModelError> {
    let with = |kept: &[usize]| -> Result<f64, ModelError> {
        let mut plant = settled.clone();
        plant.effects.extend(kept.iter().map(|i| causes[*i].effect.clone()));
        Ok(overall(&data.predicted(&plant)?))
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
    let without = overall(&data.predicted(file)?);
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
