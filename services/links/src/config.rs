//! Rates, patience and limits of the link communication.

use fss_messages::MAX_LINKS;
use fss_plant::Plant;

/// Full scale of a link's torque sensor where the plant file gives none, N m (the paper's load cell).
const TORQUE_RANGE_N_M: f64 = 2.1;
/// What the laboratory's Wi-Fi takes at least, ns.
const SHORTEST_TRANSIT_NS: u64 = 2_000_000;

/// What a joint must never be told to exceed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits {
    /// Encoder angle, to both sides of zero, rad.
    pub angle_rad: f64,
    /// Rate, rad/s.
    pub rate_rad_s: f64,
    /// Torque of the motor at the joint, N m.
    pub torque_nm: f64,
    /// Motor current, A.
    pub current_a: f64,
}

/// How the service speaks with its links.
#[derive(Clone, Debug, PartialEq)]
pub struct LinksConfig {
    /// One entry a link, joint 1 first.
    pub joints: Vec<JointLimits>,
    /// Torque of the largest count of the torque sensor's converter, N m.
    pub torque_range_nm: f64,
    /// Time from one command to a link to the next, ns.
    pub command_period_ns: u64,
    /// Whether the links are commanded one after another through the period; together where not.
    pub stagger: bool,
    /// An older `/arm/command` is stale: the links are told to hold, ns.
    pub max_command_age_ns: u64,
    /// A link whose last telemetry was received longer ago is not alive, ns.
    pub max_telemetry_age_ns: u64,
    /// Time from a measurement to its device time stamp, ns.
    pub stamp_latency_ns: u64,
    /// Shortest time that a datagram is under way, ns; it cannot be told from a clock offset, so it must be known.
    pub min_transit_ns: u64,
}

impl LinksConfig {
    /// For the links of a plant, 5 commands a second to each.
    pub fn new(plant: &Plant) -> Self {
        let joints = plant.links.iter().enumerate().take(MAX_LINKS).map(|(i, link)| {
            let servo = plant.servo(i);
            let by_torque = link.max_torque_n_m / link.torque_constant_n_m_a;
            JointLimits {
                angle_rad: link.joint_limit_rad,
                rate_rad_s: servo.max_rate_rad_s,
                torque_nm: link.max_torque_n_m,
                current_a: servo.max_current_a.map_or(by_torque, |own| own.min(by_torque)),
            }
        });
        Self {
            joints: joints.collect(),
            torque_range_nm: plant.sensors.torque_range_n_m.unwrap_or(TORQUE_RANGE_N_M),
            command_period_ns: 200_000_000,
            stagger: false,
            max_command_age_ns: 300_000_000,
            max_telemetry_age_ns: 1_000_000_000,
            stamp_latency_ns: (plant.sensors.link_latency_s * 1e9) as u64,
            min_transit_ns: SHORTEST_TRANSIT_NS,
        }
    }
}
