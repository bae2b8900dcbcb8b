//! What the arm does in a phase, and why it cannot.

use crate::ArmConfig;
use crate::line::{Ask, Line};
use crate::profile::{PEAK_RATE, quintic};
use crate::reference::Reference;
use crate::sines::Sines;
use core::fmt;
use fss_messages::MissionState;
use fss_multibody::JointVector;

/// What the arm does in this phase.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant)] // a box would allocate while the arm works
pub(crate) enum Task {
    /// Drivers off.
    Off,
    /// Joints stand.
    Hold,
    /// Joints move to given angles.
    Joints(JointMove),
    /// Joints go to where the mission wants them now.
    Follow,
    /// Joints move in sines.
    Sines(Sines),
    /// A line that has not yet begun.
    LineToBegin(Ask),
    /// A line under way.
    Line(Line),
}

impl Task {
    /// What `mission` asks for, `late_s` after its phase began.
    pub(crate) fn of(mission: &MissionState, config: &ArmConfig, reference: &Reference, late_s: f64) -> Self {
        match mission.arm_mode {
            MissionState::ARM_OFF => Self::Off,
            MissionState::ARM_JOINTS => {
                let to = JointVector::from_column_slice(&mission.q_goal_rad);
                Self::Joints(JointMove::new(config, reference, to, mission.arm_duration_s - late_s))
            }
            MissionState::ARM_FOLLOW => Self::Follow,
            MissionState::ARM_SINES => Self::Sines(Sines::of(mission, config, reference, late_s)),
            MissionState::ARM_LINE
            | MissionState::ARM_LINE_POSE
            | MissionState::ARM_ZERO_REACTION
            | MissionState::ARM_ZERO_REACTION_POSE
            | MissionState::ARM_CAPTURE => Self::LineToBegin(Ask::of(mission)),
            _ => Self::Hold,
        }
    }
}

/// A motion of all joints to given angles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JointMove {
    from: JointVector,
    to: JointVector,
    clock_s: f64,
    pub(crate) duration_s: f64,
}

impl JointMove {
    /// From the reference to the angles `to`, in `wanted_s` or as fast as the rate limits allow.
    pub(crate) fn new(config: &ArmConfig, reference: &Reference, to: JointVector, wanted_s: f64) -> Self {
        let from = reference.q_rad;
        let mut motion = Self { from, to: from, clock_s: 0.0, duration_s: wanted_s.max(0.1) };
        for i in 0..config.model.link_count() {
            let reach = (config.limit_rad[i] - config.margin_rad).max(0.0);
            motion.to[i] = to[i].clamp(-reach, reach);
            let fastest_s = PEAK_RATE * (motion.to[i] - from[i]).abs() / config.max_rate_rad_s[i];
            motion.duration_s = motion.duration_s.max(fastest_s);
        }
        motion
    }

    /// The rest of the motion, from where the reference was stopped.
    pub(crate) fn resumed(&self, config: &ArmConfig, reference: &Reference) -> Self {
        Self::new(config, reference, self.to, self.duration_s - self.clock_s)
    }

    /// Whether the motion has left the reference that it moves.
    pub(crate) fn was_interrupted(&self, reference: &Reference) -> bool {
        let (share, _) = quintic(self.clock_s, self.duration_s);
        (self.from + (self.to - self.from) * share - reference.q_rad).amax() > 1e-9
    }

    /// Moves the reference on; returns the share done.
    pub(crate) fn advance(&mut self, reference: &mut Reference, dt_s: f64) -> f64 {
        self.clock_s += dt_s;
        let (share, rate) = quintic(self.clock_s, self.duration_s);
        reference.q_rad = self.from + (self.to - self.from) * share;
        reference.qd_rad_s = (self.to - self.from) * rate;
        share
    }
}

/// Why the arm cannot go on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Blocked {
    Singular(f64),
    Limits,
    OffTheLine(f64),
    JointLags(usize),
    Late,
}

impl fmt::Display for Blocked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Singular(sigma) => write!(f, "singular, smallest singular value {sigma:.2e}"),
            Self::Limits => write!(f, "joint limits leave no way along the line"),
            Self::OffTheLine(m) => write!(f, "the end-effector is {:.1} mm off its line", m * 1e3),
            Self::JointLags(i) => write!(f, "joint {} does not follow", i + 1),
            Self::Late => write!(f, "the line had begun without this controller, which cannot know where"),
        }
    }
}
