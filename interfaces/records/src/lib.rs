//! To disk and back: MCAP logs of the stack's own ([`log`]), measured experiments ([`experiment`]), and tables for other
//! programs ([`table`]).

pub mod experiment;
pub mod log;
pub mod table;
