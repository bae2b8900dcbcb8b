//! The runs of an experiment as plain series. SI units, radians, seconds from the start of the run.

use crate::commands::Commands;
pub use crate::series::Many;

/// One run; a channel that was not measured is `None`.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// Its name.
    pub name: String,
    /// Base frame in the table frame, theta unwrapped.
    pub base_pose: Option<Poses>,
    /// End-effector in the table frame, theta unwrapped.
    pub ee_pose: Option<Poses>,
    /// Angular rate of the base, rad/s.
    pub gyro: Option<Series>,
    /// Telemetry of the joints.
    pub joints: Option<Joints>,
    /// Angles that the drivers were told to follow, rad; one series a joint.
    pub joint_command: Option<Many>,
    /// What the drivers were told and when, where a log has it: from it their motion is simulated where drives are elastic.
    pub commands: Option<Commands>,
    /// Commanded levels of the thrusters, 0 to 1, held until the next row; valves are 0, shut, and 1, open.
    pub thrust_levels: Vec<(f64, Vec<f64>)>,
    /// What drives the joints.
    pub drive: Drive,
    /// Postures in which the arm stood still, as a service collected them in flight.
    pub postures: Vec<Posture>,
}

/// In so long every joint reports, and a window's margin passes, s.
const ALL_REPORT_S: f64 = 0.5;

/// A joint that keeps within so much, rad, rests: a servo that holds it against the base's motion moves it less.
const RESTS_WITHIN_RAD: f64 = 0.05;

/// Whether any of these commanded levels is above 0.
pub fn pushes(levels: &[f64]) -> bool {
    levels.iter().any(|level| *level > 0.0)
}

impl Run {
    /// Whether a thruster, counted from 1, is ever commanded to push.
    pub fn fires(&self, thruster: usize) -> bool {
        self.thrust_levels.iter().any(|(_, levels)| levels.get(thruster - 1).is_some_and(|level| *level > 0.0))
    }

    /// Whether a joint, counted from 1, moves in this run, or may without anybody telling.
    pub fn moves(&self, joint: usize) -> bool {
        let Some(q_rad) = self.joints.as_ref().and_then(|joints| joints.q_rad.get(joint - 1)) else { return true };
        let known = || q_rad.iter().copied().filter(|q| q.is_finite());
        known().fold(f64::NEG_INFINITY, f64::max) - known().fold(f64::INFINITY, f64::min) > RESTS_WITHIN_RAD
    }

    /// The same run without what the joints reported before `from_s`, and everything else before every joint has reported once
    /// more; what it was told stays.
    pub fn measured_from(mut self, from_s: f64) -> Self {
        let late = |t_s: &[f64]| t_s.partition_point(|t| *t < from_s + ALL_REPORT_S);
        for poses in [&mut self.base_pose, &mut self.ee_pose].into_iter().flatten() {
            let early = late(&poses.t_s);
            poses.t_s.drain(..early);
            poses.values.drain(..early);
        }
        if let Some(gyro) = &mut self.gyro {
            let early = late(&gyro.t_s);
            gyro.t_s.drain(..early);
            gyro.values.drain(..early);
        }
        if let Some(joints) = &mut self.joints {
            let early = joints.t_s.partition_point(|t| *t < from_s);
            joints.t_s.drain(..early);
            let quantities =
                [&mut joints.q_rad, &mut joints.qd_rad_s, &mut joints.current_a, &mut joints.torque_nm].into_iter();
            for values in quantities.flatten() {
                values.drain(..early.min(values.len()));
            }
        }
        self
    }
}

/// The arm at rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Posture {
    /// Mean encoder angles, rad.
    pub q_rad: Vec<f64>,
    /// Mean pose of the end-effector in the base frame: x m, y m, angle rad.
    pub tip: [f64; 3],
}

/// What drives the joints of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// Nothing.
    #[default]
    Free,
    /// Servo drivers that follow commanded angles or rates.
    Servo,
    /// The measured current.
    Current,
}

/// One value over time.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// Times, s, increasing.
    pub t_s: Vec<f64>,
    /// Values.
    pub values: Vec<f64>,
}

/// Poses over time.
#[derive(Clone, Debug, Default)]
pub struct Poses {
    /// Times, s, increasing.
    pub t_s: Vec<f64>,
    /// x m, y m, theta rad.
    pub values: Vec<[f64; 3]>,
}

/// Telemetry of the joints: one series a joint, as many joints as a quantity was measured of. What a joint did not measure
/// at one of the times is not a number (NaN).
#[derive(Clone, Debug, Default)]
pub struct Joints {
    /// Times, s, increasing.
    pub t_s: Vec<f64>,
    /// Encoder angles, rad.
    pub q_rad: Vec<Vec<f64>>,
    /// Rates, rad/s.
    pub qd_rad_s: Vec<Vec<f64>>,
    /// Motor currents, A.
    pub current_a: Vec<Vec<f64>>,
    /// Torques that the drives pass on to their links, N m.
    pub torque_nm: Vec<Vec<f64>>,
}
