//! Where a simulation differs from what was measured, and why.
//!
//! - [`diagnosis`]: the whole answer.
//! - [`inputs`]: whether the commands of a run belong to its motion.

mod contest;
pub mod diagnosis;
mod empirical;
mod evidence;
mod floating;
mod hypothesis;
mod in_motion;
pub mod inputs;
mod misfit;
mod normal;
mod prediction;
mod sensitivity;
mod tolerance;
mod trial;
pub mod unexplained;
mod verdict;
