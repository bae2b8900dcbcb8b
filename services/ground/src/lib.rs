//! Telemetry for the outside: a live view in the tools that laboratories have.
//!
//! One process beside the flight serves every topic of the stack over the Foxglove WebSocket protocol, raw: the bytes in
//! shared memory, with the schemas that the log has. To that it adds what three-dimensional views want: `/tf`,
//! `/joint_states`, `/nav/pose`, `/robot_description` (a URDF made from the plant file, [`fss_plant::urdf`]) and `/scene` (what
//! else stands on the table, [`fss_plant::scene`]).
//!
//! Where it is told to take commands ([`GroundConfig::commands`], on the loopback only), viewers tune parameters within their
//! bounds ([`fss_messages::parameter`]) and abort the mission; each such word is an event, a sample and so in the log.
//!
//! What a browser shows may come from anywhere: pages of other origins than the launch file names are refused (`gate`).
//!
//! It never hurts the flight: it reads from the overflowing buffers of shared memory as any subscriber does, and what a
//! slow client does not fetch is dropped from that client's own bounded queue, counted and said.

mod channels;
mod config;
mod decorations;
mod downlink;
mod frame;
mod frames;
mod gate;
mod metrics;
mod origin;
mod outbox;

mod session;
mod topics;
mod uplink;
mod viewer;
mod viewers;

pub use config::{GroundConfig, GroundError};
pub use topics::AllTopics;

use channels::Channels;
use decorations::Decorations;
use downlink::Downlink;
use frames::Frames;
use fss_bus::{Bus, BusError, Output, OutputPort, Service, Time, outputs};
use fss_messages::{Event, MissionCommand, Parameters, topic};
use fss_plant::Plant;
use metrics::Metrics;

use gate::Gate;
use std::sync::Arc;
use uplink::{Outlets, Uplink};
use viewer::FAREWELL;
use viewers::Viewers;

const NAME: &str = "ground";

outputs! {
    /// What the service says.
    pub struct Outputs {
        /// What viewers want of parameters.
        parameters: Output<Parameters> = topic::PARAMETERS_COMMAND,
        /// What viewers want of the mission.
        mission: Output<MissionCommand> = topic::MISSION_COMMAND,
        /// Viewers that come, go and ask.
        events: Output<Event> = topic::EVENTS,
        /// What slow viewers lose.
        lost: Lost = (),
    }
}

/// Samples that slow viewers have lost: a port, so that they count among what could not be queued.
pub struct Lost(u64);

impl OutputPort for Lost {
    type Address = ();

    fn open(_bus: &Bus, (): ()) -> Result<Self, BusError> {
        Ok(Self(0))
    }

    fn flush(&mut self, _now: Time) -> u64 {
        std::mem::take(&mut self.0)
    }
}

/// The service.
pub struct Ground {
    downlink: Downlink,
    frames: Frames,
    decorations: Decorations,
    uplink: Uplink,
    viewers: Arc<Viewers>,
    gate: Gate,
    metrics: Metrics,
    /// What is to be said of the address, once.
    address: Option<String>,
}

impl Ground {
    /// Listens, and serves the stack of this plant that speaks on the bus.
    ///
    /// # Errors
    /// Where the address cannot be listened at, or whoever reaches it could command.
    pub fn listen(config: &GroundConfig, plant: &Plant, bus: &Bus) -> Result<Self, GroundError> {
        if config.commands && !config.listen.ip().is_loopback() {
            return Err(GroundError::Exposed(config.listen));
        }
        let mut channels = Channels::default();
        let downlink = Downlink::new(&mut channels, bus);
        let frames = Frames::new(&mut channels, plant, bus);
        let decorations = Decorations::new(&mut channels, plant, bus);
        let uplink = Uplink::new(config.commands, bus);
        let viewers = Arc::new(Viewers::new(config, channels, uplink.desk()));
        let gate = Gate::open(config.listen, viewers.clone())
            .map_err(|source| GroundError::Listen { address: config.listen, source })?;
        let what = if config.commands { "and takes commands" } else { "and only shows" };
        let address = Some(format!("listens at {}:{} {what}", config.listen.ip(), gate.port()));
        Ok(Self { downlink, frames, decorations, uplink, viewers, gate, metrics: Metrics::default(), address })
    }

    /// Says goodbye to the clients.
    pub fn close(self) {
        self.viewers.dismiss();
        self.gate.wait(FAREWELL);
    }
}

impl Service for Ground {
    type Inputs = AllTopics;
    type Outputs = Outputs;
    const NAME: &'static str = NAME;

    /// Unlike a flight service it allocates: each client's queue holds copies of its own.
    fn step(&mut self, now: Time, inputs: &AllTopics, outputs: &mut Outputs) {
        self.downlink.send(inputs, &self.viewers);
        self.frames.send(now, inputs, &self.viewers);
        self.decorations.send(now, inputs, &self.viewers);
        if let Some(text) = self.metrics.learn(now, inputs) {
            self.viewers.set_metrics(text);
        }
        let Outputs { parameters, mission, events, lost } = outputs;
        lost.0 += self.viewers.lost();
        self.uplink.pass_on(now, &mut Outlets { parameters, mission, events });
        self.viewers.tell(&self.uplink.learn(inputs.samples(topic::PARAMETERS_STATE)));
        if let Some(words) = self.address.take() {
            events.publish(Event::new(now.ns(), Self::NAME, Event::INFO, format_args!("{words}")));
        }
        while let Some((severity, words)) = self.viewers.next_words() {
            events.publish(Event::new(now.ns(), Self::NAME, severity, format_args!("{words}")));
        }
    }
}
