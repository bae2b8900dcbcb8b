//! The answer: where the simulation is wrong, what causes it, the extended model, and what knowing it is worth.

use fss_plant::{Effect, Plant};

/// What the answer comes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// No cause, and no more discrepancy than the plant file states.
    Consistent,
    /// Causes, and no more discrepancy than the plant file states.
    Explained,
    /// Causes, and a discrepancy beside them.
    PartlyExplained,
    /// A discrepancy that no known effect explains.
    Unexplained,
}

impl Verdict {
    /// The word in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Consistent => "consistent",
            Self::Explained => "explained",
            Self::PartlyExplained => "partly_explained",
            Self::Unexplained => "unexplained",
        }
    }

    /// The same where causes were found besides.
    pub(crate) fn with_causes(self) -> Self {
        if self.leaves_something() { Self::PartlyExplained } else { Self::Explained }
    }

    /// Whether a discrepancy remains.
    pub fn leaves_something(self) -> bool {
        matches!(self, Self::PartlyExplained | Self::Unexplained)
    }
}

/// Another cause that could stand in a cause's place.
#[derive(Clone, Debug)]
pub struct Alternative {
    /// The effect, at its own estimate where it has one.
    pub effect: Effect,
    /// Its posterior inclusion probability.
    pub probability: f64,
    /// Whether these data cannot tell the two apart at all.
    pub is_equivalent: bool,
}

/// A cause.
#[derive(Clone, Debug)]
pub struct Cause {
    /// The effect at its posterior mean.
    pub effect: Effect,
    /// Posterior standard deviations of its parameters.
    pub std: Vec<f64>,
    /// Posterior probability that it, or what is equivalent to it, acts.
    pub probability: f64,
    /// Posterior probability that it or any of its alternatives acts: what is asserted.
    pub class_probability: f64,
    /// What could stand in its place.
    pub alternatives: Vec<Alternative>,
    /// Logarithm of the predictive density of the validation runs with it less without it (nats); above 0 it predicts better.
    pub validation_nats: Option<f64>,
    /// The same for each fitted run in turn, predicted from the others, summed (nats).
    pub left_out_nats: f64,
}

impl Cause {
    /// One without a size.
    pub(crate) fn certain(effect: Effect, probability: f64) -> Self {
        let std = vec![0.0; effect.values().len()];
        let alternatives = Vec::new();
        Self {
            effect,
            std,
            probability,
            class_probability: probability,
            alternatives,
            validation_nats: None,
            left_out_nats: 0.0,
        }
    }
}

/// A pulse that was commanded and not delivered.
#[derive(Clone, Debug, PartialEq)]
pub struct MissingPulse {
    /// The run.
    pub run: String,
    /// The thruster that was commanded, from 1.
    pub thruster: usize,
    /// Stamp of the command that begins it, s.
    pub from_s: f64,
    /// Stamp of the command that ends it, s; the end of the run where none does.
    pub to_s: f64,
    /// Posterior probability that it was not delivered.
    pub probability: f64,
}

/// Strength of a structured discrepancy.
#[derive(Clone, Debug, PartialEq)]
pub struct Discrepancy {
    /// What acts, with its unit.
    pub name: String,
    /// As inferred with the asserted causes.
    pub inferred: f64,
    /// As the plant file states it, or the order of magnitude that a good laboratory has.
    pub expected: f64,
}

/// RMS error of a channel in one run over what noise alone would give.
#[derive(Clone, Debug)]
pub struct ChannelMisfit {
    /// `base_x`, `gyro`, `ee_theta`, `current1`, `q1` and so on.
    pub channel: String,
    /// The run.
    pub run: String,
    /// RMS of the errors of one-step predictions, in the channel's unit.
    pub rms: f64,
    /// What the stated noise alone would give.
    pub noise: f64,
    /// Time (s) and error of each sample.
    pub residuals: Vec<(f64, f64)>,
}

impl ChannelMisfit {
    /// RMS over noise; infinite where the plant file states none.
    pub fn ratio(&self) -> f64 {
        if self.noise > 0.0 { self.rms / self.noise } else { f64::INFINITY }
    }
}

/// RMS over noise of all channels of the validation runs; of the fitted ones where there are none.
#[derive(Clone, Copy, Debug)]
pub struct Gain {
    /// With the plant as given, its uncertain values at their posterior mean.
    pub before: f64,
    /// With the extended model.
    pub after: f64,
}

/// The answer.
#[derive(Clone, Debug)]
pub struct Diagnosis {
    /// What there was to say of the records, before anything was concluded from them.
    pub remarks: Vec<String>,
    /// What it comes to.
    pub verdict: Verdict,
    /// What is asserted, most probable first.
    pub causes: Vec<Cause>,
    /// What is probable, but not asserted.
    pub suspects: Vec<Cause>,
    /// Laws in the extended plant that are no known effect's.
    pub laws: Vec<Effect>,
    /// Single pulses that were not delivered, of the fitted and of the validation runs.
    pub missing_pulses: Vec<MissingPulse>,
    /// Probability that no cause acts at all.
    pub probability_of_none: f64,
    /// Inclusion probabilities of all that the search went on with, most probable first.
    pub inclusion: Vec<(Effect, f64)>,
    /// Strengths of the structured discrepancy.
    pub discrepancy: Vec<Discrepancy>,
    /// Share of its typical size by which a cause varies from run to run.
    pub run_to_run: f64,
    /// Misfit of the runs with the plant as given.
    pub before: Vec<ChannelMisfit>,
    /// Misfit of the runs with the extended model.
    pub after: Vec<ChannelMisfit>,
    /// The same of the validation runs.
    pub validation_before: Vec<ChannelMisfit>,
    /// The same of the validation runs with the extended model.
    pub validation_after: Vec<ChannelMisfit>,
    /// What the extension gains.
    pub gain: Gain,
    /// Uncertain values: name, posterior mean in stated standard deviations.
    pub settled: Vec<(String, f64)>,
    /// The plant with its uncertain values at their posterior mean, the asserted causes, and the laws.
    pub extended: Plant,
}
