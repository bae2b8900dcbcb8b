//! Plain samples that processes share, and their schemas.
//!
//! A sample is a `#[repr(C)]` struct of SI units without padding or pointers. It starts with the same three
//! fields everywhere, the [`Header`]: `sequence`, `stamp_ns` (time of measurement) and `published_ns`, both on the
//! monotonic clock that all processes of a host share. What lies in shared memory is what lies in the log: the bytes of
//! such a struct are the body of the equivalent ROS 2 message in XCDR1 little endian (a primitive is aligned to its
//! own size, there is no trailing padding), so a log record is [`CDR_HEADER`] and the sample's bytes.
//!
//! One definition (the `define_messages!` macro) gives the struct, its ROS 2 message definition ([`Sample::definition`]), the
//! documentation of its topic and a hash that travels in the type's name through shared memory, so that two builds
//! that disagree about a layout do not talk to each other.

mod define;
mod definition;
mod event;
pub mod parameter;
mod samples;
mod schema;
pub mod topic;

pub use definition::{Definition, DefinitionError};
pub use samples::*;
pub use schema::{Constant, Field, FieldType, Header, Sample, SampleVisitor, Scalar};

/// The most links that a sample has room for; unused entries are zero.
pub const MAX_LINKS: usize = 8;
/// The most thrusters that a sample has room for; unused entries are zero.
pub const MAX_THRUSTERS: usize = 16;
/// The most input ports of a service whose steps are recorded.
pub const MAX_PORTS: usize = 8;
/// The most sines of one joint's excitation.
pub const MAX_SINES: usize = 3;
/// ROS 2 package of the message definitions.
pub const PACKAGE: &str = "fss_msgs";
/// Encapsulation header of XCDR1, little endian: what stands before a sample's bytes in a log record.
pub const CDR_HEADER: [u8; 4] = [0, 1, 0, 0];

/// What the macros of this crate expand to; nothing for others.
#[doc(hidden)]
pub mod private {
    pub use crate::message_field as field;
    pub use crate::schema::{is_cdr_layout, layout_hash, type_name_bytes};
    pub use {iceoryx2, zerocopy};
}

/// Text of at most `N - 1` bytes in a fixed field: cut at a character's border and filled with zeros.
pub fn text<const N: usize>(s: &str) -> [u8; N] {
    let mut end = s.len().min(N.saturating_sub(1));
    while !s.is_char_boundary(end) {
        end -= 1;
    }
    let mut bytes = [0; N];
    bytes[..end].copy_from_slice(&s.as_bytes()[..end]);
    bytes
}

/// The text in a fixed field, up to the first zero; what is not UTF-8 reads as an empty string.
pub fn text_of(bytes: &[u8]) -> &str {
    let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    core::str::from_utf8(&bytes[..end]).unwrap_or("")
}
