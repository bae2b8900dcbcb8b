//! What only the simulated laboratory knows.

use crate::define::samples;
use crate::{MAX_LINKS, MAX_THRUSTERS};

samples! {
    /// What the simulated laboratory knows.
    TruthState {
        /// position of the base frame's origin, m
        x_m: f64,
        /// position of the base frame's origin, m
        y_m: f64,
        /// heading, unwrapped, rad
        theta_rad: f64,
        /// velocity in table axes, m/s
        vx_m_s: f64,
        /// velocity in table axes, m/s
        vy_m_s: f64,
        /// angular rate, rad/s
        omega_rad_s: f64,
        /// joint angles (encoder zero), rad
        q_rad: [f64; MAX_LINKS],
        /// joint rates, rad/s
        qd_rad_s: [f64; MAX_LINKS],
        /// motor currents, A
        current_a: [f64; MAX_LINKS],
        /// torque through each joint, N m
        torque_nm: [f64; MAX_LINKS],
        /// end-effector: x m, y m, angle rad
        ee: [f64; 3],
        /// target body: x m, y m, theta rad
        target: [f64; 3],
        /// target body: vx m/s, vy m/s, omega rad/s
        target_rate: [f64; 3],
        /// thrust of each thruster, N
        thrust_n: [f64; MAX_THRUSTERS],
        /// linear momentum in table axes, kg m/s
        momentum: [f64; 2],
        /// angular momentum about the system's centre of mass, kg m2/s
        angular_momentum: f64,
        /// pressure in the tank, Pa
        tank_pressure_pa: f64,
        /// gas used since the start, kg
        gas_used_kg: f64,
        /// when the gripper took hold of the target, ns, monotonic clock; 0 before
        grasp_ns: u64,
        /// momentum of vehicle and target together just before: kg m/s, kg m/s, kg m2/s about the table's middle
        grasp_momentum_before: [f64; 3],
        /// the same just after
        grasp_momentum_after: [f64; 3],
        /// distance of the end-effector from the target's handle when it took hold, m
        grasp_miss_m: f64,
        /// speed of the end-effector past the handle then, m/s
        grasp_speed_m_s: f64,
        /// 1 while the target is held
        target_held: u64,
        /// how many links there are
        link_count: u32,
        /// how many thrusters there are
        valve_count: u32,
        /// valve commands that the laboratory sees
        valves: [u8; MAX_THRUSTERS],
    }
}
