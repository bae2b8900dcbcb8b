//! Errors of one-step predictions of a plant over what the stated noise alone would give.

use crate::diagnosis::ChannelMisfit;
use crate::problem::Problem;
use fss_estimation::Columns;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::Plant;
use rayon::prelude::*;

/// Rows of a block at its start, over the number of its channels, from which the free initial state is found.
const STARTING_ROWS: usize = 3;

impl Problem {
    /// Of every block, the channels' errors with a plant and its own effects: discrepancies as stated, noise as inferred.
    pub(crate) fn misfit(&self, runs: &[Run], plant: &Plant, hyper: &[f64]) -> Result<Vec<ChannelMisfit>, ModelError> {
        let of_member = |member: &crate::problem::Member| -> Result<Vec<ChannelMisfit>, ModelError> {
            let block = member.block.as_ref();
            let predicted = block.predict(plant, &plant.effects)?;
            let residual: Vec<f64> = block.measured().iter().zip(&predicted).map(|(y, p)| y - p).collect();
            let mut white = Columns::of(&[residual]);
            let inferred = block.hyper_parameters().iter().zip(self.hyper_of(member, hyper));
            let stated: Vec<f64> =
                inferred.map(|(h, value)| if h.strength_of.is_some() { h.stated() } else { *value }).collect();
            block.whiten(&stated, &mut white);
            let white = white.column(0);
            let channels = block.channels();
            let from = STARTING_ROWS * channels.len();
            let of_channel = |channel: usize| {
                let rows = (from.min(white.len())..white.len()).filter(|row| block.channel_of_row()[*row] == channel);
                let rows: Vec<usize> = rows.collect();
                let count = rows.len().max(1) as f64;
                let noise = rows.iter().map(|row| block.noise_of_row()[*row]).sum::<f64>() / count;
                let rms = (rows.iter().map(|row| white[*row] * white[*row]).sum::<f64>() / count).sqrt();
                let residuals = rows.iter().map(|row| (block.time_of_row()[*row], white[*row] * noise)).collect();
                let (channel, run) = (channels[channel].clone(), runs[member.run].name.clone());
                (!rows.is_empty()).then_some(ChannelMisfit { channel, run, rms: rms * noise, noise, residuals })
            };
            Ok((0..channels.len()).filter_map(of_channel).collect())
        };
        let all: Vec<Vec<ChannelMisfit>> = self.members.par_iter().map(of_member).collect::<Result<_, _>>()?;
        Ok(all.into_iter().flatten().collect())
    }
}

/// RMS over noise of all channels together.
pub(crate) fn overall(misfits: &[ChannelMisfit]) -> f64 {
    let count: f64 = misfits.iter().map(|m| m.residuals.len() as f64).sum();
    let sum: f64 = misfits.iter().map(|m| m.ratio().powi(2) * m.residuals.len() as f64).sum();
    if count > 0.0 { (sum / count).sqrt() } else { 1.0 }
}
