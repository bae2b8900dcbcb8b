//! The mission file: what it says.
//!
//! ```toml
//! name = "reach"
//! description = "A straight line of the end-effector while the base floats freely."
//!
//! [initial]                    # how the laboratory starts; what is left out is zero
//! q_deg = [-30, 60, -60, 30]   # encoder angles
//! x_m = -0.6                   # base in the table frame: x_m, y_m, theta_deg
//!                              # and rates: qd_deg_s, vx_m_s, vy_m_s, omega_deg_s
//! [[phase]]
//! name = "line"
//! duration_s = 20              # goals are reached in this time
//! settle_s = 5                 # and kept for this long
//! base = { goal = "free" }     # or "hold", or "goto" with x_m, y_m, theta_deg and perhaps relative = true
//! arm = { goal = "line", length_m = 0.1, direction_deg = 240, keep_orientation = false }
//!                              # or "zero-reaction" with the same keys, "joints" with q_deg, "hold", "off"
//! ```
//!
//! Two goals excite the vehicle for identification, with no feedback from where it is:
//!
//! ```toml
//! # thrusters (from 1) open together at a time of the phase for a time, in steps of the mission's own rate
//! base = { goal = "valves", pulses = [{ at_s = 1, for_s = 0.5, thrusters = [1, 2] }] }
//! # joints (from 1) move in sines about q_deg, which fade in and out
//! arm = { goal = "sines", q_deg = [-30, 60, -60, 30], sines = [
//!     { joint = 1, amplitude_deg = 15, frequency_Hz = 0.1, phase_deg = 0 },
//! ] }
//! ```
//!
//! `[network.NAME]` and `[[fault]]` tables, as in a fault file, belong to the simulated laboratory and are not read here.

mod check;
mod raw;

use crate::error::{Fault, MissionError};
use fss_plant::Plant;

/// A mission: a start and phases.
#[derive(Clone, Debug, PartialEq)]
pub struct Mission {
    /// Its name.
    pub name: String,
    /// What it shows, a sentence or two.
    pub description: String,
    /// How the simulated laboratory starts.
    pub initial: Initial,
    /// The phases in their order; at least one.
    pub phases: Vec<Phase>,
}

/// The state in which the simulated laboratory starts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Initial {
    /// Base in the table frame: x m, y m, theta rad.
    pub base_pose: [f64; 3],
    /// Its rates in table axes: m/s, m/s, rad/s.
    pub base_rate: [f64; 3],
    /// Encoder angles, rad; empty where the file gives none, which means zero for every joint.
    pub q_rad: Vec<f64>,
    /// Joint rates, rad/s; empty where the file gives none.
    pub qd_rad_s: Vec<f64>,
}

/// A time in which base and arm have one goal each.
#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    /// Its name, for events and reports.
    pub name: String,
    /// Time in which the goals are reached, s.
    pub duration_s: f64,
    /// Time for which they are kept before the next phase begins, s.
    pub settle_s: f64,
    /// What the base does.
    pub base: BaseGoal,
    /// What the arm does.
    pub arm: ArmGoal,
}

/// What the base does in a phase.
#[derive(Clone, Debug, PartialEq)]
pub enum BaseGoal {
    /// Thrusters shut.
    Free,
    /// Stays where the phase before wanted it, or where it is.
    Hold,
    /// Goes to a pose.
    Goto {
        /// x m, y m, theta rad in the table frame.
        pose: [f64; 3],
        /// Whether `pose` is added to where the base is (in table axes) when the phase begins.
        relative: bool,
    },
    /// Valves open and shut by the clock, whatever the base does.
    Valves(Vec<Pulse>),
}

/// A time in which valves are open.
#[derive(Clone, Debug, PartialEq)]
pub struct Pulse {
    /// When they open, from the start of the phase, s.
    pub at_s: f64,
    /// For how long, s.
    pub for_s: f64,
    /// Thrusters, from 0.
    pub thrusters: Vec<usize>,
}

/// A sine of one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sine {
    /// The joint, from 0.
    pub joint: usize,
    /// Amplitude, rad.
    pub amplitude_rad: f64,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Phase at the start of the phase, rad.
    pub phase_rad: f64,
}

/// What the arm does in a phase.
#[derive(Clone, Debug, PartialEq)]
pub enum ArmGoal {
    /// Drivers off.
    Off,
    /// Joints stay where they are.
    Hold,
    /// Joints move to these encoder angles, rad.
    Joints(Vec<f64>),
    /// Joints move in sines, at most [`MAX_SINES`](fss_messages::MAX_SINES) each.
    Sines {
        /// Encoder angles about which they move, rad.
        about_rad: Vec<f64>,
        /// The sines.
        sines: Vec<Sine>,
    },
    /// The end-effector moves along a straight line in the table frame.
    Line {
        /// Length, m.
        length_m: f64,
        /// Direction, rad from the table's x axis.
        direction_rad: f64,
        /// Whether the end-effector keeps its orientation.
        keep_orientation: bool,
        /// Whether the arm alone keeps the base from turning.
        zero_reaction: bool,
    },
}

impl Mission {
    /// Reads a mission file's text. What depends on the plant is left to [`Self::parse_for`].
    ///
    /// # Errors
    /// Says where the text is malformed or contradicts itself, and what to do.
    pub fn parse(text: &str) -> Result<Self, MissionError> {
        Self::read(text, None)
    }

    /// Reads a mission file's text for a plant: goals and start must lie within its joint limits, reach and table.
    ///
    /// # Errors
    /// Says where the text is malformed, contradicts itself or does not fit the plant, and what to do.
    pub fn parse_for(text: &str, plant: &Plant) -> Result<Self, MissionError> {
        Self::read(text, Some(plant))
    }

    fn read(text: &str, plant: Option<&Plant>) -> Result<Self, MissionError> {
        toml::from_str::<raw::Mission>(text)
            .map_err(|error| Fault::from_toml(&error))
            .and_then(|raw| check::mission(raw, plant))
            .map_err(|fault| fault.in_text(text))
    }

    /// Time from the start of the first phase to the end of the last, s.
    pub fn duration_s(&self) -> f64 {
        self.phases.iter().map(|phase| phase.duration_s + phase.settle_s).sum()
    }
}
