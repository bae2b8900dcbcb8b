//! The radio link to the arm: commands and telemetry of every modular link, 5 times a second each way.
//!
//! [`LinksService`] decodes what the device's thread received ([`TelemetryDatagram`], queue [`TELEMETRY_QUEUE`]), refuses
//! what is damaged, repeated or overtaken, translates each link's clock into the host's, and publishes the state of all
//! joints extrapolated to now, with its age. It turns the newest `/arm/command` into one signed datagram a link
//! ([`CommandDatagram`], queue [`COMMAND_QUEUE`]) and enforces joint, rate and torque limits there, at the last place
//! before the wire.
//!
//! When `/arm/command` grows old the links are told to hold their angles; when this process dies, each link's own
//! command time-out shuts its driver off.
//!
//! Nothing is kept over a restart but the order of the commands' sequence numbers, which begin from the calendar time
//! ([`fss_wire::link::first_sequence`]). A restarted service stays silent until it hears the arm controller, so that the
//! links go on with what they do.

mod command;
mod config;
mod datagram;
pub mod device;
mod program;
mod receiver;
mod service;

pub use config::{JointLimits, LinksConfig};
pub use datagram::{COMMAND_QUEUE, CommandDatagram, TELEMETRY_QUEUE, TelemetryDatagram};
pub use program::Config;
pub use service::{Inputs, LinksService, Outputs};
