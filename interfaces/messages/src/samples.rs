//! The samples themselves, by what they tell.

mod commanded;
mod housekeeping;
mod measured;
mod truth;
mod tuned;

use crate::SampleVisitor;

pub use commanded::*;
pub use housekeeping::*;
pub use measured::*;
pub use truth::*;
pub use tuned::*;

/// Calls the visitor with each sample type.
pub fn visit_samples(visitor: &mut impl SampleVisitor) {
    measured::visit(visitor);
    commanded::visit(visitor);
    housekeeping::visit(visitor);
    truth::visit(visitor);
    tuned::visit(visitor);
}
