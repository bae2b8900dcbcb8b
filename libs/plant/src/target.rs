//! The state of a passive body on the table.

use crate::parts;

/// A passive disc in motion.
#[derive(Debug, Clone)]
pub(crate) struct Target {
    pub(crate) body: parts::Target,
    pub(crate) pose: [f64; 3],
    pub(crate) velocity: [f64; 3],
    /// Where it is held in the last link's frame: joint to its centre, and its heading there.
    pub(crate) held: Option<[f64; 3]>,
    /// All that the tip has pushed it so far, table axes (N s).
    pub(crate) pushed_n_s: [f64; 2],
}

impl Target {
    pub(crate) fn new(body: &parts::Target) -> Self {
        Self { pose: body.pose, velocity: body.velocity, body: body.clone(), held: None, pushed_n_s: [0.0; 2] }
    }
}
