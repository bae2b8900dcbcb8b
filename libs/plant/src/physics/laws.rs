//! Forces and torques that effects add to the motion.

use crate::about::MAX_PARAMETERS;

/// What a force on the base may depend on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaseMotion {
    /// Time since the start of the run (s).
    pub t_s: f64,
    /// Base frame in the table frame (m, m, rad).
    pub pose: [f64; 3],
    /// Its velocity, table axes (m/s, m/s, rad/s).
    pub velocity: [f64; 3],
}

/// A force on the base: table axes, about the base frame's origin (N, N, N m).
#[derive(Debug, Clone, Copy)]
pub struct BaseLaw {
    /// The law, from the effect's file.
    pub law: fn(&[f64; MAX_PARAMETERS], &BaseMotion) -> [f64; 3],
    /// The effect's parameters.
    pub values: [f64; MAX_PARAMETERS],
    /// Whether it depends on the velocity.
    pub depends_on_velocity: bool,
}

impl PartialEq for BaseLaw {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::fn_addr_eq(self.law, other.law) && self.values == other.values
    }
}

/// A smooth torque on a link at its joint, beside the drive (N m).
#[derive(Debug, Clone, Copy)]
pub struct JointLaw {
    /// Which joint, from 0.
    pub joint: usize,
    /// The law of time, joint angle and rate, from the effect's file.
    pub law: fn(&[f64; MAX_PARAMETERS], f64, f64, f64) -> f64,
    /// The effect's parameters.
    pub values: [f64; MAX_PARAMETERS],
}

impl PartialEq for JointLaw {
    fn eq(&self, other: &Self) -> bool {
        self.joint == other.joint && std::ptr::fn_addr_eq(self.law, other.law) && self.values == other.values
    }
}
