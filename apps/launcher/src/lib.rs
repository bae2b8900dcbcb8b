//! A stack of services: started, watched, restarted, stopped; on a virtual clock; replayed; soaked.
//!
//! In the order of reading:
//!
//! - [`stack`]: launch file, plant file and mission file; `load`: read and checked.
//! - [`services`]: the services that are linked into this program, with their devices.
//! - [`processes`]: one process of a stack, in its `seat`; [`member`], [`launcher`]: those that a launch file names, supervised.
//! - `programs`: services from elsewhere, asked what they are; `follower`: one of them, on a clock that nobody waits for.
//! - [`fast`]: all services in one process, on a virtual clock.
//! - [`replay`]: every service again from a log's inputs.
//! - [`summary`], [`figures`]: what a flight has come to.
//! - [`soak`]: a long flight with faults and deaths; [`measured`]: one whose processes' time is taken.
//! - [`files`], [`console`]: what a person writes, and what is said to a person.
#![warn(clippy::print_stdout)] // what is said goes through `console`

#[macro_use]
pub mod console;

mod description;
pub mod fast;
pub mod figures;
pub mod files;
mod follower;
pub mod launcher;
mod limits;
pub mod link_key;
mod listener;
mod load;
pub mod measured;
pub mod member;
mod notify;
mod overruns;
pub mod processes;
mod programs;
pub mod replay;
mod seat;
pub mod services;
pub mod soak;
pub mod stack;
pub mod summary;
mod witness;
