//! What a laboratory is besides its plant: the start of the run, the networks, the faults on purpose.

use crate::{LabError, Network};
use fss_plant::{MAX_LINKS, Plant};
use fss_wire::link::Key;
use fss_wire::mocap::{NAMES as OBJECTS, Tracker};
use serde::{Deserialize, Serialize};

/// Where everything is when the run starts. Joints beyond those given are at zero.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Start {
    /// Base frame in the table frame (m, m, rad).
    pub pose: [f64; 3],
    /// Its velocity, table axes (m/s, m/s, rad/s).
    pub velocity: [f64; 3],
    /// Joint angles (rad).
    pub q_rad: [f64; MAX_LINKS],
    /// Joint rates (rad/s).
    pub qd_rad_s: [f64; MAX_LINKS],
    /// Pose and velocity of the target, where they are others than in the plant file (m, m, rad and per second).
    pub target: Option<[[f64; 3]; 2]>,
}

/// A fault of a device and when it is there. Faults of the plant itself (a stuck valve, a leak) are its effects.
///
/// In a file: `{ from_s = 5, to_s = 6, kind = "mocap_silent" }`, or `kind = { link_dead = { link = 2 } }`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// Start, from the start of the run (s).
    pub from_s: f64,
    /// End (s).
    pub to_s: f64,
    /// What is wrong.
    pub kind: FaultKind,
}

/// What can be wrong with a device. Links count from 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum FaultKind {
    /// Motion capture sends nothing.
    #[serde(alias = "vicon_silent")]
    MocapSilent,
    /// Motion capture has lost one object: VICON sends exact zeros for it, NatNet flags it, VRPN says nothing of it.
    #[serde(alias = "vicon_zeros")]
    MocapZeros {
        /// The object's name.
        object: String,
    },
    /// Motion capture repeats its last frame, number and all.
    #[serde(alias = "vicon_frozen")]
    MocapFrozen,
    /// Motion capture sees one object beside where it is.
    #[serde(alias = "vicon_jump")]
    MocapJump {
        /// The object's name.
        object: String,
        /// Shift in the table frame (m).
        x_m: f64,
        /// Shift in the table frame (m).
        y_m: f64,
    },
    /// The gyro sends nothing.
    GyroSilent,
    /// The gyro flags its readings as faulty, and they are.
    GyroInvalid,
    /// A link is switched off: it hears nothing, says nothing and its driver is off.
    LinkDead {
        /// The link.
        link: usize,
    },
    /// A link's servo driver reports a fault and is off; the link goes on talking.
    DriverFault {
        /// The link.
        link: usize,
    },
    /// A link's telemetry repeats the encoder angle that it had when this began.
    EncoderStuck {
        /// The link.
        link: usize,
    },
    /// A link's torque sensor is at the end of its range.
    TorqueSaturated {
        /// The link.
        link: usize,
    },
    /// A link's own clock is wrong by this much.
    LinkClockStep {
        /// The link.
        link: usize,
        /// Late where positive (s).
        step_s: f64,
    },
    /// A valve does not open, whatever its line says. (A weak one is the plant's `thruster_gain`.)
    ValveStuckShut {
        /// The thruster, from 1.
        thruster: usize,
    },
    /// A valve does not shut, whatever its line says.
    ValveStuckOpen {
        /// The thruster, from 1.
        thruster: usize,
    },
}

/// Everything about a laboratory that is not in the plant file.
#[derive(Debug, Clone)]
pub struct LabConfig {
    /// Of all random numbers: two laboratories with one seed give the same bytes.
    pub seed: u64,
    /// Where everything starts.
    pub start: Start,
    /// Shared with the `links` service.
    pub key: Key,
    /// The period of the gyro's own clock over its nominal period, less one; the unit's manual allows 2 to 3 %.
    pub gyro_clock_error: f64,
    /// The motion capture system.
    pub tracker: Tracker,
    /// What happens to its frames on their way; the tracker's own latency is in the plant file.
    pub mocap: Network,
    /// What happens to gyro lines on their way, beside the time that the serial line takes.
    pub gyro: Network,
    /// What happens to commands on their way to each link.
    pub link_up: Network,
    /// What happens to telemetry on its way from each link.
    pub link_down: Network,
    /// Devices that fail.
    pub faults: Vec<Fault>,
}

impl LabConfig {
    /// A laboratory in which nothing fails: clean networks, 2 to 8 ms on the links' Wi-Fi.
    pub fn new(seed: u64, key: Key) -> Self {
        let wifi = Network { delay_s: 0.002, jitter_s: 0.006, ..Network::default() };
        Self {
            seed,
            start: Start::default(),
            key,
            gyro_clock_error: 0.025,
            tracker: Tracker::default(),
            mocap: Network::default(),
            gyro: Network::default(),
            link_up: wifi,
            link_down: wifi,
            faults: Vec::new(),
        }
    }

    /// Refuses what makes no sense, alone or with this plant.
    pub(crate) fn check(&self, plant: &Plant) -> Result<(), LabError> {
        let refuse = |what: String| Err(LabError::Config { what });
        if !(-0.5..=0.5).contains(&self.gyro_clock_error) {
            return refuse(format!("a gyro clock that is {} off is none", self.gyro_clock_error));
        }
        let networks =
            [("mocap", self.mocap), ("gyro", self.gyro), ("link_up", self.link_up), ("link_down", self.link_down)];
        for (name, network) in networks {
            if let Some(fault) = network.fault() {
                return refuse(format!("network {name}: {fault}"));
            }
        }
        let links = plant.link_count();
        for fault in &self.faults {
            if !fault.from_s.is_finite() || fault.to_s.is_nan() || fault.to_s < fault.from_s {
                return refuse(format!("{:?} ends before it begins: {} to {} s", fault.kind, fault.from_s, fault.to_s));
            }
            if let Some(link) = fault.kind.link()
                && !(1..=links).contains(&link)
            {
                return refuse(format!("{:?}: links are 1 to {links}", fault.kind));
            }
            let thrusters = plant.thrusters.len();
            if let Some(thruster) = fault.kind.thruster()
                && !(1..=thrusters).contains(&thruster)
            {
                return refuse(format!("{:?}: thrusters are 1 to {thrusters}", fault.kind));
            }
            if let Some(object) = fault.kind.object()
                && !OBJECTS.contains(&object)
            {
                return refuse(format!("{:?}: motion capture tracks {}", fault.kind, OBJECTS.join(", ")));
            }
        }
        Ok(())
    }
}

impl FaultKind {
    fn link(&self) -> Option<usize> {
        match self {
            Self::LinkDead { link }
            | Self::DriverFault { link }
            | Self::EncoderStuck { link }
            | Self::TorqueSaturated { link }
            | Self::LinkClockStep { link, .. } => Some(*link),
            _ => None,
        }
    }

    fn thruster(&self) -> Option<usize> {
        match self {
            Self::ValveStuckShut { thruster } | Self::ValveStuckOpen { thruster } => Some(*thruster),
            _ => None,
        }
    }

    fn object(&self) -> Option<&str> {
        match self {
            Self::MocapZeros { object } | Self::MocapJump { object, .. } => Some(object),
            _ => None,
        }
    }
}

/// The faults that are there at one time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ActiveFaults<'a> {
    faults: &'a [Fault],
    t_s: f64,
}

impl<'a> ActiveFaults<'a> {
    pub(crate) fn at(faults: &'a [Fault], t_s: f64) -> Self {
        Self { faults, t_s }
    }

    pub(crate) fn kinds(self) -> impl Iterator<Item = &'a FaultKind> {
        let active = move |fault: &&Fault| (fault.from_s..fault.to_s).contains(&self.t_s);
        self.faults.iter().filter(active).map(|fault| &fault.kind)
    }

    /// By how much a link's own clock is late (s).
    pub(crate) fn clock_step_s(self, link: usize) -> f64 {
        let step = |kind: &FaultKind| match kind {
            FaultKind::LinkClockStep { link: l, step_s } if *l == link => *step_s,
            _ => 0.0,
        };
        self.kinds().map(step).sum()
    }

    /// Which valves are open when the lines say `mask`.
    pub(crate) fn valves(self, mask: u16) -> u16 {
        self.kinds().fold(mask, |mask, kind| match kind {
            FaultKind::ValveStuckShut { thruster } => mask & !(1 << (thruster - 1)),
            FaultKind::ValveStuckOpen { thruster } => mask | 1 << (thruster - 1),
            _ => mask,
        })
    }

    pub(crate) fn has(self, kind: &FaultKind) -> bool {
        self.kinds().any(|active| active == kind)
    }
}
