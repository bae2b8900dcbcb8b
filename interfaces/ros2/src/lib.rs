//! ROS 2 on the wire, without ROS 2: no socket and no clock is touched here.
//!
//! | module | what |
//! | --- | --- |
//! | [`cdr`] | messages that hold text or lists; a plain sample is its own body |
//! | [`standard`] | definitions of the standard messages that fss makes or takes |
//! | [`incoming`] | goals that nodes send |
//! | [`robot`] | frames, joints and health as standard messages |
//! | [`type_hash`] | RIHS01, the hash of a message's definition by which ROS 2 knows types |
//! | [`rmw_zenoh`] | key expressions, liveliness tokens and attachments, as ROS 2's `rmw_zenoh` has them |

#![forbid(unsafe_code)]

pub mod cdr;
pub mod incoming;
pub mod rmw_zenoh;
pub mod robot;
pub mod standard;
pub mod type_hash;
