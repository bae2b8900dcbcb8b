//! The two engines of the diagnosis. Marginal likelihoods replace the windowed contest where they have been shown to be better.

use clap::ValueEnum;
use fss_diagnosis::diagnosis::{Alternative, Cause, Diagnosis, Remainder};
use fss_experiments::measured::Run;
use fss_identify::diagnosis as windowed;
use fss_plant::Plant;
use miette::{IntoDiagnostic, Result, miette};

/// How causes are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Engine {
    /// In windows for logs of `fss run` of floating bases, by evidence for everything else.
    #[default]
    Auto,
    /// By fits of the motion in windows, and rules of what may be told: of logs of `fss run` of floating bases.
    Windowed,
    /// By their marginal likelihood, with a structured discrepancy of inferred strength.
    Evidence,
}

impl Engine {
    /// The engine for runs of a plant, all of them logs or not.
    ///
    /// # Errors
    /// Where the windowed engine is asked for what it does not read.
    fn chosen(self, plant: &Plant, of_logs: bool) -> Result<Self> {
        let is_clamped = plant.base.clamped;
        match self {
            Self::Auto if of_logs && !is_clamped => Ok(Self::Windowed),
            Self::Auto => Ok(Self::Evidence),
            Self::Windowed if is_clamped => Err(not_windowed("the base of the plant file is clamped")),
            Self::Windowed if !of_logs => Err(not_windowed("not all of the runs are logs")),
            named => Ok(named),
        }
    }
}

fn not_windowed(why: &str) -> miette::Report {
    miette!(
        help = "leave --engine out, or take --engine evidence",
        "--engine windowed reads logs of `fss run` of floating bases, but {why}"
    )
}

/// Diagnoses runs of a plant, all of them logs or not.
///
/// # Errors
/// Where the engine does not read such runs, or the plant's values or effects make a mass or an inertia impossible.
pub(super) fn diagnose(
    (engine, of_logs): (Engine, bool),
    plant: &Plant,
    runs: &[Run],
    validation: &[Run],
    say: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis> {
    match engine.chosen(plant, of_logs)? {
        Engine::Windowed | Engine::Auto => {
            windowed::diagnose(plant, runs, validation, say).map(of_windowed).into_diagnostic()
        }
        Engine::Evidence => fss_diagnosis::diagnose(plant, runs, validation, say).into_diagnostic(),
    }
}

fn of_windowed(answer: windowed::Diagnosis) -> Diagnosis {
    let mismatches = answer.input_mismatch.iter().map(ToString::to_string);
    let share = |r: &windowed::Ranked| (r.effect.clone(), r.share);
    Diagnosis {
        remarks: answer.remarks.iter().cloned().chain(mismatches).collect(),
        verdict: answer.verdict,
        probability_of_none: if answer.causes.is_empty() { 1.0 } else { 0.0 },
        causes: answer.causes.into_iter().map(cause).collect(),
        suspects: answer.suspects.into_iter().map(cause).collect(),
        laws: answer.empirical,
        missing_pulses: Vec::new(),
        inclusion: answer.ranking.iter().map(share).collect(),
        discrepancy: Vec::new(),
        remainder: answer.unexplained.as_ref().map(|u| Remainder {
            mean_square: u.mean_square,
            worst: u.worst.as_ref().map(|w| (w.0.clone(), w.1.clone())),
            depends_on: u.depends_on.clone(),
        }),
        run_to_run: 0.0,
        before: answer.before,
        after: answer.after,
        validation_before: answer.validation_before,
        validation_after: answer.validation_after,
        gain: answer.gain,
        settled: answer.settled,
        extended: answer.extended,
    }
}

fn cause(cause: windowed::Cause) -> Cause {
    let others: f64 = cause.alternatives.iter().map(|a| a.probability).sum();
    let other =
        |a: windowed::Alternative| Alternative { effect: a.effect, probability: a.probability, is_equivalent: false };
    Cause {
        effect: cause.effect,
        std: cause.std,
        probability: cause.probability,
        class_probability: (cause.probability + others).min(1.0),
        alternatives: cause.alternatives.into_iter().map(other).collect(),
        validation_nats: None,
        left_out_nats: 0.0,
    }
}
