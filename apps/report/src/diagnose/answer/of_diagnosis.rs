//! The answer of a diagnosis.

use super::{
    Alternative, Answer, Cause, Discrepancy, EffectName, Event, Gain, Misfit, ONSET, Parameter, Parameters, Posterior,
};
use fss_diagnosis::diagnosis::{self, Diagnosis, MissingPulse};
use fss_plant::Effect;

impl Answer {
    /// Of a diagnosis whose extended plant is written to a file of this name.
    pub fn of(diagnosis: &Diagnosis, extended_model: &str) -> Self {
        let misfits = diagnosis.before.iter().chain(&diagnosis.validation_before);
        Self {
            format: "fss-diagnosis/1".to_owned(),
            verdict: diagnosis.verdict.name().to_owned(),
            causes: diagnosis.causes.iter().map(Cause::of).collect(),
            misfit: misfits.map(Misfit::of).collect(),
            gain: Gain::of(diagnosis.gain),
            extended_model: extended_model.to_owned(),
            remarks: diagnosis.remarks.clone(),
            events: diagnosis.missing_pulses.iter().map(Event::of).collect(),
            suspects: diagnosis.suspects.iter().map(Cause::of).collect(),
            posterior: Posterior::of(diagnosis),
            discrepancy: diagnosis.discrepancy.iter().map(Discrepancy::of).collect(),
            empirical: diagnosis.laws.clone(),
        }
    }
}

impl EffectName {
    fn of(effect: &Effect) -> Self {
        let channel = effect.channel().map(str::to_owned);
        Self { effect: effect.id().to_owned(), index: effect.index(), channel }
    }
}

/// An effect's values with the standard deviation of each, and when it begins.
fn parameters(effect: &Effect, std: impl Fn(usize) -> Option<f64>) -> Parameters {
    let names = effect.about().parameters.iter().map(|p| p.name.to_owned());
    let values = effect.values().iter().enumerate().map(|(i, value)| Parameter { value: *value, std: std(i) });
    let onset = effect.onset_s().map(|value| (ONSET.to_owned(), Parameter { value, std: None }));
    names.zip(values).chain(onset).collect()
}

impl Cause {
    fn of(cause: &diagnosis::Cause) -> Self {
        let alternatives = cause.alternatives.iter();
        Self {
            name: EffectName::of(&cause.effect),
            probability: cause.probability,
            class_probability: cause.class_probability,
            // An exchange of wires has no size, and so no deviation.
            parameters: parameters(&cause.effect, |i| Some(cause.std.get(i).copied().unwrap_or(0.0))),
            alternatives: alternatives.map(|a| Alternative::of(&a.effect, a.probability, a.is_equivalent)).collect(),
            validation_nats: cause.validation_nats,
            left_out_nats: cause.left_out_nats,
        }
    }
}

impl Alternative {
    fn of(effect: &Effect, probability: f64, equivalent: bool) -> Self {
        Self { name: EffectName::of(effect), probability, equivalent, parameters: parameters(effect, |_| None) }
    }
}

impl Misfit {
    fn of(m: &diagnosis::ChannelMisfit) -> Self {
        Self { channel: m.channel.clone(), run: m.run.clone(), rms: m.rms, noise: m.noise, ratio: m.ratio() }
    }
}

impl Gain {
    fn of(gain: diagnosis::Gain) -> Self {
        Self { ratio_before: Some(gain.before), ratio_after: Some(gain.after), noise_floor: 1.0 }
    }
}

impl Posterior {
    fn of(diagnosis: &Diagnosis) -> Self {
        let inclusion = diagnosis.inclusion.iter().map(|(effect, p)| Alternative::of(effect, *p, false));
        Self { none: diagnosis.probability_of_none, run_to_run: diagnosis.run_to_run, inclusion: inclusion.collect() }
    }
}

impl Discrepancy {
    fn of(d: &diagnosis::Discrepancy) -> Self {
        Self { name: d.name.clone(), inferred: d.inferred, expected: d.expected }
    }
}

impl Event {
    fn of(pulse: &MissingPulse) -> Self {
        Self {
            kind: "pulse_not_delivered".to_owned(),
            run: pulse.run.clone(),
            thruster: pulse.thruster,
            from_s: pulse.from_s,
            to_s: pulse.to_s,
            probability: pulse.probability,
        }
    }
}
