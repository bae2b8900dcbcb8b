//! Where a simulation differs from what was measured, and why.
//!
//! - [`calibrate`]: parameters of the plant from measured runs.
//! - [`commands`]: commands of a flight, played again on a simulation.
//! - [`measured`]: the runs of an experiment as plain series.
//! - [`workspace`]: reach and manipulability.
//! - [`straight_path`]: how far the end-effector gets along straight lines.
//! - [`diagnosis`]: the whole answer.
//! - [`inputs`]: whether the commands of a run belong to its motion.
//! - [`misfit`]: the plant simulated in windows with a free initial state, and its error over what noise alone would give.

pub mod calibrate;
mod clamped;
pub mod commands;
mod contest;
pub mod diagnosis;
mod empirical;
mod evidence;
mod floating;
mod hypothesis;
mod in_hand;
mod in_motion;
pub mod inputs;
mod integrity;
pub mod measured;
pub mod misfit;
mod normal;
mod prediction;
mod search;
mod sensitivity;
mod series;
pub mod straight_path;
mod tolerance;
mod trial;
mod uncertain;
pub mod unexplained;
mod verdict;
pub mod workspace;

pub use fss_estimation::smoothing as smoother;
