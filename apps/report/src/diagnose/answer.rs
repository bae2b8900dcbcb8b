//! The answer for a machine, `fss-diagnosis/1`.

use super::read::ONSET;
use fss_diagnosis::diagnosis::{Cause, Diagnosis, MissingPulse};
use fss_plant::Effect;
use serde::Serialize;
use std::collections::BTreeMap;

#[derive(Serialize)]
pub(super) struct Answer {
    format: &'static str,
    verdict: &'static str,
    causes: Vec<CauseAnswer>,
    misfit: Vec<Misfit>,
    gain: Gain,
    extended_model: String,
    /// What was left out of the records, and what is not as the plant file says of them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    remarks: Vec<String>,
    /// What happened once.
    events: Vec<Event>,
    /// Probable causes that are not asserted.
    suspects: Vec<CauseAnswer>,
    posterior: Posterior,
    /// Strengths of the structured discrepancy.
    discrepancy: Vec<DiscrepancyAnswer>,
    #[serde(skip_serializing_if = "Option::is_none")]
    unexplained: Option<Unexplained>,
    /// Laws in the extended model that are no known effect's.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    empirical: Vec<Effect>,
}

#[derive(Serialize)]
struct Event {
    kind: &'static str,
    run: String,
    /// The thruster that was commanded, from 1.
    thruster: usize,
    from_s: f64,
    to_s: f64,
    probability: f64,
}

#[derive(Serialize)]
struct Unexplained {
    mean_square: f64,
    channel: Option<String>,
    run: Option<String>,
    depends_on: Vec<Dependence>,
}

#[derive(Serialize)]
struct Dependence {
    description: String,
    share: f64,
}

#[derive(Serialize)]
struct Posterior {
    /// Probability that no cause acts.
    none: f64,
    /// Share of its typical size by which a cause varies from run to run.
    run_to_run: f64,
    /// Inclusion probabilities.
    inclusion: Vec<AlternativeAnswer>,
}

#[derive(Serialize)]
struct DiscrepancyAnswer {
    name: String,
    inferred: f64,
    expected: f64,
}

#[derive(Serialize)]
struct CauseAnswer {
    #[serde(flatten)]
    named: Named,
    /// That it, or what is equivalent to it, acts.
    probability: f64,
    /// That it or any of its alternatives acts.
    class_probability: f64,
    parameters: BTreeMap<&'static str, Parameter>,
    alternatives: Vec<AlternativeAnswer>,
    /// What it adds to the logarithm of the predictive density of the validation runs.
    #[serde(skip_serializing_if = "Option::is_none")]
    validation_nats: Option<f64>,
    /// The same of each fitted run, predicted from the others.
    left_out_nats: f64,
}

#[derive(Serialize)]
struct Named {
    effect: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    index: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    channel: Option<String>,
}

#[derive(Serialize)]
struct Parameter {
    value: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    std: Option<f64>,
}

#[derive(Serialize)]
struct AlternativeAnswer {
    #[serde(flatten)]
    named: Named,
    probability: f64,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    equivalent: bool,
    parameters: BTreeMap<&'static str, Parameter>,
}

#[derive(Serialize)]
struct Misfit {
    channel: String,
    run: String,
    rms: f64,
    noise: f64,
    ratio: f64,
}

#[derive(Serialize)]
struct Gain {
    ratio_before: f64,
    ratio_after: f64,
    noise_floor: f64,
}

impl Answer {
    pub(super) fn of(diagnosis: &Diagnosis, extended: &str) -> Self {
        let misfits = diagnosis.before.iter().chain(&diagnosis.validation_before);
        Self {
            format: "fss-diagnosis/1",
            verdict: diagnosis.verdict.name(),
            causes: diagnosis.causes.iter().map(cause).collect(),
            misfit: misfits
                .map(|m| Misfit {
                    channel: m.channel.clone(),
                    run: m.run.clone(),
                    rms: m.rms,
                    noise: m.noise,
                    ratio: m.ratio(),
                })
                .collect(),
            gain: Gain { ratio_before: diagnosis.gain.before, ratio_after: diagnosis.gain.after, noise_floor: 1.0 },
            extended_model: extended.to_owned(),
            events: diagnosis.missing_pulses.iter().map(event).collect(),
            suspects: diagnosis.suspects.iter().map(cause).collect(),
            remarks: diagnosis.remarks.clone(),
            posterior: Posterior {
                none: diagnosis.probability_of_none,
                run_to_run: diagnosis.run_to_run,
                inclusion: diagnosis.inclusion.iter().map(|(effect, p)| other(effect, *p, false)).collect(),
            },
            discrepancy: diagnosis
                .discrepancy
                .iter()
                .map(|d| DiscrepancyAnswer { name: d.name.clone(), inferred: d.inferred, expected: d.expected })
                .collect(),
            unexplained: diagnosis.remainder.as_ref().map(|left| Unexplained {
                mean_square: left.mean_square,
                channel: left.worst.as_ref().map(|w| w.0.clone()),
                run: left.worst.as_ref().map(|w| w.1.clone()),
                depends_on: left
                    .depends_on
                    .iter()
                    .map(|(description, share)| Dependence { description: description.clone(), share: *share })
                    .collect(),
            }),
            empirical: diagnosis.laws.clone(),
        }
    }
}

fn event(pulse: &MissingPulse) -> Event {
    Event {
        kind: "pulse_not_delivered",
        run: pulse.run.clone(),
        thruster: pulse.thruster,
        from_s: pulse.from_s,
        to_s: pulse.to_s,
        probability: pulse.probability,
    }
}

fn other(effect: &Effect, probability: f64, equivalent: bool) -> AlternativeAnswer {
    AlternativeAnswer {
        named: named(effect),
        probability,
        equivalent,
        parameters: values(effect).map(without_std).chain(onset(effect)).collect(),
    }
}

fn cause(cause: &Cause) -> CauseAnswer {
    // An exchange of wires has no size, and so no deviation.
    let std = |i: usize| Some(cause.std.get(i).copied().unwrap_or(0.0));
    let parameter = |(i, (name, value)): (usize, (&'static str, f64))| (name, Parameter { value, std: std(i) });
    CauseAnswer {
        named: named(&cause.effect),
        probability: cause.probability,
        class_probability: cause.class_probability,
        parameters: values(&cause.effect).enumerate().map(parameter).chain(onset(&cause.effect)).collect(),
        alternatives: cause.alternatives.iter().map(|a| other(&a.effect, a.probability, a.is_equivalent)).collect(),
        validation_nats: cause.validation_nats,
        left_out_nats: cause.left_out_nats,
    }
}

fn named(effect: &Effect) -> Named {
    Named { effect: effect.id(), index: effect.index(), channel: effect.channel().map(str::to_owned) }
}

fn without_std((name, value): (&'static str, f64)) -> (&'static str, Parameter) {
    (name, Parameter { value, std: None })
}

/// When the effect begins, where that is during a run.
fn onset(effect: &Effect) -> Option<(&'static str, Parameter)> {
    effect.onset_s().map(|onset_s| without_std((ONSET, onset_s)))
}

fn values(effect: &Effect) -> impl Iterator<Item = (&'static str, f64)> {
    effect.about().parameters.iter().zip(effect.values()).map(|(p, v)| (p.name, *v))
}
