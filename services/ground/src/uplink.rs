//! What viewers ask for: parameters and commands.
//!
//! Requests come on the server's threads and wait in a bounded queue for the service's step, as a device's messages do.

use crossbeam::queue::ArrayQueue;
use foxglove::Schema;
use foxglove::websocket::service::{Service, ServiceSchema};
use foxglove::websocket::{
    AnyClient, GetParametersResponder, Parameter as Told, ParameterHandler, ParameterValue, SetParametersResponder,
};
use fss_bus::{Bus, Output, Queue, Time};
use fss_messages::parameter::Parameter;
use fss_messages::{Event, MissionCommand, PARAMETERS, Parameters};
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

/// What the server's threads and the service's step share.
struct Shared {
    requests: Queue<Request>,
    in_force: Mutex<Parameters>,
    is_open: bool,
}

/// The way from viewers to the stack.
pub(crate) struct Uplink {
    shared: Arc<Shared>,
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
    pub(crate) fn new(is_open: bool) -> Self {
        let shared = Shared {
            requests: Arc::new(ArrayQueue::new(REQUESTS)),
            in_force: Mutex::new(Parameters::silent()),
            is_open,
        };
        Self { shared: Arc::new(shared), wanted: Parameters::silent(), next_ns: None }
    }

    /// What answers for parameters.
    pub(crate) fn parameter_handler(&self) -> Arc<dyn ParameterHandler> {
        Arc::new(Handler(self.shared.clone()))
    }

    /// The commands that viewers may call: none where the uplink is closed.
    pub(crate) fn services(&self, bus: &Bus) -> Vec<Service> {
        if !self.shared.is_open {
            return Vec::new();
        }
        let commands = [("/mission/abort", MissionCommand::ABORT), ("/mission/stop", MissionCommand::STOP)];
        commands.map(|(name, command)| self.service(bus.full_name(name), command)).into()
    }

    fn service(&self, name: String, command: u8) -> Service {
        let object = |name: &str, text: &'static str| Schema::new(name, "jsonschema", text.as_bytes());
        let nothing = object("fss_msgs/Nothing", r#"{"type":"object"}"#);
        let answer = object("fss_msgs/Accepted", r#"{"type":"object","properties":{"success":{"type":"boolean"}}}"#);
        let schema =
            ServiceSchema::new("fss_msgs/srv/Command").with_request("json", nothing).with_response("json", answer);
        let shared = self.shared.clone();
        Service::builder(name, schema).handler_fn(move |_| {
            let request = shared.requests.push(Request::Command(command));
            request.map(|()| br#"{"success":true}"#).map_err(|_| "too many requests wait")
        })
    }

    /// Passes on what viewers have asked for since the last step.
    pub(crate) fn pass_on(&mut self, now: Time, outlets: &mut Outlets<'_>) {
        let stamp_ns = now.ns();
        while let Some(request) = self.shared.requests.pop() {
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
        let mut in_force = self.shared.in_force.lock().unwrap_or_else(PoisonError::into_inner);
        let mut changed = Vec::new();
        for (state, parameter) in states.iter().flat_map(|state| PARAMETERS.iter().map(move |p| (state, p))) {
            let value = (parameter.get)(state);
            if !value.is_nan() && value.to_bits() != (parameter.get)(&in_force).to_bits() {
                (parameter.set)(&mut in_force, value);
                changed.push(Told::float64(parameter.name, value));
            }
        }
        changed
    }
}

struct Handler(Arc<Shared>);

impl Handler {
    /// The value in force, or none where its service has not spoken yet.
    fn in_force(&self, name: &str) -> Option<Told> {
        let in_force = self.0.in_force.lock().unwrap_or_else(PoisonError::into_inner);
        let value = (Parameter::named(name)?.get)(&in_force);
        (!value.is_nan()).then(|| Told::float64(name, value))
    }

    /// Takes a value; says why not.
    fn take(&self, told: &Told) -> Result<Told, String> {
        let name = &told.name;
        if !self.0.is_open {
            return Err(format!("{name} stays: this view only watches ([ground] commands = true lets it tune)"));
        }
        let Some(parameter) = Parameter::named(name) else { return Err(format!("there is no parameter '{name}'")) };
        let value = match told.value {
            Some(ParameterValue::Float64(value)) => value,
            Some(ParameterValue::Integer(value)) => value as f64,
            _ => return Err(format!("{name} stays: its value is a number")),
        };
        if !parameter.allows(value) {
            let (least, most) = (parameter.least, parameter.most);
            return Err(format!("{name} = {value} refused: it lies between {least} and {most}"));
        }
        let request = self.0.requests.push(Request::Tune(parameter, value));
        request.map(|()| Told::float64(name, value)).map_err(|_| format!("{name} stays: too many requests wait"))
    }
}

impl ParameterHandler for Handler {
    fn get(&self, _client: AnyClient, names: Vec<String>, _id: Option<String>, responder: GetParametersResponder) {
        let all = || PARAMETERS.iter().map(|parameter| parameter.name.to_owned()).collect();
        let names: Vec<String> = if names.is_empty() { all() } else { names };
        responder.respond(names.iter().filter_map(|name| self.in_force(name)).collect());
    }

    /// Answers with what is asked for where it is taken, else with what stays in force, and why.
    fn set(&self, client: AnyClient, told: Vec<Told>, _id: Option<String>, responder: SetParametersResponder) {
        let answer = told.iter().filter_map(|told| match self.take(told) {
            Ok(taken) => Some(taken),
            Err(why) => {
                client.send_warning(&why);
                self.0.requests.force_push(Request::Refused(why));
                self.in_force(&told.name)
            }
        });
        responder.respond(answer.collect());
    }
}
