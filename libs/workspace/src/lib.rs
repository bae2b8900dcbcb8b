//! Where the end-effector can be, and how far it gets.
//!
//! - [`reach`]: reach and manipulability.
//! - [`straight_path`]: how far the end-effector gets along straight lines.

pub mod reach;
pub mod straight_path;
