//! Encoders, motor currents, torque sensors and the end-effector's pose of one run.
//!
//! A current and a torque are *outputs* of a motion that encoders and motion capture show through noise, never regressors:
//! `current = (torque on the links (q, qd, qdd) + friction (qd)) / torque constant + noise`. The Kalman filter marginalizes
//! the motion, so that torque constants and frictions come out without bias at any telemetry rate (errors in variables).
//!
//! Two models of the motion:
//!
//! - *followed*: a servo makes the arm follow a command. The encoders read the command, its mean lag taken off, and beside it
//!   a smooth motion whose acceleration is a process of inferred strength, in proportion to what is commanded.
//!   Where datagrams command it, accelerations at the instant of a row are anything, too: servos settle between datagrams.
//! - *driven*: the motors' torques are known all the time (a measured current, or none). The motion between two rows is
//!   anything, and each row is a balance of torques that tells what it was. This is the equation of motion with process
//!   noise, written so that the rows stay local: an unstable or chaotic motion is never integrated.
//!
//! What no effect explains lands in correlated torques on the links and in the drives, of inferred strength.
//!
//! Everything is linearized about the smoothed path. [`JointBlock`]'s prediction is that linearization taken back to the
//! command, so that the filter's states are deviations from what does not depend on the measured noise.

mod driven;
mod hyper;
mod instant;
mod linearization;
mod linearize;
mod mechanics;
mod noise;
mod path;
mod process;
mod rows;
mod telemetry;
mod track;

use crate::block::{Block, HyperParameter};
use crate::memo::{Memo, are_loaded_alike, are_steady};
use crate::servo_response::{self, Answers, Elasticity, Swing, datagrams, elasticity, link_ages_s};
use driven::Anchor;
use fss_estimation::Columns;
use fss_experiments::measured::Run;
use fss_multibody::{Coordinates, ModelError};
use fss_plant::{Effect, JointPhysics, Physics, Plant};
use hyper::{Hyper, hyper_parameters};
use instant::{Instant, instants};
use linearization::Linearization;
use linearize::Loaded;
use mechanics::{Loads, Mechanics, NominalThrust, WindUp};
use noise::NoiseModel;
use path::MeasuredPath;
use rows::{Kind, Row};
use std::f64::consts::TAU;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use track::Track;

/// Accelerations and rates of which a plant's torque scale is made, rad/s2 and rad/s: what arms on tables do.
const TYPICAL_ACCELERATION: f64 = 1.0;
const TYPICAL_RATE: f64 = 0.5;
/// Fewer moments than this cannot hold an initial state and say anything.
const FEWEST_MOMENTS: usize = 4;

/// How far each link is ahead of its motor, and how well that is known.
type Swings = Vec<[Track; 2]>;

/// So many simulations of elastic drives are kept: those of what is present and of what it is compared with.
const KEPT_SWINGS: usize = 4;

/// The joints' channels of a run.
pub struct JointBlock {
    run: Run,
    answers: Arc<Answers>,
    path: MeasuredPath,
    loads: Loads,
    thrust: NominalThrust,
    rows: Vec<Row>,
    scale: Vec<f64>,
    /// About the nominal plant.
    nominal: Linearization,
    /// What the nominal plant makes of the torques at each moment, where the motion follows from them.
    anchors: Option<Vec<Option<Anchor>>>,
    hyper: Vec<HyperParameter>,
    /// About what everything is linearized; `None` until it is known.
    present: Mutex<Option<Arc<Present>>>,
    /// The hyper-parameters with which it is.
    present_hyper: Mutex<Vec<f64>>,
    /// How links swing on elastic drives, those that were asked for last.
    swings: Mutex<Vec<(Vec<Elasticity>, Arc<Swings>)>>,
    /// What drives carry along the path.
    loaded: Memo<Vec<Loaded>>,
    /// The nominal plant.
    plant: Plant,
    measured: Vec<f64>,
    channel_of_row: Vec<usize>,
    channels: Vec<String>,
    time_of_row: Vec<f64>,
    noise_of_row: Vec<f64>,
}

/// The plant and the effects about which everything is linearized.
struct Present {
    /// Whether any drive is elastic.
    is_elastic: bool,
    /// Breakaway torque of each joint, N m.
    breakaway_n_m: Vec<f64>,
    /// `None` where it is the nominal one.
    linearization: Option<Linearization>,
    /// Torques at the moments of the rows; none where the motion follows from the torques.
    instants: Vec<Instant>,
    /// The path where servos answer otherwise than the nominal plant's, for drives are elastic, or telemetry is of another age; `None`
    /// where neither is so.
    path: Option<MeasuredPath>,
}

/// The joints' channels of a run; `None` where it lacks what it takes: a joint each of which reports angle or rate, and
/// something that depends on more than the encoders.
pub fn joint_block(plant: &Plant, run: &Run) -> Option<JointBlock> {
    joint_block_with(plant, run, &Arc::default())
}

/// The same, with answers of servos that other channels of the run share.
pub(crate) fn joint_block_with(plant: &Plant, run: &Run, answers: &Arc<Answers>) -> Option<JointBlock> {
    let ages_s = link_ages_s(&Physics::with(plant, &plant.effects));
    let path = MeasuredPath::new((plant, &ages_s), run, answers)?;
    let mut rows = rows::rows(plant, run, &path);
    let tells = |row: &Row| !matches!(row.kind, Kind::Angle(_) | Kind::Rate(_));
    if rows::moments(&rows).len() < FEWEST_MOMENTS || !rows.iter().any(tells) {
        return None;
    }
    let thrust = NominalThrust::new(plant, run, &path).ok()?;
    let scale = torque_scale(plant)?;
    let none = Loads::default();
    let rigid = Mechanics::new(plant, &[], (run, &path, WindUp::OfLoads(&none)), Some(&thrust)).ok()?;
    let loads = if telemetry::is_driven(run) { Loads::default() } else { rigid.loads(&plant.sensors, &scale) };
    let mechanics = Mechanics::new(plant, &[], (run, &path, WindUp::OfLoads(&loads)), Some(&thrust)).ok()?;
    let nominal = linearize::predict(&mechanics, &path, &rows, &linearize::loaded(&mechanics, &path, &rows));
    // Headings are known but for whole turns.
    for (row, nominal) in rows.iter_mut().zip(&nominal).filter(|(row, _)| row.kind == Kind::Tip(2)) {
        row.value -= TAU * ((row.value - nominal) / TAU).round();
    }
    let model = NoiseModel::new(plant, run, &path, &rows);
    let anchors = model.driven.then(|| driven::anchors(&mechanics, &path, &rows, &nominal));
    let parts = (&path, rows.as_slice(), scale.as_slice());
    let mut nominal = Linearization::new(plant, &mechanics, parts, &model)?;
    if let Some(anchors) = &anchors {
        driven::add_rotors_and_encoders(&path, &rows, anchors, &mut nominal.model.slopes);
    }
    let mut block =
        JointBlock::assembled((plant, run, answers), (path, loads, thrust, anchors), (rows, scale), nominal);
    // A joint without a motor balances its torques without a sensor: errors are told over a hundredth of the typical torque.
    for (row, noise) in block.rows.iter().zip(&mut block.noise_of_row) {
        if let Kind::Undriven(joint) = row.kind {
            *noise = 0.01 * block.scale[joint];
        }
    }
    Some(block)
}

/// Torque that the plant's joints are about: of inertia, gravity and friction, N m.
fn torque_scale(plant: &Plant) -> Option<Vec<f64>> {
    let model = plant.model().ok()?;
    let mass = model.mass_matrix(&Coordinates::zeros());
    let gravity = model.gravity_m_s2()[0].hypot(model.gravity_m_s2()[1]);
    let reach = |from: usize, to: usize| {
        let before: f64 = plant.links[from..to].iter().map(|l| l.length_m).sum();
        before + (plant.links[to].length_m - plant.links[to].com_to_next_joint_m).abs()
    };
    let weight = |i: usize| {
        let carried = (i..plant.links.len()).map(|j| plant.links[j].mass_kg * reach(i, j));
        if plant.base.clamped { gravity * carried.sum::<f64>() } else { 0.0 }
    };
    let scale = |(i, link): (usize, &fss_plant::Link)| {
        let friction = link.coulomb_friction_n_m + TYPICAL_RATE * link.viscous_friction_n_m_s_rad;
        mass[(3 + i, 3 + i)] * TYPICAL_ACCELERATION + friction + weight(i)
    };
    Some(plant.links.iter().enumerate().map(scale).collect())
}

impl JointBlock {
    fn assembled(
        (plant, run, answers): (&Plant, &Run, &Arc<Answers>),
        (path, loads, thrust, anchors): (MeasuredPath, Loads, NominalThrust, Option<Vec<Option<Anchor>>>),
        (rows, scale): (Vec<Row>, Vec<f64>),
        nominal: Linearization,
    ) -> Self {
        let mut channels: Vec<String> = Vec::new();
        let mut channel_of_row = Vec::with_capacity(rows.len());
        for row in &rows {
            let name = row.kind.channel();
            let at = channels.iter().position(|c| *c == name).unwrap_or_else(|| {
                channels.push(name);
                channels.len() - 1
            });
            channel_of_row.push(at);
        }
        let hyper = hyper_parameters(nominal.model.driven);
        let measured = rows.iter().map(|r| r.value).collect();
        let (time_of_row, noise_of_row) =
            (rows.iter().map(|r| r.t_s).collect(), rows.iter().map(|r| r.noise).collect());
        // What was sampled of the end-effector is in the rows.
        let run = Run { ee_pose: None, gyro: None, ..run.clone() };
        Self {
            run,
            answers: answers.clone(),
            path,
            loads,
            thrust,
            rows,
            scale,
            nominal,
            anchors,
            hyper,
            present: Mutex::new(None),
            present_hyper: Mutex::default(),
            swings: Mutex::default(),
            loaded: Memo::new(),
            plant: plant.clone(),
            measured,
            channel_of_row,
            channels,
            time_of_row,
            noise_of_row,
        }
    }

    fn present(&self) -> MutexGuard<'_, Option<Arc<Present>>> {
        self.present.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What a plant with effects is about which everything is linearized.
    fn about(&self, plant: &Plant, effects: &[Effect]) -> Result<Present, ModelError> {
        let physics = Physics::with(plant, effects);
        let is_elastic = elasticity(&physics).iter().any(Elasticity::is_elastic);
        let answers = is_elastic && !servo_response::answer_alike(plant, effects, &self.plant);
        let ages_s = link_ages_s(&physics);
        let is_late = ages_s != link_ages_s(&Physics::with(&self.plant, &self.plant.effects));
        let path = if (answers || is_late) && datagrams(plant, &self.run).is_some() {
            let answering = if answers { plant } else { &self.plant };
            let effects = if answers { servo_response::moving(effects) } else { self.plant.effects.clone() };
            let moving = servo_response::with_exactly(answering, &effects);
            MeasuredPath::new((&moving, &ages_s), &self.run, &self.answers)
        } else {
            None
        };
        let of = |joint: &JointPhysics| joint.friction.breakaway_n_m();
        let breakaway_n_m = physics.joints.iter().map(of).collect();
        let mut present = Present { is_elastic, breakaway_n_m, linearization: None, instants: Vec::new(), path };
        if self.anchors.is_some() {
            return Ok(present);
        }
        let path = present.path.as_ref().unwrap_or(&self.path);
        let parts = (&self.run, path, self.wind_up((plant, effects), &present)?);
        let mechanics = Mechanics::new(plant, effects, parts, Some(&self.thrust))?;
        let rows = self.rows.as_slice();
        let linearization = if effects.is_empty() && *plant == self.plant {
            None
        } else {
            Linearization::new(plant, &mechanics, (path, rows, &self.scale), &self.nominal.model)
        };
        let about = linearization.as_ref().unwrap_or(&self.nominal);
        let hyper = self.present_hyper.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let hyper = Hyper::new(&hyper, about.model.driven);
        let instants = instants(&mechanics, rows, about, (&hyper, &present.breakaway_n_m));
        (present.linearization, present.instants) = (linearization, instants);
        Ok(present)
    }

    /// How far links are ahead of their motors with these effects. Where datagrams command an arm that has elastic drives, links swing
    /// on them; a first look at what such drives would do does without.
    fn wind_up(&self, (plant, effects): (&Plant, &[Effect]), present: &Present) -> Result<WindUp<'_>, ModelError> {
        let elasticity = elasticity(&Physics::with(plant, effects));
        let swings = present.is_elastic && elasticity.iter().any(Elasticity::is_elastic);
        let commands = datagrams(plant, &self.run).filter(|_| swings);
        let Some(commands) = commands else { return Ok(WindUp::OfLoads(&self.loads)) };
        let kept = || self.swings.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, tracks)) = kept().iter().find(|(of, _)| *of == elasticity) {
            return Ok(WindUp::Simulated(tracks.clone()));
        }
        let plant = servo_response::with_exactly(plant, &servo_response::moving(effects));
        let grid_s: Vec<f64> = self.path.grid_s().collect();
        let swings = self.answers.response(&plant, commands, &grid_s)?.swings.unwrap_or_default();
        let track = |swing: Swing| {
            let sd = swing.sd.into_iter().map(|[angle, _]| [angle, 0.0, 0.0]).collect();
            [self.path.track(swing.ahead), self.path.track(sd)]
        };
        let tracks: Arc<Swings> = Arc::new(swings.into_iter().map(track).collect());
        let mut kept = kept();
        kept.truncate(KEPT_SWINGS - 1);
        kept.insert(0, (elasticity, tracks.clone()));
        Ok(WindUp::Simulated(tracks))
    }

    /// What drives carry along the path with these effects.
    fn loaded(
        &self,
        mechanics: &Mechanics,
        path: &MeasuredPath,
        effects: &[Effect],
    ) -> Result<Arc<Vec<Loaded>>, ModelError> {
        let loaded = || Ok(linearize::loaded(mechanics, path, &self.rows));
        // With an onset, the plant is another one later.
        if !are_steady(effects) {
            return loaded().map(Arc::new);
        }
        self.loaded.get(mechanics.physics(0.0), are_loaded_alike, loaded)
    }

    /// Makes the end-effector's rows independent ([`noise::Slopes::mix`]).
    fn mix(&self, model: &NoiseModel, columns: &mut Columns) {
        for (k, row) in self.rows.iter().enumerate().rev() {
            let (Kind::Tip(axis), Some((mix, _))) = (row.kind, &model.slopes[k].mix) else { continue };
            for c in 0..axis {
                let other = columns.row(k - axis + c).to_vec();
                columns.row_mut(k).iter_mut().zip(other).for_each(|(v, o)| *v += mix[c] * o);
            }
        }
    }
}

impl Block for JointBlock {
    fn measured(&self) -> &[f64] {
        &self.measured
    }

    fn predict(&self, plant: &Plant, effects: &[Effect]) -> Result<Vec<f64>, ModelError> {
        let known = self.present().clone();
        let present = if let Some(present) = known {
            present
        } else {
            let about = Arc::new(self.about(plant, effects)?);
            self.present().get_or_insert(about).clone()
        };
        let path = present.path.as_ref().unwrap_or(&self.path);
        let parts = (&self.run, path, self.wind_up((plant, effects), &present)?);
        let mechanics = Mechanics::new(plant, effects, parts, Some(&self.thrust))?;
        let about = present.linearization.as_ref().unwrap_or(&self.nominal);
        let mut out = match &self.anchors {
            Some(anchors) => driven::predict_driven(&mechanics, path, &self.rows, anchors),
            None => linearize::predict(&mechanics, path, &self.rows, &self.loaded(&mechanics, path, effects)?),
        };
        present.instants.iter().for_each(|instant| instant.add(&mechanics, &self.rows, &mut out));
        out.iter_mut().zip(&about.shift).for_each(|(v, s)| *v += s);
        Ok(out)
    }

    fn forget(&self, hyper: &[f64]) {
        *self.present() = None;
        *self.present_hyper.lock().unwrap_or_else(PoisonError::into_inner) = hyper.to_vec();
        self.loaded.forget();
        self.swings.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    fn hyper_parameters(&self) -> &[HyperParameter] {
        &self.hyper
    }

    fn whiten(&self, hyper: &[f64], columns: &mut Columns) -> f64 {
        let present = self.present().clone();
        let about = present.as_ref().and_then(|p| p.linearization.as_ref()).unwrap_or(&self.nominal);
        let hyper = Hyper::new(hyper, about.model.driven);
        self.mix(&about.model, columns);
        let unknown = vec![0.0; about.model.links];
        let breakaway_n_m = present.as_ref().map_or(&unknown, |p| &p.breakaway_n_m);
        about.model.whiten(&self.rows, (&hyper, breakaway_n_m), columns)
    }

    fn channel_of_row(&self) -> &[usize] {
        &self.channel_of_row
    }

    fn channels(&self) -> &[String] {
        &self.channels
    }

    fn time_of_row(&self) -> &[f64] {
        &self.time_of_row
    }

    fn noise_of_row(&self) -> &[f64] {
        &self.noise_of_row
    }
}
