//! Where a simulation differs from what was measured.
//!
//! - [`calibrate`]: parameters of the plant from measured runs.
//! - [`measured`]: the runs of an experiment as plain series.
//! - [`smoother`]: joint motion between slow telemetry.
//! - [`workspace`]: reach and manipulability.
//! - [`misfit`]: the plant simulated in windows with a free initial state, and its error over what noise alone would give.
//!
//! Causes are not named yet.

pub mod calibrate;
pub mod measured;
pub mod misfit;
pub mod smoother;
pub mod workspace;
