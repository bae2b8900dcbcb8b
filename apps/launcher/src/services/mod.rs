//! The services that are linked into this program, stated once: real time, the virtual clock and replay all take them from here.

mod fusion;
mod linked;
mod links;
mod plain;
mod thrusters;

use fss_bus::launch::{BRIDGE, GROUND};
use fss_messages::topic::{self, is_shared};
use fss_service::Program;
pub(crate) use linked::Entry;
use linked::{Guest, Linked};
use std::sync::OnceLock;

/// What a launch file may name that is no such service: log, world, and programs of their own.
const OTHERS: [&str; 4] = ["recorder", "lab", GROUND, BRIDGE];

static LINKED: OnceLock<Services> = OnceLock::new();

/// Services that are linked into a program.
pub struct Services(Vec<Box<dyn Entry>>);

impl Services {
    /// Those that come with fss.
    pub fn of_fss() -> Self {
        Self(Vec::new())
            .and(fusion::Devices)
            .and(links::Radio)
            .and(plain::Sequencer)
            .and(plain::Arm)
            .and(plain::BaseController)
            .and(thrusters::ValveLine)
            .and(plain::Postures)
    }

    /// With one more, which replaces one of the same name. A launch file has it without `program`; its `config` is what it is told.
    #[must_use]
    pub fn with<S: Program + 'static>(self) -> Self {
        self.and(Guest::<S>::new())
    }

    fn and(mut self, service: impl Linked + 'static) -> Self {
        let service: Box<dyn Entry> = Box::new(service);
        self.0.retain(|other| other.name() != service.name());
        self.0.push(service);
        self
    }

    /// Makes them this program's, before it reads its first launch file; a program has one set of services, the first that it links.
    pub fn link(self) {
        // A second set is not taken.
        let _ = LINKED.set(self);
    }

    /// This program's; those that come with fss where it has linked no others.
    pub(crate) fn linked() -> &'static Self {
        LINKED.get_or_init(Self::of_fss)
    }

    /// The service of this name.
    pub(crate) fn get(&self, name: &str) -> Option<&dyn Entry> {
        self.0.iter().find(|service| service.name() == name).map(|service| &**service)
    }

    /// In the order of their list.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &dyn Entry> {
        self.0.iter().map(|service| &**service)
    }
}

/// The names that a launch file may give a service without `program`.
pub fn names() -> Vec<&'static str> {
    OTHERS.into_iter().chain(Services::linked().iter().map(Entry::name)).collect()
}

/// The topics of which a service without `program` is the only publisher.
pub(crate) fn published_by(service: &str) -> Vec<String> {
    let own = |topics: &[&str]| topics.iter().map(|topic| (*topic).to_owned()).collect();
    match service {
        "lab" => own(&[topic::TRUTH_STATE.name]),
        GROUND => own(&[topic::PARAMETERS_COMMAND.name, topic::MISSION_COMMAND.name]),
        BRIDGE => own(&[topic::PEER.name, topic::MISSION_GOAL.name]),
        _ => {
            let outputs = Services::linked().get(service).map(|entry| entry.description().outputs);
            let topics = outputs.into_iter().flatten().map(|port| port.topic);
            topics.filter(|topic| !is_shared(topic)).collect()
        }
    }
}
