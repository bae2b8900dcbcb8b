//! Gains, limits and patience of the arm controller.

use fss_messages::Parameters;
use fss_multibody::{JointVector, MAX_LINKS, Model, ModelError};
use fss_plant::{Physics, Plant};

/// How the joints are driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drive {
    /// Links follow the reference's angle, which moves on at its rate between commands.
    Position,
    /// Links follow the reference's rate, corrected by how far the joint is from the reference's angle.
    Velocity,
}

/// What the controller is built from.
#[derive(Clone, Debug)]
pub struct ArmConfig {
    /// The vehicle, as calibrated.
    pub model: Model,
    /// Limit of each joint's encoder angle to both sides of zero, rad.
    pub limit_rad: JointVector,
    /// How the joints are driven.
    pub drive: Drive,
    /// Rate limit of each joint, rad/s.
    pub max_rate_rad_s: JointVector,
    /// What each servo can do, rad/s.
    pub servo_rate_rad_s: JointVector,
    /// Rate limit of each joint where it moves in sines, rad/s: in free air, with nothing at the tip to be careful of.
    pub max_sine_rate_rad_s: JointVector,
    /// How fast joints slow down when the arm stops to hold, rad/s^2.
    pub braking_rad_s2: f64,
    /// The reference keeps this far from the joint limits, rad.
    pub margin_rad: f64,
    /// A joint may approach its limit at this rate for each rad that is left, 1/s.
    pub approach_1_s: f64,
    /// Feedback of the end-effector's position and angle, 1/s.
    pub line_gain_1_s: f64,
    /// Feedback of the base's attitude in zero-reaction maneuvers, 1/s.
    pub attitude_gain_1_s: f64,
    /// Errors of the end-effector's position that are left alone, m.
    pub quiet_m: f64,
    /// Errors of the end-effector's angle and of the attitude that are left alone, rad.
    pub quiet_rad: f64,
    /// How strongly the freedom that a line leaves is used to keep joints from their limits, rad^2/s.
    pub centring_gain_rad2_s: f64,
    /// Time in which that begins at the start of a line and ends at its end, s.
    pub centring_ramp_s: f64,
    /// Feedback of the joint's angle where joints are driven by rate, 1/s.
    pub joint_gain_1_s: f64,
    /// Below this smallest singular value the joints are slowed down in proportion to it.
    pub sigma_slow: f64,
    /// Below this one the inverse is damped.
    pub sigma_damped: f64,
    /// Below this one the arm is blocked.
    pub sigma_singular: f64,
    /// An end-effector this far from where its line wants it is blocked, m.
    pub max_deviation_m: f64,
    /// A joint that stays this far from its reference for a second is blocked, rad.
    pub max_lag_rad: f64,
    /// Time constant of the momentum estimate, s.
    pub momentum_time_s: f64,
    /// Time constant with which motion capture corrects the end-effector's computed pose, s.
    pub mocap_time_s: f64,
    /// Older telemetry and navigation are stale, ns.
    pub max_age_ns: u64,
    /// An older mission state is stale, ns.
    pub max_mission_age_ns: u64,
    /// Distance of the target's handle from its centre, where the plant has a target, m.
    pub target_radius_m: Option<f64>,
}

impl ArmConfig {
    /// For the vehicle of a plant file, with the effects that it has from the start.
    ///
    /// # Errors
    /// Where the plant is no mechanism that can move.
    pub fn new(plant: &Plant) -> Result<Self, ModelError> {
        let physics = Physics::at(plant, 0.0);
        let joints = || plant.links.iter().enumerate().take(MAX_LINKS);
        let mut limit_rad = JointVector::zeros();
        let mut servo_rate_rad_s = JointVector::zeros();
        let mut max_sine_rate_rad_s = JointVector::zeros();
        for (i, link) in joints() {
            limit_rad[i] = link.joint_limit_rad;
            servo_rate_rad_s[i] = plant.servo(i).max_rate_rad_s;
            max_sine_rate_rad_s[i] = plant.servo(i).max_rate_rad_s.min(0.6);
        }
        let mut config = Self {
            model: physics.model(0.0)?,
            limit_rad,
            drive: Drive::Position,
            max_rate_rad_s: JointVector::zeros(),
            servo_rate_rad_s,
            max_sine_rate_rad_s,
            braking_rad_s2: 0.3,
            margin_rad: 0.005,
            approach_1_s: 2.0,
            line_gain_1_s: 0.0,
            attitude_gain_1_s: 0.0,
            quiet_m: 4e-4,
            quiet_rad: 2e-4,
            centring_gain_rad2_s: 0.0,
            centring_ramp_s: 1.0,
            joint_gain_1_s: 1.0,
            sigma_slow: 0.03,
            sigma_damped: 0.01,
            sigma_singular: 1e-3,
            max_deviation_m: 0.02,
            max_lag_rad: 0.15,
            momentum_time_s: 2.0,
            mocap_time_s: 1.0,
            max_age_ns: 200_000_000,
            max_mission_age_ns: 500_000_000,
            target_radius_m: plant.target.as_ref().map(|target| target.radius_m),
        };
        config.tune(&Parameters::defaults());
        Ok(config)
    }

    /// The values of what can be tuned.
    pub(crate) fn tuned(&self) -> Parameters {
        Parameters {
            arm_line_gain_1_s: self.line_gain_1_s,
            arm_attitude_gain_1_s: self.attitude_gain_1_s,
            arm_centring_gain_rad2_s: self.centring_gain_rad2_s,
            arm_max_rate_rad_s: self.max_rate_rad_s.max(),
            ..Parameters::silent()
        }
    }

    /// Takes the values of what can be tuned. No joint is told to go faster than its servo can.
    pub(crate) fn tune(&mut self, values: &Parameters) {
        self.line_gain_1_s = values.arm_line_gain_1_s;
        self.attitude_gain_1_s = values.arm_attitude_gain_1_s;
        self.centring_gain_rad2_s = values.arm_centring_gain_rad2_s;
        self.max_rate_rad_s = self.servo_rate_rad_s.map(|servo| servo.min(values.arm_max_rate_rad_s));
    }
}
