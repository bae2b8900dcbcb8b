//! What is tried: a plant with effects, and how a measured run is simulated under it.

use fss_multibody::ModelError;
use fss_plant::{Effect, Plant, Rollout};

/// A plant under trial.
#[derive(Clone, Debug)]
pub(crate) struct Trial {
    /// Nominal values; its own list of effects is not looked at.
    pub(crate) plant: Plant,
    /// What acts beyond them.
    pub(crate) effects: Vec<Effect>,
}

impl Trial {
    /// The plant as its file says.
    pub(crate) fn of(plant: &Plant) -> Self {
        Self { plant: plant.clone(), effects: plant.effects.clone() }
    }

    /// The same with one effect more.
    pub(crate) fn with(&self, effect: &Effect) -> Self {
        let mut more = self.clone();
        more.effects.push(effect.clone());
        more
    }

    pub(crate) fn rollout(&self) -> Result<Rollout, ModelError> {
        Rollout::with(&self.plant, &self.effects)
    }

    /// The plant file that says all this.
    pub(crate) fn to_plant(&self) -> Plant {
        Plant { effects: self.effects.clone(), ..self.plant.clone() }
    }
}

/// A row of residuals before whitening: what was measured less what is simulated.
#[derive(Clone, Debug)]
pub(crate) struct RowInfo {
    /// Index of its channel in [`crate::floating::Record::channels`].
    pub(crate) channel: usize,
    /// Time, s.
    pub(crate) t_s: f64,
    /// Variance that noise alone gives.
    pub(crate) variance: f64,
}

/// One window of a run.
pub(crate) struct Span {
    /// First and last time, s.
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
    /// A first guess of the window's own unknowns.
    pub(crate) guess: Vec<f64>,
    /// Steps for differencing with respect to them.
    pub(crate) steps: Vec<f64>,
    /// How many of them, the last ones, are standard normal a priori; nothing is known of the others.
    pub(crate) prior_count: usize,
    /// The rows.
    pub(crate) rows: Vec<RowInfo>,
    /// Each whitened row as a sum of rows with weights, and the channel that it belongs to.
    pub(crate) whitening: Vec<Whitened>,
}

/// A whitened row.
pub(crate) struct Whitened {
    /// Index of its channel.
    pub(crate) channel: usize,
    /// Rows and weights.
    pub(crate) sum: Vec<(u32, f64)>,
}

impl Span {
    /// Rows made white: variance 1 each and independent, where the plant is as simulated.
    pub(crate) fn whiten(&self, rows: &[f64]) -> Vec<f64> {
        self.whitening.iter().map(|w| w.sum.iter().map(|(row, weight)| weight * rows[*row as usize]).sum()).collect()
    }
}
