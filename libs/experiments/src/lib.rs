//! The runs of an experiment as plain series, and what servo drives made of their commands.
//!
//! - [`measured`]: a run's channels; [`series`]: values of several joints over time.
//! - [`commands`]: commands of a flight, played again on a simulation.

pub mod commands;
pub mod measured;
pub mod series;
