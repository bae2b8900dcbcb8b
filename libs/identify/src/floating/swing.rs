//! Links that swing on elastic drives.
//!
//! A soft drive's link goes on swinging after each command, and its servo, which feels that, damps it within some tenths of a
//! second: five reports a second tell neither. What the drivers were told and when is in the log, and how they carry it out in
//! the plant file. So the arm is simulated as the vehicle's drivers would move it, and telemetry corrects where motors are.

use super::telemetry::{Reading, readings};
use crate::measured::{Many, Run};
use crate::trial::Trial;
use fss_plant::{Effect, JointPhysics, Plant};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A drive stiffer than this follows its torque at once, N m/rad: its link swings faster than the simulation's steps, and is
/// damped sooner than anything is measured.
const STIFF_N_M_RAD: f64 = 3000.0;
/// So many simulations are remembered: a contest asks for the same again and again.
const REMEMBERED: usize = 6;

/// What became of drives: `None` where the plant with them is impossible.
type Known = (Vec<Effect>, Option<Arc<Swing>>);

/// A run's arm on elastic drives.
pub(super) struct Swings {
    /// The plant without elastic drives.
    plant: Plant,
    ages_s: Vec<f64>,
    known: Mutex<Vec<Known>>,
}

/// One simulation of it on a grid, as telemetry corrects it.
pub(super) struct Swing {
    /// Telemetry, and what the simulation expects of the encoders.
    pub(super) expected: Run,
    pub(super) readings: Vec<Vec<Reading>>,
    ahead: Vec<Vec<[f64; 3]>>,
}

impl Swing {
    /// Angle, rate and acceleration of a link less those of its motor, where that is what a drive does.
    pub(super) fn ahead(&self, joint: usize, at: usize, drive: &JointPhysics) -> Option<[f64; 3]> {
        drive.stiffness_n_m_rad.filter(|k| *k < STIFF_N_M_RAD).map(|_| self.ahead[joint][at])
    }
}

impl Swings {
    /// `ages_s` is how much older each link's telemetry is than its stamps say.
    pub(super) fn new(trial: &Trial, ages_s: Vec<f64>) -> Self {
        let mut plant = trial.to_plant();
        plant.effects.retain(|effect| !is_elastic(effect));
        Self { plant, ages_s, known: Mutex::new(Vec::new()) }
    }

    /// The arm where a trial has soft drives; `None` where it has none, or nobody knows what they were told.
    pub(super) fn of(&self, trial: &Trial, run: &Run, grid_s: &[f64]) -> Option<Arc<Swing>> {
        let soft = |e: &&Effect| is_elastic(e) && e.values()[0] < STIFF_N_M_RAD;
        let drives: Vec<Effect> = trial.effects.iter().filter(soft).cloned().collect();
        if drives.is_empty() || run.commands.is_none() {
            return None;
        }
        if let Some((_, swing)) = self.lock().iter().find(|(known, _)| *known == drives) {
            return swing.clone();
        }
        let swing = self.simulated(&drives, run, grid_s).map(Arc::new);
        let mut known = self.lock();
        if known.len() >= REMEMBERED {
            known.remove(0);
        }
        known.push((drives, swing.clone()));
        swing
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Known>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn simulated(&self, drives: &[Effect], run: &Run, grid_s: &[f64]) -> Option<Swing> {
        let carried_out = run.commands.as_ref()?.swung(&self.plant.with_effects(drives)).ok()?;
        let expected = Run { joint_command: Some(carried_out.encoder), joints: run.joints.clone(), ..Run::default() };
        let joints = 0..self.ages_s.len();
        let reading = |i: usize| readings(&expected, i, &self.plant.sensors, &|_| self.ages_s[i], grid_s);
        let (ahead, rate) = (&carried_out.ahead, &carried_out.ahead_rate);
        let at = |i: usize, t_s: f64| {
            let value = |many: &Many| many.at(i, t_s).unwrap_or(0.0);
            [value(ahead), value(rate), rate.rate_at(i, t_s).unwrap_or(0.0)]
        };
        let of_joint = |i: usize| grid_s.iter().map(|t_s| at(i, *t_s)).collect();
        let (readings, ahead) = (joints.clone().map(reading).collect(), joints.map(of_joint).collect());
        Some(Swing { expected, readings, ahead })
    }
}

fn is_elastic(effect: &Effect) -> bool {
    effect.id() == "joint_flexibility"
}
