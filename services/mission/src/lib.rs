//! Missions: what base and arm shall do, phase after phase, and when the mission gives up.
//!
//! [`Mission`] is what a mission file says; reading one is strict, and an error names the line and what to do.
//! [`MissionService`] flies it: it waits until navigation and telemetry are good, publishes the goals of the phase on
//! `/mission/state`, and ends [done](fss_messages::MissionState::DONE) or
//! [aborted](fss_messages::MissionState::ABORTED). In both ends the thrusters are shut and the arm holds its joints.
//!
//! Over a restart a mission keeps what it published last: the launcher, which reads it, gives it to the next process, and
//! [`MissionService::resumed`] goes on in the same phase by that phase's clock. Meanwhile base and arm see `/mission/state`
//! age, and do the safe thing when it is too old.

mod config;
mod error;
mod file;
mod follow;
mod goals;
mod program;
mod service;
mod sight;
mod target;
mod trouble;

pub use config::MissionConfig;
pub use error::MissionError;
pub use file::{ArmGoal, BaseGoal, Condition, Draw, Initial, Mission, Phase, Pulse, Ranges, Sine, TargetBody, Until};
pub use program::Config;
pub use service::{Inputs, MissionService, Outputs};
