//! What the services that come with fss publish.

use fss_arm::ArmService;
use fss_base::Base;
use fss_bus::launch::{BRIDGE, GROUND};
use fss_bus::{OutputPorts, PortVisitor, Service};
use fss_calibration::Calibration;
use fss_fusion::Fusion;
use fss_links::LinksService;
use fss_messages::Sample;
use fss_messages::topic::{self, Topic};
use fss_mission::MissionService;
use fss_thrusters::Thrusters;

/// Notes the names of topics.
struct Names(Vec<&'static str>);

impl PortVisitor for Names {
    fn topic<T: Sample>(&mut self, topic: Topic<T>) {
        self.0.push(topic.name);
    }

    fn device(&mut self, _queue: &'static str) {}
}

fn of<S: Service>() -> Vec<&'static str> {
    let mut names = Names(Vec::new());
    S::Outputs::visit(&mut names);
    names.0.retain(|name| !topic::is_shared(name));
    names.0
}

/// The topics of which a service that comes with fss is the publisher.
pub(crate) fn published_by(service: &str) -> Vec<&'static str> {
    match service {
        Fusion::NAME => of::<Fusion>(),
        LinksService::NAME => of::<LinksService>(),
        MissionService::NAME => of::<MissionService>(),
        ArmService::NAME => of::<ArmService>(),
        Base::NAME => of::<Base>(),
        Thrusters::NAME => of::<Thrusters>(),
        Calibration::NAME => of::<Calibration>(),
        // The world, and programs of their own.
        "lab" => vec![topic::TRUTH_STATE.name],
        GROUND => vec![topic::PARAMETERS_COMMAND.name, topic::MISSION_COMMAND.name],
        BRIDGE => vec![topic::PEER.name],
        _ => Vec::new(),
    }
}
