//! Topics, rates, deadlines and the loop that runs a service.
//!
//! A [`Service`] is a pure step: it reads its input ports, writes its output ports, and knows neither clock, socket nor
//! shared memory. The bus runs the same core in four ways:
//!
//! - **as a process**, in real time ([`process::run`]): an absolute-time loop at the rate of the launch file, with ports in
//!   shared memory ([`Bus::shared`]);
//! - **in one process**, as fast as the machine allows ([`virtual_time::Stack`]): the same rates on a virtual clock, with
//!   ports in local memory ([`Bus::local`]);
//! - **as a process on a virtual clock** ([`lockstep`]): a program of its own that is told when to step;
//! - **again**, from a log, with the same local ports: each step's record ([`Step`], on `/steps`) names its time and the
//!   samples that it used.
//!
//! Devices stand outside: their threads hand over decoded messages through bounded lock-free queues, which a service
//! sees as a [`Feed`] (in) or a [`DeviceOutput`] (out).

pub mod allocation;
mod bus;
mod device_thread;
mod error;
pub mod health;
pub mod launch;
mod local;
pub mod lockstep;
mod phase;
mod port;
mod port_sets;
pub mod process;
mod raw;
mod raw_service;
pub mod realtime;
mod runner;
mod shared;
mod time;
pub mod virtual_time;

pub use bus::{Bus, Neighbours, Queue};
pub use device_thread::DeviceThread;
pub use error::BusError;
pub use fss_messages::{MAX_PORTS, Step};
pub use port::{Batch, DeviceOutput, Feed, InputPort, Latest, Output, OutputPort, PortVisitor, Taken};
pub use port_sets::{InputPorts, OutputPorts};
pub use raw::{RawBatch, RawOutput, RawTopic};
pub use raw_service::{RawInput, RawPorts, RawRunner, RawService};
pub use runner::{Run, Runner, Service};
pub use shared::{SharedConfig, remove_dead_nodes, remove_stale_stacks, stack_runs};
pub use time::Time;
