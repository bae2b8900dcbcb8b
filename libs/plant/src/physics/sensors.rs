//! The sensors as they really are.

use crate::parts::Sensors;

/// Data streams that have a clock, in the order of [`SensorPhysics::clock_offset_s`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    /// Motion capture of the base.
    BasePose,
    /// Motion capture of the end-effector.
    EePose,
    /// Motion capture of the target.
    TargetPose,
    /// The gyro.
    Gyro,
    /// Link telemetry.
    Joints,
    /// Joint commands.
    JointCommand,
    /// Valve commands.
    Valves,
}

/// The sensors as they really are; white noise is the nominal [`Sensors`].
#[derive(Debug, Clone, PartialEq)]
pub struct SensorPhysics {
    /// Noise and rates.
    pub nominal: Sensors,
    /// Motion capture: event to arrival (s).
    pub mocap_delay_s: f64,
    /// Motion capture: turn of the camera frame about the table's origin (rad).
    pub mocap_rotation_rad: f64,
    /// The tracked point in the base frame (m).
    pub marker_offset_m: [f64; 2],
    /// Tracked heading less heading of the base (rad).
    pub marker_yaw_rad: f64,
    /// Gyro reading at rest, to which the random walk adds (rad/s).
    pub gyro_bias_rad_s: f64,
    /// Gyro reading over truth.
    pub gyro_scale: f64,
    /// Link telemetry: event to stamp, by link (s).
    pub link_delay_s: Vec<f64>,
    /// Stamp less true time, by [`Stream`] (s).
    pub clock_offset_s: [f64; 7],
}

impl SensorPhysics {
    /// Where motion capture sees a body of this pose, without noise (m, m, rad).
    pub fn pose_reading(&self, [x, y, theta]: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = self.mocap_rotation_rad.sin_cos();
        [cos * x - sin * y, sin * x + cos * y, theta + self.mocap_rotation_rad]
    }

    /// Where motion capture sees the markers of a base of this pose, without noise (m, m, rad).
    pub fn base_reading(&self, [x, y, theta]: [f64; 3]) -> [f64; 3] {
        let [mx, my] = self.marker_offset_m;
        let (sin, cos) = theta.sin_cos();
        let marker = [x + cos * mx - sin * my, y + sin * mx + cos * my, theta + self.marker_yaw_rad];
        self.pose_reading(marker)
    }

    /// What the gyro says to this rate, without noise and walk (rad/s).
    pub fn gyro_reading(&self, rate_rad_s: f64) -> f64 {
        self.gyro_scale * rate_rad_s + self.gyro_bias_rad_s
    }

    /// How much older a sample is than its stamp says, once the nominal latency is taken off (s).
    pub fn age_s(&self, stream: Stream) -> f64 {
        let latency = match stream {
            Stream::BasePose | Stream::EePose | Stream::TargetPose => self.mocap_delay_s - self.nominal.mocap_latency_s,
            _ => 0.0,
        };
        latency + self.clock_offset_s[stream as usize]
    }

    /// [`SensorPhysics::age_s`] of link `link`'s telemetry (s).
    pub fn link_age_s(&self, link: usize) -> f64 {
        let delay = self.link_delay_s.get(link).copied();
        delay.unwrap_or(0.0) - self.nominal.link_latency_s + self.clock_offset_s[Stream::Joints as usize]
    }
}
