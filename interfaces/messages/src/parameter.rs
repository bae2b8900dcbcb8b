//! Parameters that can be tuned in flight: what they are, and how a service takes them.
//!
//! [`PARAMETERS`] is the one table of names, units, defaults and bounds. The ground says on `/parameters/command` which
//! values it wants; each service takes its own at the start of a step, refuses what lies outside the bounds, says either as
//! an event, and tells on `/parameters/state` what is in force. All of that is in the log, so a replay tunes as the flight did.

use crate::{Event, PARAMETERS, Parameters, text};

/// How often a service tells its parameters where none changes, ns.
const REPORT_PERIOD_NS: u64 = 1_000_000_000;

/// One parameter.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    /// Its name, with the unit: a field of [`Parameters`].
    pub name: &'static str,
    /// What it means.
    pub doc: &'static str,
    /// Whose it is.
    pub service: &'static str,
    /// Its value where nobody tunes it.
    pub default: f64,
    /// Its smallest value.
    pub least: f64,
    /// Its largest value.
    pub most: f64,
    /// Its value in a sample.
    pub get: fn(&Parameters) -> f64,
    /// Sets its value in a sample.
    pub set: fn(&mut Parameters, f64),
}

impl Parameter {
    /// The parameter of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        PARAMETERS.iter().find(|parameter| parameter.name == name)
    }

    /// Whether it may have this value.
    pub fn allows(&self, value: f64) -> bool {
        (self.least..=self.most).contains(&value)
    }
}

impl Parameters {
    /// A sample that says nothing of any parameter.
    pub fn silent() -> Self {
        let mut values = Self::default();
        for parameter in PARAMETERS {
            (parameter.set)(&mut values, f64::NAN);
        }
        values
    }

    /// All at their defaults.
    pub fn defaults() -> Self {
        let mut values = Self::default();
        for parameter in PARAMETERS {
            (parameter.set)(&mut values, parameter.default);
        }
        values
    }
}

/// A service's own parameters, as they are in force.
#[derive(Clone, Debug)]
pub struct Tuning {
    service: &'static str,
    in_force: Parameters,
    /// What was last commanded, so that each word is answered once.
    heard: Parameters,
    reported_ns: Option<u64>,
}

impl Tuning {
    /// Of a service that begins with these values; of those that are not its own it says nothing.
    pub fn new(service: &'static str, values: &Parameters) -> Self {
        let mut in_force = Parameters { service: text(service), ..Parameters::silent() };
        for parameter in own(service) {
            (parameter.set)(&mut in_force, (parameter.get)(values));
        }
        Self { service, in_force, heard: Parameters::silent(), reported_ns: None }
    }

    /// Takes what is commanded of the service's own parameters and lies within their bounds; says each change and each
    /// refusal. The values in force where any has changed.
    pub fn follow(&mut self, now_ns: u64, commanded: &Parameters, mut say: impl FnMut(Event)) -> Option<&Parameters> {
        let mut has_changed = false;
        for parameter in own(self.service) {
            let (name, value) = (parameter.name, (parameter.get)(commanded));
            let is_known = value.to_bits() == (parameter.get)(&self.heard).to_bits();
            let was = (parameter.get)(&self.in_force);
            if value.is_nan() || is_known {
                continue;
            }
            (parameter.set)(&mut self.heard, value);
            if !parameter.allows(value) {
                let (least, most) = (parameter.least, parameter.most);
                let words = format_args!("{name} = {value} refused: it lies between {least} and {most}");
                say(Event::new(now_ns, self.service, Event::WARNING, words));
            } else if value.to_bits() != was.to_bits() {
                (parameter.set)(&mut self.in_force, value);
                say(Event::new(now_ns, self.service, Event::INFO, format_args!("{name} = {value} (was {was})")));
                has_changed = true;
            }
        }
        if has_changed {
            self.reported_ns = None;
        }
        has_changed.then_some(&self.in_force)
    }

    /// What is in force, where it is time to tell: after a change, and now and then.
    pub fn report(&mut self, now_ns: u64) -> Option<Parameters> {
        if self.reported_ns.is_some_and(|last_ns| now_ns < last_ns + REPORT_PERIOD_NS) {
            return None;
        }
        self.reported_ns = Some(now_ns);
        self.in_force.stamp_ns = now_ns;
        Some(self.in_force)
    }
}

fn own(service: &'static str) -> impl Iterator<Item = &'static Parameter> {
    PARAMETERS.iter().filter(move |parameter| parameter.service == service)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::{Sample, text_of};

    fn told(tuning: &mut Tuning, commanded: &Parameters) -> Vec<(u8, String)> {
        let mut said = Vec::new();
        tuning.follow(7, commanded, |event| said.push((event.severity, text_of(&event.text).to_owned())));
        said
    }

    #[test]
    fn defaults_lie_within_bounds_and_every_parameter_is_a_field() {
        for parameter in PARAMETERS {
            assert!(parameter.allows(parameter.default), "{parameter:?}");
            assert!(Parameters::FIELDS.iter().any(|field| field.name == parameter.name), "{parameter:?}");
            assert!(parameter.name.starts_with(parameter.service), "{parameter:?}");
        }
    }

    #[test]
    fn a_service_takes_its_own_within_bounds_once_and_says_so() {
        let mut tuning = Tuning::new("base", &Parameters::defaults());
        let commanded = Parameters {
            base_bandwidth_rad_s: 0.6,
            base_damping_ratio: 9.0,
            arm_line_gain_1_s: 0.1,
            ..Parameters::silent()
        };
        let said = told(&mut tuning, &commanded);
        assert_eq!(said[0], (Event::INFO, "base_bandwidth_rad_s = 0.6 (was 0.45)".to_owned()));
        assert_eq!(said[1], (Event::WARNING, "base_damping_ratio = 9 refused: it lies between 0.4 and 2".to_owned()));
        assert_eq!(said.len(), 2, "the arm's is not the base's");
        assert_eq!(told(&mut tuning, &commanded), [], "the same word again is no news");

        let state = tuning.report(7).unwrap();
        assert_eq!((state.base_bandwidth_rad_s, state.base_damping_ratio), (0.6, 1.0));
        assert!(state.arm_line_gain_1_s.is_nan() && text_of(&state.service) == "base");
        assert_eq!(tuning.report(8), None);
        for nonsense in [f64::INFINITY, f64::NEG_INFINITY, -0.1] {
            let commanded = Parameters { base_bandwidth_rad_s: nonsense, ..Parameters::silent() };
            assert_eq!(told(&mut tuning, &commanded)[0].0, Event::WARNING, "{nonsense}");
        }
    }
}
