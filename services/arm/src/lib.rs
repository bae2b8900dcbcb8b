//! The arm controller: joint motions, straight lines of the end-effector, zero-reaction maneuvers.
//!
//! # How it works
//!
//! The controller integrates a reference `q_ref` of its own, which the joints' position loops follow; what it commands is
//! `q_ref` and its rate, so that a link can move on between two of its five commands a second. Nothing drifts while the
//! arm holds, because the reference stands still.
//!
//! A line of the end-effector is resolved motion (Whitney 1969) on a floating base: joint rates `qd` with
//!
//! ```text
//! Jg qd = v_goal + k (x_goal - x) - v_drift       rows vx, vy and for a pose the angle
//! h  qd = -omega_drift - k_theta (theta - theta_0)    the base's rate; only in a zero-reaction maneuver
//! ```
//!
//! with the generalized Jacobian `Jg` (Umetani and Yoshida 1989), the reaction vector `h`, the base's rate per joint
//! rate at zero momentum (Yoshida, Hashizume and Abiko 2001), and the motion `v_drift`, `omega_drift` that the measured
//! momentum makes by itself. What freedom is left turns the joints towards the middle of their range (Liegeois 1977).
//! The position along the line follows a quintic time law. The [`inverse`] respects rate and
//! joint limits: a joint at its limit is locked and the rest solved again; where that cannot be, the line is slowed, and
//! where it comes to a stop, the arm is *blocked*: it says so and holds.
//!
//! # What it does when something is wrong
//!
//! | what | what it does |
//! | --- | --- |
//! | telemetry never came | drivers off |
//! | telemetry, navigation (on a line) or mission stale | slows down evenly, holds, goes on when it is back |
//! | a driver is off | its reference stays at the measured angle; the others hold |
//! | singular, at limits, off the line, a joint does not follow | blocked: holds until the next phase |
//! | restarted in the middle of a line | blocked: it cannot know where the line began |
//!
//! Nothing is kept over a restart; the reference begins at the measured angles.

mod config;
mod estimate;
pub mod inverse;
mod line;
mod profile;
mod program;
mod reference;
mod service;
mod sines;
mod task;
mod tracker;

pub use config::{ArmConfig, Drive};
pub use program::Config;
pub use service::{ArmService, Inputs, Outputs};
