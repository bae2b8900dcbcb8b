//! A quiet laboratory for physics tests: the default one without noise, air and losses.
#![allow(clippy::unwrap_used, clippy::expect_used, dead_code, unreachable_pub)]

use fss_plant::{Effect, Plant, Simulation};

/// The default laboratory with ideal valves and sensors, still air and a tank that never ends.
pub fn quiet() -> Plant {
    let mut plant = Plant::default_laboratory().unwrap();
    plant.disturbance = None;
    plant.tank = None;
    plant.battery = None;
    plant.valves = fss_plant::Valves::default();
    plant.sensors.mocap_position_m = 0.0;
    plant.sensors.mocap_angle_rad = 0.0;
    plant.sensors.mocap_latency_s = 0.0;
    plant.sensors.gyro_rad_s = 0.0;
    plant.sensors.gyro_bias_rad_s = 0.0;
    plant.sensors.gyro_bias_walk_rad_s_sqrt_s = 0.0;
    plant.sensors.encoder_rad = 0.0;
    plant.sensors.encoder_rate_rad_s = 0.0;
    plant.sensors.current_a = 0.0;
    plant.sensors.torque_n_m = 0.0;
    for link in &mut plant.links {
        link.battery = None;
    }
    plant
}

/// The quiet laboratory without its arm.
pub fn bare_base() -> Plant {
    let mut plant = quiet();
    plant.links.clear();
    plant
}

/// One link on a clamped base: its inertia about the joint is [`ONE_LINK_INERTIA`].
pub fn one_link() -> Plant {
    let mut plant = quiet();
    plant.base.clamped = true;
    plant.thrusters.clear();
    plant.links.truncate(1);
    let link = &mut plant.links[0];
    link.coulomb_friction_n_m = 0.0;
    link.viscous_friction_n_m_s_rad = 0.0;
    link.joint_limit_rad = 100.0;
    plant
}

/// Of [`one_link`] about its joint [kg m^2].
pub const ONE_LINK_INERTIA: f64 = 0.034 + 2.88 * 0.1915 * 0.1915;

/// The effect with these parameters, by name.
pub fn effect(id: &str, parameters: &[(&str, f64)]) -> Effect {
    let mut effect = Effect::new(id).unwrap();
    for (name, value) in parameters {
        effect.set(name, *value).unwrap();
    }
    effect
}

/// A simulation of `plant` with `effects`.
pub fn simulate(plant: &Plant, effects: &[Effect]) -> Simulation {
    let plant = plant.with_effects(effects);
    for effect in effects {
        effect.validate(&plant).unwrap();
    }
    Simulation::new(&plant, 1).unwrap()
}

/// Asserts that two numbers agree within `tolerance`.
#[track_caller]
pub fn close(actual: f64, expected: f64, tolerance: f64) {
    assert!((actual - expected).abs() <= tolerance, "{actual} is not {expected} within {tolerance}");
}
