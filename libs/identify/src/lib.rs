//! Measured runs as plain series; parameters of a plant calibrated from them; workspace and straight paths.
//!
//! - [`calibrate`]: parameters of the plant from measured runs.
//! - [`commands`]: commands of a flight, played again on a simulation.
//! - [`measured`]: the runs of an experiment as plain series.
//! - [`workspace`]: reach and manipulability.
//! - [`straight_path`]: how far the end-effector gets along straight lines.

pub mod calibrate;
pub mod commands;
pub mod measured;
pub mod straight_path;
pub mod workspace;

pub use fss_estimation::smoothing as smoother;
