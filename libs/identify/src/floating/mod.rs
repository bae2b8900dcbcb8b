//! A floating base: the arm goes as its telemetry shows, the base follows from momentum and thrust.

mod arm;
mod drive;
mod layout;
pub(crate) mod swing;
mod telemetry;
mod torque;

use crate::trial::{Span, Trial};
use arm::{Arm, ArmMotion};
use fss_experiments::measured::Run;
use fss_multibody::{Coordinates, ModelError};
use fss_plant::{BaseSample, Effect, Place, Plant, Rollout, Stream, ValveHistory};
use layout::Window;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Step of the simulation, s; joints are sampled at half of it.
pub(crate) const STEP_S: f64 = 0.02;
/// Simulated before and after a window, so that late samples can be looked up, s.
const MARGIN_S: f64 = 0.3;

/// A run of a floating base, cut into windows.
pub(crate) struct Record {
    run: Run,
    valves: ValveHistory,
    arm: Arm,
    /// How the arm moves under the effects that the record was made with, and those of them that move it.
    motion: Arc<ArmMotion>,
    arm_effects: Vec<Effect>,
    start_s: f64,
    channels: Vec<String>,
    windows: Vec<Window>,
    spans: Vec<Span>,
}

impl Record {
    /// `None` where the run lacks what it takes: poses of the base.
    pub(crate) fn new(trial: &Trial, run: &Run) -> Result<Option<Self>, ModelError> {
        let Some(poses) = run.base_pose.as_ref().filter(|p| p.t_s.len() >= layout::FEWEST_POSES) else {
            return Ok(None);
        };
        let rollout = trial.rollout()?;
        let start_s = poses.t_s[0] - MARGIN_S;
        let last_s = poses.t_s[poses.t_s.len() - 1] + MARGIN_S;
        let halves = (2.0 * (last_s - start_s) / STEP_S).ceil() as usize + 4;
        let grid_s: Vec<f64> = (0..halves).map(|k| start_s + 0.5 * STEP_S * k as f64).collect();
        let arm = Arm::new(trial, &rollout, run, grid_s);
        let motion = Arc::new(arm.motion(trial, &rollout, run));
        let channels = layout::channels(trial.plant.link_count());
        let windows = layout::windows(&trial.plant, run, start_s);
        let spans = windows.iter().map(|w| w.span(&trial.plant, &rollout, run, &motion, start_s)).collect();
        let valves = ValveHistory::new(run.thrust_levels.clone());
        let (run, arm_effects) = (run.clone(), arm_effects(&trial.effects));
        Ok(Some(Self { run, valves, arm, motion, arm_effects, start_s, channels, windows, spans }))
    }

    /// Name of the run.
    pub(crate) fn name(&self) -> &str {
        &self.run.name
    }

    /// Names of the channels.
    pub(crate) fn channels(&self) -> &[String] {
        &self.channels
    }

    /// The windows.
    pub(crate) fn spans(&self) -> &[Span] {
        &self.spans
    }

    /// Whether it is known what drivers were told, so that drives can be simulated.
    pub(crate) fn tells_commands(&self) -> bool {
        self.run.commands.is_some()
    }

    /// Whether an effect can make itself felt in this run at all.
    pub(crate) fn feels(&self, effect: &Effect) -> bool {
        let line = effect.index().filter(|_| effect.about().place == Place::Thruster && effect.id() != "thruster_leak");
        let other = if effect.id() == "valve_swap" { effect.get("other_index").map(|v| v as usize) } else { None };
        let opens = |i: usize| self.run.fires(i);
        match (line, other) {
            (None, _) => true,
            (Some(a), Some(b)) => opens(a) || opens(b),
            (Some(a), None) => opens(a),
        }
    }

    /// The run under a trial.
    pub(crate) fn flight(&self, trial: &Trial) -> Result<Flight<'_>, ModelError> {
        let rollout = trial.rollout()?;
        let motion = if arm_effects(&trial.effects) == self.arm_effects {
            Arc::clone(&self.motion)
        } else {
            Arc::new(self.arm.motion(trial, &rollout, &self.run))
        };
        Ok(Flight { record: self, plant: trial.plant.clone(), rollout, motion })
    }
}

/// Those effects that may change how the arm moves, or what its encoders tell of it.
fn arm_effects(effects: &[Effect]) -> Vec<Effect> {
    let is_elsewhere = |e: &&Effect| matches!(e.about().place, Place::Base | Place::Mass | Place::Thruster);
    effects.iter().filter(|e| !is_elsewhere(e)).cloned().collect()
}

/// A run under a trial.
pub(crate) struct Flight<'a> {
    record: &'a Record,
    plant: Plant,
    rollout: Rollout,
    motion: Arc<ArmMotion>,
}

impl Flight<'_> {
    /// Measured less simulated in window `window`, for each of several values of the window's own unknowns.
    pub(crate) fn residuals(&self, window: usize, unknowns: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let window = &self.record.windows[window];
        let joints = &self.motion.samples[(2 * window.first_step).min(self.motion.samples.len() - 1)..];
        let grid = window.grid(self.record.start_s);
        let thrust = self.rollout.thrust(&self.record.valves, &grid, joints);
        let fly = |x: &Vec<f64>| {
            let start = BaseSample { t_s: grid.start_s, pose: [x[0], x[1], x[2]], velocity: [x[3], x[4], x[5]] };
            let mut pushed = thrust.clone();
            window.disturb(&x[6..], &mut pushed);
            let mut out = vec![start; grid.steps + 1];
            self.rollout.run(&start, &grid, joints, &pushed, &mut out);
            self.rows(window, &Simulated { motion: &out, start_s: grid.start_s, thrust: &pushed })
        };
        unknowns.iter().map(fly).collect()
    }
}

/// The base's motion in a window.
struct Simulated<'a> {
    motion: &'a [BaseSample],
    start_s: f64,
    thrust: &'a [[f64; 3]],
}

impl Simulated<'_> {
    /// The motion at a time: a cubic between steps, straight on outside.
    fn at(&self, t_s: f64) -> BaseSample {
        let at = (t_s - self.start_s) / STEP_S;
        let before = (at.floor().max(0.0) as usize).min(self.motion.len() - 2);
        let (a, b, s) = (&self.motion[before], &self.motion[before + 1], at - before as f64);
        if !(0.0..=1.0).contains(&s) {
            let near = if s < 0.0 { a } else { b };
            let dt = t_s - near.t_s;
            let pose = std::array::from_fn(|i| near.pose[i] + dt * near.velocity[i]);
            return BaseSample { t_s, pose, velocity: near.velocity };
        }
        let pose = std::array::from_fn(|i| {
            let (p, q, u, v) = (a.pose[i], b.pose[i], a.velocity[i] * STEP_S, b.velocity[i] * STEP_S);
            let d = q - p;
            p + s * (u + s * (3.0 * d - 2.0 * u - v + s * (u + v - 2.0 * d)))
        });
        let velocity = std::array::from_fn(|i| a.velocity[i] + s * (b.velocity[i] - a.velocity[i]));
        BaseSample { t_s, pose, velocity }
    }
}

impl Flight<'_> {
    fn half(&self, t_s: f64) -> usize {
        let half = ((t_s - self.record.start_s) / (0.5 * STEP_S)).round().max(0.0) as usize;
        half.min(self.motion.samples.len() - 1)
    }

    /// Base pose and joint angles; between grid points the joints go on at their rate.
    fn configuration(&self, base: &BaseSample, t_s: f64) -> Coordinates {
        let half = self.half(t_s);
        let sample = &self.motion.samples[half];
        let dt = t_s - (self.record.start_s + 0.5 * STEP_S * half as f64);
        let mut q = Coordinates::zeros();
        q.fixed_rows_mut::<3>(0).copy_from_slice(&base.pose);
        q.fixed_rows_mut::<{ fss_multibody::MAX_LINKS }>(3).copy_from(&(sample.q_rad + dt * sample.qd_rad_s));
        q
    }

    /// Measured less simulated, in the order of the window's rows.
    fn rows(&self, window: &Window, simulated: &Simulated) -> Vec<f64> {
        let run = &self.record.run;
        let mut out = Vec::with_capacity(window.row_count);
        if let Some(poses) = &run.base_pose {
            for k in window.poses.clone() {
                let sensors = &self.rollout.physics(poses.t_s[k]).sensors;
                let base = simulated.at(poses.t_s[k] - sensors.age_s(Stream::BasePose));
                let seen = sensors.base_reading(base.pose);
                out.extend(difference(poses.values[k], seen));
            }
        }
        if let Some(gyro) = &run.gyro {
            for k in window.gyro.clone() {
                let sensors = &self.rollout.physics(gyro.t_s[k]).sensors;
                let base = simulated.at(gyro.t_s[k] - sensors.age_s(Stream::Gyro));
                out.push(gyro.values[k] - sensors.gyro_reading(base.velocity[2]));
            }
        }
        if let Some(ee) = &run.ee_pose {
            for k in window.ee.clone() {
                let sensors = &self.rollout.physics(ee.t_s[k]).sensors;
                let t_s = ee.t_s[k] - sensors.age_s(Stream::EePose);
                let q = self.configuration(&simulated.at(t_s), t_s);
                let seen = sensors.pose_reading(self.rollout.model(t_s).end_effector(&q).into());
                out.extend(difference(ee.values[k], seen));
            }
        }
        self.torque_rows(window, simulated, &mut out);
        out
    }
}

/// A pose less another, the angle within half a turn.
fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    let turn = a[2] - b[2];
    // Nearly always within half a turn already: a floor is dear in the innermost loop.
    let turn = if turn.abs() <= PI { turn } else { turn - TAU * (turn / TAU).round() };
    [a[0] - b[0], a[1] - b[1], turn]
}
