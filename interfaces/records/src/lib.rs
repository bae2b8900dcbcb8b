//! To disk and back: MCAP logs of the stack's own ([`log`]), and measured experiments ([`experiment`]).

pub mod experiment;
pub mod log;
