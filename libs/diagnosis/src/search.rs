//! The search: marginal likelihoods of sets of causes, the noise's strength inferred with each.
//!
//! A set of causes is judged at the hyper-parameters that suit it best: at the strength that the empty set needs, all causes
//! look alike; a cause shows at the strength that it leaves. So the sets are compared on a ladder of strengths, the best set's
//! hyper-parameters are optimized, everything is linearized anew about it, until set and values stand still.
//!
//! In the order of reading:
//!
//! - `space`: causes, sets of them, and the hyper-parameters at which they are compared.
//! - `sets`: priors and marginal likelihoods of sets, the beam search; `hyper`: the hyper-parameters that suit a set.
//! - `no_cause`: the runs without causes.
//! - `shortlist`, `shapes`, `estimate`, `course`: the candidates of a round, the estimate of its best set, the rounds.
//! - `standing`: where it stands still; `searched`: what it came to; `intervals`: how well that is known.
//! - `contacts`: play in joints, about itself; `wiring`: wirings of the thrusters.

mod contacts;
mod course;
mod estimate;
mod hyper;
mod in_joints;
mod intervals;
mod no_cause;
mod searched;
mod sets;
mod shapes;
mod shortlist;
mod space;
mod standing;
mod wiring;

pub(crate) use contacts::{Contact, contact};
pub(crate) use course::search;
pub(crate) use intervals::Estimate;
pub(crate) use no_cause::{NoCause, without_causes, without_causes_at};
pub(crate) use searched::Searched;
pub(crate) use sets::{SIZES, log_sum};
pub(crate) use space::Found;
pub(crate) use standing::Standing;
pub(crate) use wiring::{Rewired, rewired};
