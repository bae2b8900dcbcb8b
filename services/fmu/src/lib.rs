//! `fmu`: an FMU for co-simulation, FMI 2 or 3, as a service of the stack.
//!
//! The launch file's table says which variables are which fields of which topics. Each step sets the inputs from the newest
//! samples, lets the FMU step as long as has passed since its last step, and publishes what its outputs say. Where an input is
//! too old, or the FMU fails or gives a number that is none, nothing is published: what listens does the safe thing.

pub mod config;
pub mod instance;
pub mod model;

use config::{Config, Port, Slot, factor};
use fss_bus::{RawPorts, RawService, Time};
use fss_messages::Event;
use fss_service::{Description, PortDescription, RawProgram, Refusal, Site};
use instance::Instance;
use model::{Kind, Model, Variable};
use tempfile::TempDir;

/// The service's name.
pub const NAME: &str = "fmu";
/// Steps that are made up for when the FMU takes steps of one length only.
const MOST_STEPS: u64 = 10;

/// A variable that follows a field.
#[derive(Clone, Debug)]
struct Follows {
    port: usize,
    slot: Slot,
    reference: u32,
    kind: Kind,
    /// How many of the field's unit one of the variable's is.
    factor: f64,
}

/// Where a field's value comes from.
#[derive(Clone, Debug)]
enum Source {
    Constant(f64),
    Variable { reference: u32, kind: Kind, factor: f64 },
}

/// A config and an FMU that go together.
#[derive(Clone, Debug)]
pub struct Wiring {
    model: Model,
    max_age_ns: u64,
    parameters: Vec<(u32, Kind, f64)>,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    follows: Vec<Follows>,
    gives: Vec<(usize, Slot, Source)>,
}

impl Wiring {
    /// Reads the config and the FMU that it names.
    ///
    /// # Errors
    /// Names the key, the variable or the field that does not fit.
    pub fn read(config: &str) -> Result<Self, String> {
        let config: Config = toml::from_str(config).map_err(|e| e.message().to_owned())?;
        let model = Model::read(&config.fmu).map_err(|e| e.to_string())?;
        let mut wiring = Self {
            max_age_ns: config.max_age_ms.saturating_mul(1_000_000),
            parameters: Vec::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            follows: Vec::new(),
            gives: Vec::new(),
            model,
        };
        for (name, value) in &config.parameters {
            let (variable, kind) = wiring.variable(name, "parameter")?;
            let value = value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64));
            let value = value.ok_or_else(|| format!("the parameter '{name}' is no number"))?;
            wiring.parameters.push((variable.reference, kind, value));
        }
        for input in &config.input {
            let (variable, kind) = wiring.variable(&input.variable, "input")?;
            let port = place(&mut wiring.inputs, &input.topic)?;
            let (slot, unit) = wiring.inputs[port].slot(&input.field)?;
            let factor = factor(&input.variable, variable.unit.as_deref(), &input.field, unit)?;
            wiring.follows.push(Follows { port, slot, reference: variable.reference, kind, factor });
        }
        for output in &config.output {
            let port = place(&mut wiring.outputs, &output.topic)?;
            let (slot, unit) = wiring.outputs[port].slot(&output.field)?;
            let source = match (&output.variable, output.value) {
                (Some(name), None) => {
                    let (variable, kind) = wiring.variable(name, "output")?;
                    let factor = factor(name, variable.unit.as_deref(), &output.field, unit)?;
                    Source::Variable { reference: variable.reference, kind, factor }
                }
                (None, Some(value)) => Source::Constant(value),
                _ => return Err(format!("the output to {} {} has a variable or a value", output.topic, output.field)),
            };
            wiring.gives.push((port, slot, source));
        }
        Ok(wiring)
    }

    /// A variable of the FMU that can be `causality`.
    fn variable(&self, name: &str, causality: &str) -> Result<(Variable, Kind), String> {
        let path = self.model.path.display();
        let known = &self.model.variables;
        let Some(variable) = known.get(name) else {
            let of_kind = known.iter().filter(|(_, v)| v.causality == causality).map(|(name, _)| name.as_str());
            let names: Vec<_> = of_kind.take(20).collect();
            return Err(format!("{path} has no variable '{name}'; its {causality}s are {}", names.join(", ")));
        };
        if variable.causality != causality {
            return Err(format!("'{name}' of {path} is no {causality}, but {}", variable.causality));
        }
        let kind = variable.kind.ok_or_else(|| {
            format!("'{name}' of {path} is of a type that is not read; Real, Integer, Boolean, Float64 and Int32 are")
        })?;
        Ok((variable.clone(), kind))
    }

    fn description(&self) -> Description {
        let ports = |ports: &[Port]| {
            let describe = |port: &Port| PortDescription {
                topic: port.topic.clone(),
                of_target: false,
                schema: port.definition.schema(),
                definition: port.definition.text.clone(),
                every: false,
            };
            ports.iter().map(describe).collect()
        };
        Description {
            format: fss_service::FORMAT.to_owned(),
            service: NAME.to_owned(),
            inputs: ports(&self.inputs),
            outputs: ports(&self.outputs),
        }
    }
}

/// The port of a topic, opened once.
fn place(ports: &mut Vec<Port>, topic: &str) -> Result<usize, String> {
    if let Some(place) = ports.iter().position(|port| port.topic == topic) {
        return Ok(place);
    }
    ports.push(Port::find(topic)?);
    Ok(ports.len() - 1)
}

/// The program: the FMU of a config.
pub struct Program {
    wiring: Result<Wiring, String>,
    description: Description,
}

impl Program {
    /// Of this config; what is wrong with it is said when it is asked.
    pub fn new(config: &str) -> Self {
        let wiring = Wiring::read(config);
        let empty = || Description {
            format: fss_service::FORMAT.to_owned(),
            service: NAME.to_owned(),
            inputs: Vec::new(),
            outputs: Vec::new(),
        };
        let description = wiring.as_ref().map_or_else(|_| empty(), Wiring::description);
        Self { wiring, description }
    }
}

impl RawProgram for Program {
    type Service = Fmu;

    fn description(&self) -> &Description {
        &self.description
    }

    fn check(&self, _config: &str) -> Result<(), Refusal> {
        self.wiring.as_ref().map(|_| ()).map_err(|e| e.clone().into())
    }

    fn make(&self, _config: &str, site: &Site) -> Result<Fmu, Refusal> {
        let wiring = self.wiring.clone()?;
        Fmu::start(wiring, site.rate_hz).map_err(Into::into)
    }
}

/// The service.
pub struct Fmu {
    wiring: Wiring,
    instance: Instance,
    period_ns: u64,
    samples: Vec<Vec<u8>>,
    began: Option<Time>,
    /// Steps of the FMU so far.
    steps: u64,
    /// What keeps it from stepping, as last said.
    said: Option<&'static str>,
    has_failed: bool,
    _folder: TempDir,
}

const OLD: &str = "an input is missing or too old: the FMU waits, and nothing is published";
const NO_NUMBER: &str = "the FMU gives a number that is none: nothing is published";

impl Fmu {
    /// Loads the FMU and brings it to its first step.
    ///
    /// # Errors
    /// Where it cannot be unpacked, loaded or initialized.
    pub fn start(wiring: Wiring, rate_hz: f64) -> Result<Self, String> {
        let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
        let path = wiring.model.path.display().to_string();
        let library = wiring.model.unpack(folder.path()).map_err(|e| e.to_string())?;
        let instance = Instance::start(&wiring.model, &library, folder.path()).map_err(|e| format!("{path} {e}"))?;
        for (reference, kind, value) in &wiring.parameters {
            instance.set(*reference, *kind, *value).map_err(|e| format!("{path}: {e}"))?;
        }
        instance.begin(wiring.model.fmi).map_err(|e| format!("{path}: {e}"))?;
        let blank = |port: &Port| vec![0; port.definition.size];
        Ok(Self {
            samples: wiring.outputs.iter().map(blank).collect(),
            period_ns: (1e9 / rate_hz).round() as u64,
            wiring,
            instance,
            began: None,
            steps: 0,
            said: None,
            has_failed: false,
            _folder: folder,
        })
    }

    /// Sets the inputs.
    fn listen(&self, now: Time, ports: &RawPorts) -> Result<(), &'static str> {
        for follows in &self.wiring.follows {
            let sample = ports.input(follows.port).and_then(fss_bus::RawInput::get).ok_or(OLD)?;
            let stamp_ns = sample.get(8..).and_then(<[u8]>::first_chunk).map_or(0, |bytes| u64::from_le_bytes(*bytes));
            if now.age_ns(stamp_ns) > self.wiring.max_age_ns {
                return Err(OLD);
            }
            let value = follows.slot.read(sample).ok_or(OLD)? / follows.factor;
            self.instance.set(follows.reference, follows.kind, value)?;
        }
        Ok(())
    }

    /// Lets the FMU come to `now`.
    fn advance(&mut self, now: Time) -> Result<(), &'static str> {
        let began = *self.began.get_or_insert(now);
        let due = (now.age_ns(began.ns()) + self.period_ns / 2) / self.period_ns + 1;
        let missing = due.saturating_sub(self.steps).max(1);
        let (count, length) =
            if self.wiring.model.takes_any_step { (1, missing) } else { (missing.min(MOST_STEPS), 1) };
        let period_s = self.period_ns as f64 * 1e-9;
        for _ in 0..count {
            self.instance.step(self.steps as f64 * period_s, length as f64 * period_s)?;
            self.steps += length;
        }
        // An FMU that waited for longer than it can make up for goes on from here.
        self.began = Some(Time::from_ns(now.ns().saturating_sub((self.steps - 1) * self.period_ns)));
        Ok(())
    }

    /// Publishes the outputs.
    fn speak(&mut self, now: Time, ports: &mut RawPorts) -> Result<(), &'static str> {
        for (port, slot, source) in &self.wiring.gives {
            let value = match source {
                Source::Constant(value) => *value,
                Source::Variable { reference, kind, factor } => self.instance.get(*reference, *kind)? * factor,
            };
            if !slot.write(&mut self.samples[*port], value) {
                return Err(NO_NUMBER);
            }
        }
        for (place, sample) in self.samples.iter_mut().enumerate() {
            // Every message begins with its sequence and its stamp.
            if let Some(stamp) = sample.get_mut(8..16) {
                stamp.copy_from_slice(&now.ns().to_le_bytes());
            }
            ports.publish(place, sample);
        }
        Ok(())
    }
}

impl RawService for Fmu {
    fn step(&mut self, now: Time, ports: &mut RawPorts) {
        if self.has_failed {
            return;
        }
        let listened = self.listen(now, ports);
        let outcome = listened.and_then(|()| self.advance(now)).and_then(|()| self.speak(now, ports));
        let Err(why) = outcome else {
            self.said = None;
            return;
        };
        // What an FMU says after a call that failed the standard leaves open: it is not asked again.
        self.has_failed = why != OLD && why != NO_NUMBER;
        if self.said.replace(why) != Some(why) {
            let severity = if self.has_failed { Event::ERROR } else { Event::WARNING };
            ports.event(severity, why);
        }
    }
}
