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
//! origin; besides white force and torque, errors of each thruster in proportion to its thrust, and where there is an arm, errors
//! of its momentum and centre of mass. Sensors show deviations as they show the motion: late, and by their scale.

mod arrivals;
mod assembled;
mod carriage;
mod hyper;
mod joint_motion;
mod laws;
mod missing;
mod noise_model;
mod prediction;
mod samples;
mod shown;
mod thrust_errors;

use crate::block::{Block, HyperParameter};
use crate::memo::{Memo, are_loaded_alike, are_pushed_alike, are_steady};
use crate::path::{EncoderPath, PosePath, TimeGrid};
use crate::servo_response::{self, Answers, Drive, Nodes, Swing, datagrams, drives, lateness_s, link_ages_s};
use fss_estimation::Columns;
use fss_experiments::commands::Commands;
use fss_experiments::measured::Run;
use fss_multibody::ModelError;
use fss_plant::{Effect, Physics, Plant, Pulse, ValveHistory};
use joint_motion::JointMotion;
use noise_model::NoiseModel;
use prediction::Predictor;
use samples::{Ages, Samples};
use shown::Shown;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

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
    pose: PosePath,
    run: Run,
    answers: Arc<Answers>,
    /// The plant of the plant file.
    plant: Plant,
    nominal: Arc<About>,
    /// About what everything is linearized; `None` until it is known.
    present: Mutex<Option<Present>>,
    driven_otherwise: Mutex<RowsOtherwise>,
}

/// How joints are driven otherwise than everything is linearized about.
#[derive(PartialEq)]
struct DrivenOtherwise {
    /// The drives that everything is linearized about, and the others.
    drives: [Vec<Drive>; 2],
    /// How much later datagrams arrive.
    late_s: f64,
    ages: Ages,
}

/// What the rows change by where joints are driven otherwise. It hardly hangs on what else acts.
type RowsOtherwise = Vec<(DrivenOtherwise, Option<Arc<Vec<f64>>>)>;

/// About what everything is linearized.
#[derive(Clone)]
struct Present {
    about: Arc<About>,
    noise: Arc<NoiseModel>,
    shown: Shown,
}

/// A plant, its effects, and what is linearized about them.
struct About {
    /// The drives with which the joints' path was computed.
    drives: Vec<Drive>,
    /// What joints' motion beside that path changes.
    beside: JointMotion,
    predictor: Predictor,
    /// What the rows read but for what servos make of datagrams otherwise than with the drives above.
    rows: Memo<Vec<f64>>,
    noise: Arc<NoiseModel>,
}

impl About {
    /// About a plant with its effects, whose encoders showed a path.
    fn new(
        plant: &Plant,
        (run, samples, pose): (&Run, &Samples, &PosePath),
        encoders: EncoderPath,
    ) -> Result<Self, ModelError> {
        let grid = pose.grid;
        let valves = ValveHistory::new(run.thrust_levels.clone());
        let predictor = Predictor::new(pose.clone(), encoders, valves);
        let physics = Physics::with(plant, &plant.effects);
        let (path, carriage) = (predictor.path(&physics), predictor.carriage(&physics)?);
        let beside = JointMotion::new(&physics, grid, &path, &carriage)?;
        let noise = Arc::new(NoiseModel::new(plant, run, samples, &predictor, &beside)?);
        Ok(Self { drives: drives(&physics), beside, predictor, rows: Memo::new(), noise })
    }

    /// What the rows change by where links swing on their motors, and where these move otherwise than on this plant's drives or later, by the
    /// part that telemetry does not show; `None` where neither is so.
    fn answer(
        &self,
        (plant, effects): (&Plant, &[Effect]),
        physics: &Physics,
        (samples, commands): (&Samples, Option<&Commands>),
        (answers, driven_otherwise): (&Answers, &Mutex<RowsOtherwise>),
    ) -> Result<Option<Arc<Vec<f64>>>, ModelError> {
        let encoders = &self.predictor.encoders;
        let (Some(nominal), Some(commands)) = (&encoders.response, commands) else { return Ok(None) };
        let ages = Ages::of(physics);
        let rows = |change: Option<Vec<Nodes>>, swings: &Option<Vec<Swing>>| {
            let unseen = |change: Vec<Nodes>| (0..change.len()).map(|i| encoders.unseen(i, &change[i])).collect();
            let unseen: Option<Vec<Nodes>> = change.map(unseen);
            let between = |nodes: &Nodes, t_s: f64| encoders.grid.between(nodes, t_s);
            let at = |joint: usize, t_s: f64| {
                let motor = unseen.as_ref().map_or([0.0; 2], |all| between(&all[joint], t_s));
                let ahead = swings.as_ref().map_or([0.0; 2], |all| between(&all[joint].ahead, t_s));
                [motor[0] + ahead[0], motor[1] + ahead[1]]
            };
            (unseen.is_some() || swings.is_some()).then(|| Arc::new(self.beside.rows(samples, ages, at)))
        };
        let (drives, late_s) = ([self.drives.clone(), drives(physics)], lateness_s(physics));
        if drives[0] == drives[1] && late_s == 0.0 {
            return Ok(rows(None, &nominal.swings));
        }
        let otherwise = DrivenOtherwise { drives, late_s, ages };
        let kept = || driven_otherwise.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, known)) = kept().iter().find(|(of, _)| *of == otherwise) {
            return Ok(known.clone());
        }
        let there = if otherwise.drives[0] == otherwise.drives[1] {
            nominal.later(late_s, encoders.grid)
        } else {
            let plant = servo_response::with_exactly(plant, &servo_response::moving(effects));
            answers.response(&plant, commands, &encoders.grid.edges_s())?.later(late_s, encoders.grid)
        };
        let rows = rows(Some(there.beside(nominal)), &there.swings);
        kept().push((otherwise, rows.clone()));
        Ok(rows)
    }
}

impl BaseBlock {
    /// The block of a run; `None` where the base is clamped or its pose was not measured for long enough, or
    /// where an arm moved that was not measured.
    ///
    /// # Errors
    /// When the plant's masses or inertias are impossible.
    pub fn new(plant: &Plant, run: &Run) -> Result<Option<Self>, ModelError> {
        Self::with_answers(plant, run, &Arc::default())
    }

    /// The same, with answers of servos that other channels of the run share.
    pub(crate) fn with_answers(plant: &Plant, run: &Run, answers: &Arc<Answers>) -> Result<Option<Self>, ModelError> {
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
        let ages_s = link_ages_s(&Physics::with(plant, &plant.effects));
        let encoders = EncoderPath::smoothed(run, (plant, &ages_s), grid, answers);
        // A drive follows its command to hundredths of a radian, which the base notices: such a run tells nothing.
        if encoders.moves_unseen {
            return Ok(None);
        }
        let nominal = Arc::new(About::new(plant, (run, &samples, &pose), encoders)?);
        // What was sampled of the base is in `samples`.
        let run = Run { base_pose: None, ee_pose: None, gyro: None, ..run.clone() };
        Ok(Some(Self {
            samples,
            pose,
            run,
            answers: answers.clone(),
            plant: plant.clone(),
            nominal,
            present: Mutex::new(None),
            driven_otherwise: Mutex::default(),
        }))
    }

    fn present(&self) -> MutexGuard<'_, Option<Present>> {
        self.present.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What a plant with effects is about which everything is linearized.
    fn about(&self, plant: &Plant, effects: &[Effect]) -> Result<Arc<About>, ModelError> {
        if let Some(present) = &*self.present() {
            return Ok(present.about.clone());
        }
        let (physics, nominal) = (Physics::with(plant, effects), Physics::with(&self.plant, &self.plant.effects));
        let ages_s = link_ages_s(&physics);
        let is_shown_alike =
            ages_s == link_ages_s(&nominal) && servo_response::answer_alike(plant, effects, &self.plant);
        let about = if is_shown_alike || datagrams(plant, &self.run).is_none() {
            self.nominal.clone()
        } else {
            let plant = servo_response::with_exactly(plant, &servo_response::moving(effects));
            let encoders = EncoderPath::smoothed(&self.run, (&plant, &ages_s), self.pose.grid, &self.answers);
            Arc::new(About::new(&plant, (&self.run, &self.samples, &self.pose), encoders)?)
        };
        let noise = if are_pushed_alike(&physics, &nominal) {
            about.noise.clone()
        } else {
            Arc::new(about.noise.with_thrust_of((plant, effects), &nominal, &about.predictor)?)
        };
        *self.present() = Some(Present { about: about.clone(), noise, shown: Shown::by(&physics) });
        Ok(about)
    }
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
        let about = self.about(plant, effects)?;
        let physics = Physics::with(plant, effects);
        let read = || Ok(self.samples.read(&about.predictor.motion(plant, effects)?));
        // With an onset, the plant is another one later.
        let is_steady = are_steady(effects);
        let mut rows = if is_steady { about.rows.get(&physics, are_loaded_alike, read)?.to_vec() } else { read()? };
        let records = (&self.samples, datagrams(plant, &self.run));
        if let Some(change) =
            about.answer((plant, effects), &physics, records, (&self.answers, &self.driven_otherwise))?
        {
            rows.iter_mut().zip(change.iter()).for_each(|(v, c)| *v += c);
        }
        Ok(rows)
    }

    fn missing_pulses(&self, plant: &Plant, effects: &[Effect]) -> Result<Vec<(Pulse, Vec<f64>)>, ModelError> {
        let about = self.about(plant, effects)?;
        about.predictor.missing_pulses(plant, effects, |motion| self.samples.read(motion))
    }

    fn forget(&self, _hyper: &[f64]) {
        *self.present() = None;
        self.nominal.predictor.forget();
        self.nominal.rows.forget();
    }

    fn hyper_parameters(&self) -> &[HyperParameter] {
        &self.nominal.noise.hyper_parameters
    }

    fn whiten(&self, hyper: &[f64], columns: &mut Columns) -> f64 {
        if let Some(Present { noise, shown, .. }) = self.present().clone() {
            return noise.whiten(hyper, shown, columns);
        }
        let physics = Physics::with(&self.plant, &self.plant.effects);
        self.nominal.noise.whiten(hyper, Shown::by(&physics), columns)
    }

    fn discrepancies(&self, hyper: &[f64]) -> Vec<(String, f64, f64)> {
        hyper::discrepancies(self.hyper_parameters(), hyper)
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
