//! What viewers ask for: parameters and commands.
//!
//! Requests come on the viewers' threads and wait in a bounded queue for the service's step, as a device's messages do.

use crossbeam_queue::ArrayQueue;
use fss_bus::{Bus, Output, Queue, Time};
use fss_messages::parameter::Parameter;
use fss_messages::{Event, MissionCommand, PARAMETERS, Parameters};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::sync::{Arc, Mutex, PoisonError};

/// Requests that wait for the next step; more are refused.
const REQUESTS: usize = 64;
/// How often the wanted values are told again, for services that were restarted, ns.
const REPEAT_NS: u64 = 1_000_000_000;

/// What a viewer asks for.
enum Request {
    Tune(&'static Parameter, f64),
    Command(u8),
    /// It was refused, for this reason.
    Refused(String),
}

/// A parameter's value, as viewers are told of it.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Told {
    pub(crate) name: &'static str,
    r#type: &'static str,
    value: f64,
}

/// A parameter's value that a viewer asks for.
#[derive(Debug, Deserialize)]
pub(crate) struct Asked {
    name: String,
    value: Option<Value>,
}

/// The commands that viewers may call, numbered from 1.
const COMMANDS: [(&str, u8); 2] = [("/mission/abort", MissionCommand::ABORT), ("/mission/stop", MissionCommand::STOP)];

/// What the viewers' threads and the service's step share.
pub(crate) struct Desk {
    requests: Queue<Request>,
    in_force: Mutex<Parameters>,
    is_open: bool,
    /// Names of the commands in this stack.
    commands: Vec<String>,
}

/// The way from viewers to the stack.
pub(crate) struct Uplink {
    desk: Arc<Desk>,
    /// What viewers have asked for so far.
    wanted: Parameters,
    next_ns: Option<u64>,
}

/// Where the uplink writes.
pub(crate) struct Outlets<'a> {
    pub(crate) parameters: &'a mut Output<Parameters>,
    pub(crate) mission: &'a mut Output<MissionCommand>,
    pub(crate) events: &'a mut Output<Event>,
}

impl Uplink {
    /// One that takes requests, or one that refuses them all.
    pub(crate) fn new(is_open: bool, bus: &Bus) -> Self {
        let desk = Desk {
            requests: Arc::new(ArrayQueue::new(REQUESTS)),
            in_force: Mutex::new(Parameters::silent()),
            is_open,
            commands: COMMANDS.iter().filter(|_| is_open).map(|(name, _)| bus.full_name(name)).collect(),
        };
        Self { desk: Arc::new(desk), wanted: Parameters::silent(), next_ns: None }
    }

    /// Where viewers ask.
    pub(crate) fn desk(&self) -> Arc<Desk> {
        self.desk.clone()
    }

    /// Passes on what viewers have asked for since the last step.
    pub(crate) fn pass_on(&mut self, now: Time, outlets: &mut Outlets<'_>) {
        let stamp_ns = now.ns();
        while let Some(request) = self.desk.requests.pop() {
            let (severity, words) = match request {
                Request::Tune(parameter, value) => {
                    (parameter.set)(&mut self.wanted, value);
                    self.next_ns = Some(stamp_ns);
                    continue; // the service whose it is says what it does
                }
                Request::Command(command) => {
                    outlets.mission.publish(MissionCommand { stamp_ns, command, ..MissionCommand::default() });
                    let what = if command == MissionCommand::ABORT { "abort" } else { "stop" };
                    (Event::WARNING, format!("a viewer commands: {what}"))
                }
                Request::Refused(why) => (Event::WARNING, why),
            };
            outlets.events.publish(Event::new(stamp_ns, crate::NAME, severity, format_args!("{words}")));
        }
        if self.next_ns.is_some_and(|next_ns| stamp_ns >= next_ns) {
            self.next_ns = Some(stamp_ns + REPEAT_NS);
            let service = fss_messages::text(crate::NAME);
            outlets.parameters.publish(Parameters { stamp_ns, service, ..self.wanted });
        }
    }

    /// Takes what services say is in force; gives what has changed.
    pub(crate) fn learn(&self, states: &[Parameters]) -> Vec<Told> {
        let mut in_force = self.desk.in_force.lock().unwrap_or_else(PoisonError::into_inner);
        let mut changed = Vec::new();
        for (state, parameter) in states.iter().flat_map(|state| PARAMETERS.iter().map(move |p| (state, p))) {
            let value = (parameter.get)(state);
            if !value.is_nan() && value.to_bits() != (parameter.get)(&in_force).to_bits() {
                (parameter.set)(&mut in_force, value);
                changed.push(told(parameter, value));
            }
        }
        changed
    }
}

fn told(parameter: &Parameter, value: f64) -> Told {
    Told { name: parameter.name, r#type: "float64", value }
}

impl Desk {
    /// The commands that viewers may call: none where the uplink is closed.
    pub(crate) fn services(&self) -> Vec<Value> {
        let schema = |name: &str, schema: &str| json!({ "encoding": "json", "schemaName": name, "schemaEncoding": "jsonschema", "schema": schema });
        let request = schema("fss_msgs/Nothing", r#"{"type":"object"}"#);
        let response = schema("fss_msgs/Accepted", r#"{"type":"object","properties":{"success":{"type":"boolean"}}}"#);
        let service = |(number, name): (usize, &String)| json!({ "id": number + 1, "name": name, "type": "fss_msgs/srv/Command", "request": request, "response": response });
        self.commands.iter().enumerate().map(service).collect()
    }

    /// Takes the command with this number; gives what is answered.
    pub(crate) fn call(&self, number: u32) -> Result<&'static [u8], &'static str> {
        let known = COMMANDS.iter().take(self.commands.len()).zip(1..).find(|(_, of)| *of == number);
        let ((_, command), _) = known.ok_or("there is no such command")?;
        let request = self.requests.push(Request::Command(*command));
        request.map(|()| &br#"{"success":true}"#[..]).map_err(|_| "too many requests wait")
    }

    /// The values in force of parameters of these names, or of all where there is none; without those whose service has not
    /// spoken yet.
    pub(crate) fn get(&self, names: &[String]) -> Vec<Told> {
        let wanted =
            PARAMETERS.iter().filter(|parameter| names.is_empty() || names.iter().any(|n| n == parameter.name));
        wanted.filter_map(|parameter| self.in_force(parameter)).collect()
    }

    fn in_force(&self, parameter: &Parameter) -> Option<Told> {
        let in_force = self.in_force.lock().unwrap_or_else(PoisonError::into_inner);
        let value = (parameter.get)(&in_force);
        (!value.is_nan()).then(|| told(parameter, value))
    }

    /// Takes values. Gives what is asked for where it is taken, else what stays in force; and why.
    pub(crate) fn set(&self, asked: &[Asked]) -> (Vec<Told>, Vec<String>) {
        let (mut answer, mut refusals) = (Vec::new(), Vec::new());
        for asked in asked {
            match self.take(asked) {
                Ok(taken) => answer.push(taken),
                Err(why) => {
                    self.requests.force_push(Request::Refused(why.clone()));
                    refusals.push(why);
                    answer.extend(Parameter::named(&asked.name).and_then(|parameter| self.in_force(parameter)));
                }
            }
        }
        (answer, refusals)
    }

    fn take(&self, asked: &Asked) -> Result<Told, String> {
        let name = &asked.name;
        if !self.is_open {
            return Err(format!("{name} stays: this view only watches ([ground] commands = true lets it tune)"));
        }
        let Some(parameter) = Parameter::named(name) else { return Err(format!("there is no parameter '{name}'")) };
        let Some(value) = asked.value.as_ref().and_then(Value::as_f64) else {
            return Err(format!("{name} stays: its value is a number"));
        };
        if !parameter.allows(value) {
            let (least, most) = (parameter.least, parameter.most);
            return Err(format!("{name} = {value} refused: it lies between {least} and {most}"));
        }
        let request = self.requests.push(Request::Tune(parameter, value));
        request.map(|()| told(parameter, value)).map_err(|_| format!("{name} stays: too many requests wait"))
    }
}
