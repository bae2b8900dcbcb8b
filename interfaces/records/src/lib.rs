//! To disk and back: MCAP logs of the stack's own ([`log`]), and measured experiments (`fss-experiment/1`).

pub mod log;
