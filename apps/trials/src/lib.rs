//! Many flights: campaigns, the game of hidden effects, the experiment that decides best between causes.
#![warn(clippy::print_stdout)] // what is said goes through `console`

#[macro_use]
extern crate fss_launcher;

pub mod campaign;
pub mod challenge;
pub mod next_experiment;
