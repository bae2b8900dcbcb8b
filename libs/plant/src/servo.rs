//! A servo driver: position, velocity and current loops, and their limits.

use crate::parts::Servo;

/// What a joint's driver is told.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum JointCommand {
    /// The driver is off: no current.
    #[default]
    Free,
    /// A current.
    Current {
        /// Motor current (A).
        current_a: f64,
    },
    /// A rate to hold.
    Velocity {
        /// Encoder rate (rad/s).
        qd_rad_s: f64,
    },
    /// An angle to hold or to follow.
    Position {
        /// Encoder angle (rad).
        q_rad: f64,
        /// Its rate, fed forward (rad/s); 0 for a step.
        qd_rad_s: f64,
    },
}

/// Below this rate error the integral rests, so that it does not wind up against sticking
/// friction and hunt (rad/s).
const RATE_DEADBAND_RAD_S: f64 = 2e-4;

/// A driver's memory: torque of the integral part (N m).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Driver {
    integral_n_m: f64,
}

/// What the driver knows of its joint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Joint {
    pub(crate) encoder_rad: f64,
    pub(crate) encoder_rate_rad_s: f64,
    pub(crate) torque_constant_n_m_a: f64,
    pub(crate) max_torque_n_m: f64,
}

impl Driver {
    /// Motor current for the next `dt_s` (A).
    pub(crate) fn current_a(&mut self, command: JointCommand, joint: &Joint, servo: &Servo, dt_s: f64) -> f64 {
        let limit =
            (joint.max_torque_n_m / joint.torque_constant_n_m_a).min(servo.max_current_a.unwrap_or(f64::INFINITY));
        let rate = match command {
            JointCommand::Free => {
                self.integral_n_m = 0.0;
                return 0.0;
            }
            JointCommand::Current { current_a } => {
                self.integral_n_m = 0.0;
                return current_a.clamp(-limit, limit);
            }
            JointCommand::Velocity { qd_rad_s } => qd_rad_s,
            JointCommand::Position { q_rad, qd_rad_s } => {
                qd_rad_s + servo.position_gain_1_s * (q_rad - joint.encoder_rad)
            }
        };
        let rate = rate.clamp(-servo.max_rate_rad_s, servo.max_rate_rad_s);
        let error = rate - joint.encoder_rate_rad_s;
        let torque = servo.velocity_gain_n_m_s_rad * error + self.integral_n_m;
        let largest = limit * joint.torque_constant_n_m_a;
        let winds_up = torque.abs() >= largest && torque * error > 0.0;
        if !winds_up && error.abs() > RATE_DEADBAND_RAD_S {
            let more = self.integral_n_m + servo.velocity_integral_n_m_rad * error * dt_s;
            self.integral_n_m = more.clamp(-largest, largest);
        }
        torque.clamp(-largest, largest) / joint.torque_constant_n_m_a
    }
}
