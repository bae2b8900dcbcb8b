//! Where a simulation differs from what was measured, and why: examine, linearize, whiten, search, conclude.
//!
//! - [`block`]: what the search needs of a set of channels of one run.

pub mod block;
pub mod joints;
