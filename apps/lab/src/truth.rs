//! What the laboratory knows, as a sample of `/truth/state`.

use fss_messages::{MAX_LINKS, MAX_THRUSTERS, TruthState};
use fss_plant::Simulation;

/// How often the truth is told, ns.
pub const TRUTH_PERIOD_NS: u64 = 10_000_000;

/// The truth now.
pub(crate) fn state(simulation: &Simulation, now_ns: u64, valves: u16) -> TruthState {
    let truth = simulation.truth();
    let [x_m, y_m, theta_rad] = truth.base_pose;
    let [vx_m_s, vy_m_s, omega_rad_s] = truth.base_velocity;
    let [px, py, about_origin] = simulation.momentum();
    let [cx, cy] = simulation.centre_of_mass_m();
    let thrusters = simulation.physics().thrusters.len().min(MAX_THRUSTERS);
    let mut thrust_n = [0.0; MAX_THRUSTERS];
    for (field, force_n) in thrust_n.iter_mut().zip(simulation.thrusts_n()) {
        *field = force_n;
    }
    TruthState {
        stamp_ns: now_ns,
        x_m,
        y_m,
        theta_rad,
        vx_m_s,
        vy_m_s,
        omega_rad_s,
        q_rad: padded(&truth.q_rad),
        qd_rad_s: padded(&truth.qd_rad_s),
        current_a: padded(&truth.current_a),
        torque_nm: padded(&truth.torque_n_m),
        ee: truth.ee_pose,
        target: truth.target_pose,
        target_rate: truth.target_velocity,
        thrust_n,
        momentum: [px, py],
        angular_momentum: about_origin - (cx * py - cy * px),
        tank_pressure_pa: simulation.tank_pressure_pa().unwrap_or(0.0),
        gas_used_kg: simulation.gas_used_kg(),
        link_count: simulation.joint_count() as u32,
        valve_count: thrusters as u32,
        valves: std::array::from_fn(|line| (line < thrusters && valves >> line & 1 == 1).into()),
        ..TruthState::default()
    }
}

/// The first values; messages and plants each have their own largest number of links.
fn padded(values: &[f64]) -> [f64; MAX_LINKS] {
    std::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0))
}
