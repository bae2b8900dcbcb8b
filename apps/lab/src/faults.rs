//! What goes wrong in a run, as a file says it or as a seed draws it.

use crate::config::{Fault, FaultKind, LabConfig};
use crate::{LabError, Network};
use fss_plant::Plant;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Networks that misbehave all the time, and devices that fail for a time.
///
/// ```toml
/// [network.link_up]
/// loss = 0.05
/// delay_s = 0.002
/// jitter_s = 0.3          # more than the 0.2 s between two datagrams: they overtake each other
///
/// [[fault]]
/// from_s = 5
/// to_s = 6
/// kind = { encoder_stuck = { link = 2 } }
/// ```
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Faults {
    /// What the networks do; where one is absent it stays as it is.
    pub network: Networks,
    /// What fails.
    pub fault: Vec<Fault>,
}

/// The ways between devices and the computer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Networks {
    /// Frames of motion capture.
    #[serde(alias = "vicon", skip_serializing_if = "Option::is_none")]
    pub mocap: Option<Network>,
    /// Gyro lines.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gyro: Option<Network>,
    /// Commands to the links.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub link_up: Option<Network>,
    /// Telemetry from the links.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub link_down: Option<Network>,
}

/// What a mission file says of them, among other things.
#[derive(Default, Deserialize)]
#[serde(default)]
struct OfMission {
    network: Networks,
    fault: Vec<Fault>,
}

impl Faults {
    /// Those of a mission file, whose other tables are the mission's business.
    ///
    /// # Errors
    /// Where its `network` or `fault` tables cannot be read.
    pub fn in_mission(text: &str) -> Result<Self, toml::de::Error> {
        toml::from_str(text).map(|OfMission { network, fault }| Self { network, fault })
    }

    /// Puts them into a laboratory.
    pub fn apply_to(&self, config: &mut LabConfig) {
        let ways = [
            (self.network.mocap, &mut config.mocap),
            (self.network.gyro, &mut config.gyro),
            (self.network.link_up, &mut config.link_up),
            (self.network.link_down, &mut config.link_down),
        ];
        for (new, network) in ways {
            *network = new.unwrap_or(*network);
        }
        config.faults.extend(self.fault.iter().cloned());
    }

    /// Refuses what makes no sense with this plant.
    ///
    /// # Errors
    /// Names what it is.
    pub fn check(&self, plant: &Plant, config: &LabConfig) -> Result<(), LabError> {
        let mut config = config.clone();
        self.apply_to(&mut config);
        config.check(plant)
    }

    /// Faults of every kind for a run of `duration_s`, one beginning every `every_s` on average and none longer than 0.8 s:
    /// a flight can live through each of them. One seed gives the same faults.
    pub fn random(seed: u64, duration_s: f64, every_s: f64, plant: &Plant) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let wifi = Network { loss: 0.03, duplicate: 0.03, corrupt: 0.01, delay_s: 0.002, jitter_s: 0.03 };
        let cable = Network { loss: 0.01, duplicate: 0.01, corrupt: 0.0, delay_s: 0.0, jitter_s: 0.0005 };
        let serial = Network { corrupt: 0.01, ..Network::default() };
        let (mocap, gyro, link_up, link_down) = (Some(cable), Some(serial), Some(wifi), Some(wifi));
        let mut faults = Self { network: Networks { mocap, gyro, link_up, link_down }, fault: Vec::new() };
        let mut at_s = 0.0;
        loop {
            at_s += random.random_range(0.2..1.8) * every_s;
            if at_s >= duration_s {
                return faults;
            }
            let link = random.random_range(1..=plant.link_count().max(1));
            let thruster = random.random_range(1..=plant.thrusters.len().max(1));
            let shift = || "base".to_owned();
            let kind = match random.random_range(0..10) {
                0 => FaultKind::MocapSilent,
                1 => FaultKind::MocapZeros { object: shift() },
                2 => FaultKind::MocapFrozen,
                3 => FaultKind::MocapJump { object: shift(), x_m: random.random_range(-1.0..1.0), y_m: 0.3 },
                4 => FaultKind::GyroSilent,
                5 => FaultKind::GyroInvalid,
                6 => FaultKind::EncoderStuck { link },
                7 => FaultKind::TorqueSaturated { link },
                8 => FaultKind::LinkClockStep { link, step_s: random.random_range(-100.0..100.0) },
                _ => FaultKind::ValveStuckShut { thruster },
            };
            // Motion capture that shows the body elsewhere for longer than a reflection lasts is believed by everybody.
            let longest_s = if matches!(kind, FaultKind::MocapJump { .. }) { 0.15 } else { 0.8 };
            faults.fault.push(Fault { from_s: at_s, to_s: at_s + random.random_range(0.1..longest_s), kind });
        }
    }
}
