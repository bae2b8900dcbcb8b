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
//! A phase ends with its time, or with a condition:
//!
//! ```toml
//! [[phase]]
//! duration_s = 5
//! until = { condition = "still", speed_m_s = 0.002, omega_deg_s = 0.1, for_s = 2 }
//!                              # or "arrived" (also distance_m), "target-seen", "grasped", "released"
//! timeout_s = 120              # where the condition has not come, or the target is lost, the mission is aborted:
//! on_abort = "back off"        # it flies the [[abort]] phase of this name and then ends
//! base = { goal = "stop" }     # stop turning and drifting with the least gas
//! arm = { goal = "hold" }
//! ```
//!
//! A mission with a `[target]` captures it: the base's goal `"meet"` brings the end-effector, as the arm stands, to
//! `standoff_m` before the target's handle and lets it drift with the target; the arm's goal `"capture"` leads it to the
//! handle; `gripper = "closed"` arms the gripper from this phase on; what it holds the base's goal `"carry"` takes to
//! x_m, y_m, theta_deg in the table frame, and the condition `"released"` waits until nothing is held. `[initial.draw]` and `[target.draw]` are ranges from
//! which a run's seed draws ([`Mission::drawn`]). `[limits] gas_g` bounds what the mission may use.
//!
//! The goal `"follow"` of base and arm takes what comes on `/mission/goal` while the phase lasts: `bridge` publishes there what
//! nodes of ROS 2 want, as far as the launch file lets them.
//!
//! `[network.NAME]` and `[[fault]]` tables, as in a fault file, belong to the simulated laboratory and are not read here.

mod check;
mod draw;
mod raw;

pub use draw::{Draw, Ranges};

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
    /// Phases that are flown only where another phase's `on_abort` names them.
    pub aborts: Vec<Phase>,
    /// The body to be captured.
    pub target: Option<TargetBody>,
}

/// The body to be captured: a disc with a handle on its rim at the body's angle 0.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetBody {
    /// Its parameters, and where it starts before anything is drawn.
    pub body: fss_plant::Target,
    /// What a seed adds to its start.
    pub ranges: Ranges,
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
    /// What a seed adds.
    pub ranges: Ranges,
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
    /// What ends it before its time.
    pub until: Option<Until>,
    /// Which of [`Mission::aborts`] is flown where it fails.
    pub on_abort: Option<usize>,
    /// What the gripper does from now on; `None` leaves it as it is.
    pub gripper_closed: Option<bool>,
}

/// A condition that ends a phase, and how long it must hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Until {
    /// What must be.
    pub condition: Condition,
    /// For how long, s.
    pub for_s: f64,
    /// Where it has not come by then the phase has failed, s from its start.
    pub timeout_s: f64,
}

/// What can end a phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Condition {
    /// The vehicle's centre of mass and its base are nearly at rest.
    Still {
        /// Largest speed of the centre of mass, m/s.
        speed_m_s: f64,
        /// Largest rate of the base, rad/s.
        omega_rad_s: f64,
    },
    /// The base, or the target that it carries, is at its goal, and the base as fast as that.
    Arrived {
        /// Largest distance, m; as many rad of heading times half a metre.
        distance_m: f64,
        /// Largest difference of velocity, m/s.
        speed_m_s: f64,
    },
    /// The target's motion is known.
    TargetSeen,
    /// The gripper says that it holds something.
    Grasped,
    /// The gripper says that it holds nothing.
    Released,
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
    /// Stops turning and drifting with the least gas.
    Stop,
    /// Takes the target that the gripper holds to a pose; the arm is held.
    Carry {
        /// Of the target: x m, y m, theta rad in the table frame.
        pose: [f64; 3],
    },
    /// Goes to where the end-effector, as the arm stands, is before the target's handle, and drifts with the target.
    Meet {
        /// Distance of the end-effector from the handle, m.
        standoff_m: f64,
    },
    /// Stays where it is until a controller outside the stack says where it shall go, and goes there.
    Follow,
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
    /// The end-effector moves to the target's handle, and with it; the arm alone keeps the base from turning.
    Capture,
    /// Joints stay until a controller outside the stack says where they shall go, and go there.
    Follow,
}

impl Phase {
    /// Its longest time, s.
    pub fn longest_s(&self) -> f64 {
        self.until.map_or(self.duration_s + self.settle_s, |until| until.timeout_s)
    }

    /// Whether it makes sense only where the target is seen.
    pub fn needs_target(&self) -> bool {
        matches!(self.base, BaseGoal::Meet { .. } | BaseGoal::Carry { .. }) || self.arm == ArmGoal::Capture
    }
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
            .and_then(|raw| check::mission(&raw, plant))
            .map_err(|fault| fault.in_text(text))
    }

    /// Longest time from the start of the first phase to the end of the last, s.
    pub fn duration_s(&self) -> f64 {
        self.phases.iter().map(Phase::longest_s).sum()
    }

    /// The phase of this number: those of the sequence, then those of the abort paths.
    pub fn phase(&self, index: usize) -> Option<&Phase> {
        self.phases.get(index).or_else(|| self.aborts.get(index.checked_sub(self.phases.len())?))
    }
}
