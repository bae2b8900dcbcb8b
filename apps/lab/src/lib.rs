//! The simulated laboratory: granite, vehicle, links, cameras, gyro, valves.
//!
//! [`Laboratory`] is the core: physics from `fss-plant` and the devices around it, as a pure function of time, seed and the
//! bytes that it receives. It speaks the real devices' protocols (`fss-wire`) and knows no clock, socket or file, so the
//! fast run in one process and the real-time process are the same laboratory. [`process`] gives it a clock, UDP sockets,
//! a pseudo-terminal for the gyro and a Unix socket for the valves.

mod channel;
mod config;
mod devices;
mod error;
mod faults;
mod gripper;
mod laboratory;
pub mod process;
mod random;
mod shared_table;
mod truth;

pub use channel::Network;
pub use config::{Fault, FaultKind, LabConfig, Start};
pub use devices::link::COMMAND_TIMEOUT_NS;
pub use error::LabError;
pub use faults::{Faults, Networks};
pub use gripper::{GRIPPER_REACH_M, GRIPPER_SPEED_M_S};
pub use laboratory::{DeviceOutputs, Laboratory, STEP_NS, Traffic};
pub use truth::TRUTH_PERIOD_NS;
