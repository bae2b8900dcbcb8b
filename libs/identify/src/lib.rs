//! Where a simulation differs from what was measured, and why.
//!
//! - [`diagnosis`]: the whole answer.
//! - [`inputs`]: whether the commands of a run belong to its motion.
//! - [`misfit`]: the plant simulated in windows with a free initial state, and its error over what noise alone would give.

mod clamped;
mod contest;
pub mod diagnosis;
mod empirical;
mod evidence;
mod floating;
mod hypothesis;
mod in_motion;
pub mod inputs;
pub mod misfit;
mod normal;
mod prediction;
mod search;
mod sensitivity;
mod tolerance;
mod trial;
mod uncertain;
pub mod unexplained;
mod verdict;

pub use fss_estimation::smoothing as smoother;
