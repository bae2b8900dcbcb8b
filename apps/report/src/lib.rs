//! What people see of flights: figures and pages of logs and diagnoses, drawings, the live view.
//!
//! In the order of reading:
//!
//! - `drawing`: scenes from above, strips of lines, pages; `values`: a sample of any topic as a line.
//! - [`flown`]: what a flight leaves in its folder; [`report`]: one page about it; [`compare`]: where two logs differ.
//! - [`top`], [`view`]: the running stack, in a terminal and in a browser.
//! - [`diagnose`], [`calibrate`], [`workspace`]: measured runs and plants, computed and shown.
#![warn(clippy::print_stdout)] // what is said goes through `console`

#[macro_use]
extern crate fss_launcher;

pub mod calibrate;
pub mod compare;
pub mod diagnose;
mod drawing;
pub mod flown;
mod picture;
pub mod report;
pub mod top;
mod values;
pub mod view;
pub mod workspace;
