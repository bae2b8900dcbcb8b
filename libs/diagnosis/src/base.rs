//! The motion of a floating base: motion capture and gyro, predicted from forces along the measured path.
//!
//! Forces along the path change the momentum of base and arm together; the arm's motion is as its telemetry shows. With M the
//! total mass, c the centre of mass in the base frame, I the locked inertia about it and h the angular momentum of the joint
//! rates:
//!
//! ```text
//! M X'' = sum of forces,   L' = sum of torques about X,   theta' = (L - h) / I,   pose = (X - R(theta) c, theta)
//! ```
//!
//! Headings in forces and rotations are the measured ones, so that the prediction is linear in forces. The noise model has the
//! state (p_x v_x p_y v_y theta L f_x f_y tau): deviations of X, theta and L, and a coloured force and torque on the base's
//! origin; besides white force and torque, and where there is an arm, errors of its momentum and centre of mass.

mod arrivals;
mod joint_motion;
mod missing;
mod noise_model;
mod prediction;
mod samples;

use crate::block::{Block, HyperParameter};
use crate::path::{EncoderPath, PosePath, TimeGrid};
use crate::servo_response::{self, GainSlope, Nodes, datagrams};
use fss_estimation::Columns;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Physics, Plant, Pulse, Servo, ValveHistory};
use joint_motion::JointMotion;
use noise_model::NoiseModel;
use prediction::Predictor;
use samples::Samples;

/// A run shorter than this says nothing of forces (s).
const SHORTEST_S: f64 = 0.5;
/// Longest cell of the grid on which forces are integrated (s), and most that the heading turns in one (rad).
const LONGEST_CELL_S: f64 = 0.02;
const TURN_PER_CELL_RAD: f64 = 0.02;
const SHORTEST_CELL_S: f64 = 0.001;
/// And where servos settle after each datagram.
const SERVO_CELL_S: f64 = 0.005;

/// Pose and rate of a floating base in one run.
pub struct BaseBlock {
    samples: Samples,
    predictor: Predictor,
    noise: NoiseModel,
    /// Gains with which the joints' path was computed, and what others change.
    servos: Vec<Servo>,
    by_gain: Vec<GainSlope>,
}

impl BaseBlock {
    /// The block of a run; `None` where the base is clamped or its pose was not measured for long enough, or
    /// where an arm moved that was not measured.
    ///
    /// # Errors
    /// When the plant's masses or inertias are impossible.
    pub fn new(plant: &Plant, run: &Run) -> Result<Option<Self>, ModelError> {
        if plant.base.clamped {
            return Ok(None);
        }
        let Some(samples) = Samples::of(plant, run) else { return Ok(None) };
        let (first, last) = samples.span_s();
        if last - first < SHORTEST_S {
            return Ok(None);
        }
        let longest_s = if datagrams(plant, run).is_some() { SERVO_CELL_S } else { LONGEST_CELL_S };
        let grid = TimeGrid::over(first, last, cell_s(&samples).min(longest_s));
        let pose = PosePath::smoothed(&samples.block_times(), &samples.block_poses(), samples.block_sd(), grid);
        let encoders = EncoderPath::smoothed(run, plant, grid);
        // A drive follows its command to hundredths of a radian, which the base notices: such a run tells nothing.
        if encoders.moves_unseen {
            return Ok(None);
        }
        let valves = ValveHistory::new(run.thrust_levels.clone());
        let predictor = Predictor::new(pose, encoders, valves);
        let physics = Physics::with(plant, &plant.effects);
        let (path, carriage) = (predictor.path(&physics), predictor.carriage(&physics)?);
        let beside = JointMotion::new(&physics, grid, &path, &carriage)?;
        let by_gain = gain_slopes(&predictor, &samples, &beside);
        let noise = NoiseModel::new(plant, run, &samples, &predictor, &beside)?;
        let servos = (0..plant.link_count()).map(|i| plant.servo(i).clone()).collect();
        Ok(Some(Self { samples, predictor, noise, servos, by_gain }))
    }
}

/// What the rows change by with the logarithm of each gain of each joint's servo.
fn gain_slopes(predictor: &Predictor, samples: &Samples, beside: &JointMotion) -> Vec<GainSlope> {
    let grid = predictor.encoders.grid;
    let by_gain = predictor.encoders.response.as_ref().map_or(&[][..], |response| &response.by_gain);
    let of = |(gain, joints): (usize, &Vec<Nodes>)| -> Vec<GainSlope> {
        let slope = |(joint, nodes): (usize, &Nodes)| {
            let of_row = beside.rows(samples, joint, |t_s| grid.between(nodes, t_s));
            GainSlope { gain, joint, of_row }
        };
        joints.iter().enumerate().map(slope).collect()
    };
    by_gain.iter().enumerate().flat_map(of).collect()
}

/// Cells in which the heading turns little.
fn cell_s(samples: &Samples) -> f64 {
    let (t, poses) = (samples.block_times(), samples.block_poses());
    let rates = t.windows(2).zip(poses.windows(2)).map(|(t, p)| ((p[1][2] - p[0][2]) / (t[1] - t[0])).abs());
    let fastest = rates.fold(1e-6, f64::max);
    (TURN_PER_CELL_RAD / fastest).clamp(SHORTEST_CELL_S, LONGEST_CELL_S)
}

impl Block for BaseBlock {
    fn measured(&self) -> &[f64] {
        &self.samples.measured
    }

    fn predict(&self, plant: &Plant, effects: &[Effect]) -> Result<Vec<f64>, ModelError> {
        let motion = self.predictor.motion(plant, effects)?;
        let mut rows = self.samples.read(&motion);
        servo_response::tune(plant, &self.servos, &self.by_gain, &mut rows);
        Ok(rows)
    }

    fn missing_pulses(&self, plant: &Plant, effects: &[Effect]) -> Result<Vec<(Pulse, Vec<f64>)>, ModelError> {
        self.predictor.missing_pulses(plant, effects, |motion| self.samples.read(motion))
    }

    fn forget(&self) {
        self.predictor.forget();
    }

    fn hyper_parameters(&self) -> &[HyperParameter] {
        &self.noise.hyper_parameters
    }

    fn whiten(&self, hyper: &[f64], columns: &mut Columns) -> f64 {
        self.noise.whiten(hyper, columns)
    }

    fn discrepancies(&self, hyper: &[f64]) -> Vec<(String, f64, f64)> {
        self.noise.discrepancies(hyper)
    }

    fn channel_of_row(&self) -> &[usize] {
        &self.samples.channel_of_row
    }

    fn channels(&self) -> &[String] {
        &self.samples.channels
    }

    fn time_of_row(&self) -> &[f64] {
        &self.samples.time_of_row
    }

    fn noise_of_row(&self) -> &[f64] {
        &self.samples.noise_of_row
    }
}
