//! Why a mission cannot go on.

/// Why the mission cannot go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trouble {
    Navigation,
    NavigationLost,
    Telemetry,
    Link(usize),
    LinkFault(usize, u8),
    ArmController,
    ArmBlocked,
    TargetLost,
    TargetDropped,
    TimedOut,
    OffTable,
    Commanded,
}

impl Trouble {
    /// Whether waiting cannot mend it.
    pub(crate) fn is_final(self) -> bool {
        matches!(self, Self::NavigationLost | Self::OffTable) || self.leaves_a_way_out()
    }

    /// Whether the vehicle can still fly a way out.
    pub(crate) fn leaves_a_way_out(self) -> bool {
        matches!(self, Self::ArmBlocked | Self::TargetLost | Self::TargetDropped | Self::TimedOut | Self::Commanded)
    }
}

impl core::fmt::Display for Trouble {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Navigation => write!(f, "no navigation state: is fusion running, are motion capture and gyro on?"),
            Self::NavigationLost => write!(f, "navigation is lost"),
            Self::Telemetry => write!(f, "no telemetry: is links running?"),
            Self::Link(i) => write!(f, "link {} is silent", i + 1),
            Self::LinkFault(i, bits) => write!(f, "link {} reports fault bits {bits:#04x}", i + 1),
            Self::ArmController => write!(f, "the arm controller is silent"),
            Self::ArmBlocked => write!(f, "the arm is blocked: joint limits or a singularity end its line here"),
            Self::TargetLost => write!(f, "the target is lost: motion capture does not see it"),
            Self::TargetDropped => write!(f, "the target is not held any more: the gripper has lost it"),
            Self::TimedOut => write!(f, "the phase's condition did not come in time"),
            Self::OffTable => write!(f, "the base is about to leave the table"),
            Self::Commanded => write!(f, "the ground commands it"),
        }
    }
}
