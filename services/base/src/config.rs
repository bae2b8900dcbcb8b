//! What the controller knows of the vehicle, and how it is tuned.

use crate::allocation::Wrench;
use fss_messages::Parameters;
use fss_multibody::Model;
use fss_plant::{Grasped, Physics, Plant};

/// Shortest pulse of a thruster where the valve allows it, s.
const SHORTEST_PULSE_S: f64 = 0.05;

/// What the controller is told.
#[derive(Clone, Debug)]
pub struct BaseConfig {
    /// The vehicle with its arm.
    pub model: Model,
    /// The same with the plant's target held by its handle, where there is one.
    pub compound: Option<Model>,
    /// Wrench of each thruster in body axes about the base frame's origin, N and N m.
    pub thruster_wrenches: Vec<Wrench>,
    /// Shortest time for which a valve opens, s. Longer than what the valve could do: a thruster opens when it owes a whole
    /// pulse, and what navigation's noise makes it owe is taken back before it comes to that.
    pub shortest_pulse_s: f64,
    /// The controller's period, s.
    pub period_s: f64,
    /// Bandwidth of the pose loop, rad/s.
    pub bandwidth_rad_s: f64,
    /// Damping ratio of the pose loop.
    pub damping_ratio: f64,
    /// Wanted accelerations below which nothing is done: m/s2, m/s2, rad/s2.
    pub dead_band: [f64; 3],
}

impl BaseConfig {
    /// For a plant with the effects that it has from the start, stepped `rate_hz` times a second.
    pub fn from_plant(plant: &Plant, model: Model, rate_hz: f64) -> Self {
        let mut config = Self {
            compound: compound(plant),
            model,
            thruster_wrenches: wrenches(&Physics::at(plant, 0.0)),
            shortest_pulse_s: plant.valves.min_on_s.max(SHORTEST_PULSE_S),
            period_s: 1.0 / rate_hz,
            bandwidth_rad_s: 0.0,
            damping_ratio: 0.0,
            dead_band: [0.0; 3],
        };
        config.tune(&Parameters::defaults());
        config
    }

    /// Takes the values of what can be tuned.
    pub(crate) fn tune(&mut self, values: &Parameters) {
        let (linear, angular) = (values.base_dead_band_m_s2, values.base_dead_band_rad_s2);
        self.bandwidth_rad_s = values.base_bandwidth_rad_s;
        self.damping_ratio = values.base_damping_ratio;
        self.dead_band = [linear, linear, angular];
    }

    /// The values of what can be tuned.
    pub(crate) fn tuned(&self) -> Parameters {
        Parameters {
            base_bandwidth_rad_s: self.bandwidth_rad_s,
            base_damping_ratio: self.damping_ratio,
            base_dead_band_m_s2: self.dead_band[0],
            base_dead_band_rad_s2: self.dead_band[2],
            ..Parameters::silent()
        }
    }
}

/// The vehicle with the target held by its handle: its centre lies one radius beyond the tip.
fn compound(plant: &Plant) -> Option<Model> {
    let (target, link) = (plant.target.as_ref()?, plant.links.last()?);
    let mut physics = Physics::at(plant, 0.0);
    physics.grasped = Some(Grasped {
        mass_kg: target.mass_kg,
        inertia_kg_m2: target.inertia_kg_m2,
        at_m: [link.length_m + target.radius_m, 0.0],
    });
    physics.model(0.0).ok()
}

/// What each valve line does to the base: its wrench in base axes about the base's origin, N and N m.
pub fn wrenches(physics: &Physics) -> Vec<Wrench> {
    let mut wrenches = vec![[0.0; 3]; physics.thrusters.len()];
    for thruster in &physics.thrusters {
        let ([x, y], (sin, cos)) = (thruster.position_m, thruster.direction_rad.sin_cos());
        if let Some(wrench) = wrenches.get_mut(thruster.line) {
            *wrench = [cos, sin, x * sin - y * cos].map(|share| share * thruster.thrust_n());
        }
    }
    wrenches
}
