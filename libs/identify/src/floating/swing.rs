//! Links that swing on elastic drives.
//!
//! A soft drive's link goes on swinging after each command, and its servo, which feels that, damps it within some tenths of a
//! second: five reports a second tell neither. What the drivers were told and when is in the log, and how they carry it out in
//! the plant file. So the arm is simulated as the vehicle's drivers would move it, and telemetry corrects where motors are.

use super::telemetry::{Reading, readings};
use crate::trial::Trial;
use fss_experiments::commands::{CarriedOut, Commands};
use fss_experiments::measured::Run;
use fss_plant::{Effect, JointPhysics, Plant};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A drive stiffer than this follows its torque at once, N m/rad: its link swings faster than the simulation's steps, and is
/// damped sooner than anything is measured.
pub(crate) const STIFF_N_M_RAD: f64 = 3000.0;
/// One stiffness at which drives are simulated, N m/rad.
const SIMULATED_N_M_RAD: f64 = 200.0;
/// What a drive does changes smoothly with its stiffness: drives are simulated at so many stiffnesses from one to three times it,
/// and between four of these a cubic goes through what they do.
const IN_THREEFOLD: f64 = 11.0;
/// A stiffness within this share of the way from one of these to the next is that one.
const NEAR: f64 = 0.01;
/// So many simulations, and arms that telemetry corrects, are remembered: a contest asks for the same again and again.
const REMEMBERED_SIMULATIONS: usize = 100;
const REMEMBERED: usize = 6;

/// A run's arm on elastic drives.
pub(super) struct Swings {
    /// The plant without elastic drives.
    plant: Plant,
    ages_s: Vec<f64>,
    simulated: Known<CarriedOut>,
    corrected: Known<Swing>,
}

/// What became of drives; `None` where the plant with them is impossible.
type Became<T> = (Vec<Effect>, Option<Arc<T>>);

/// What became of all that were asked about lately, the newest last.
struct Known<T>(Mutex<Vec<Became<T>>>);

impl<T> Known<T> {
    fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// What is known of these drives, or is found now; `most` are remembered.
    fn of(&self, drives: &[Effect], most: usize, find: impl FnOnce() -> Option<T>) -> Option<Arc<T>> {
        if let Some((_, known)) = self.lock().iter().find(|(known, _)| known == drives) {
            return known.clone();
        }
        let found = find().map(Arc::new);
        let mut known = self.lock();
        if known.len() >= most {
            known.remove(0);
        }
        known.push((drives.to_vec(), found.clone()));
        found
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Became<T>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One simulation of it on a grid, as telemetry corrects it.
pub(super) struct Swing {
    /// Telemetry, and what the simulation expects of the encoders.
    pub(super) expected: Run,
    pub(super) readings: Vec<Vec<Reading>>,
    /// Of joints whose drives swing; the others' are empty.
    ahead: Vec<Vec<[f64; 3]>>,
}

impl Swing {
    /// Angle, rate and acceleration of a link less those of its motor, where that is what a drive does.
    pub(super) fn ahead(&self, joint: usize, at: usize, drive: &JointPhysics) -> Option<[f64; 3]> {
        drive.stiffness_n_m_rad.filter(|k| *k < STIFF_N_M_RAD).and_then(|_| self.ahead[joint].get(at).copied())
    }
}

impl Swings {
    /// `ages_s` is how much older each link's telemetry is than its stamps say.
    pub(super) fn new(trial: &Trial, ages_s: Vec<f64>) -> Self {
        let mut plant = trial.to_plant();
        plant.effects.retain(|effect| !is_elastic(effect));
        Self { plant, ages_s, simulated: Known::new(), corrected: Known::new() }
    }

    /// The arm where a trial has soft drives; `None` where it has none, or nobody knows what they were told.
    pub(super) fn of(&self, trial: &Trial, run: &Run, grid_s: &[f64]) -> Option<Arc<Swing>> {
        let commands = run.commands.as_ref()?;
        let soft = |e: &&Effect| is_elastic(e) && e.values()[0] < STIFF_N_M_RAD;
        // A drive that grows soft during the run is simulated as soft from the start: before, nobody asks for its swing.
        let soft_always = |e: &Effect| e.clone().from_onset(0.0);
        let drives: Vec<Effect> = trial.effects.iter().filter(soft).map(soft_always).collect();
        if drives.is_empty() {
            return None;
        }
        self.corrected
            .of(&drives, REMEMBERED, || Some(self.corrected(&drives, &*self.near(&drives, commands)?, run, grid_s)))
    }

    /// What drives do, from what they do at stiffnesses nearby.
    fn near(&self, drives: &[Effect], commands: &Commands) -> Option<Arc<CarriedOut>> {
        // Four simulations of a drive alone; of several, which are many, each between two.
        let weights = if drives.len() == 1 { cubic } else { linear };
        let mut around: Vec<(f64, Vec<Effect>)> = vec![(1.0, Vec::new())];
        for drive in drives {
            let nodes = nodes(drive.values()[0], weights);
            let beside = |(w, others): &(f64, Vec<Effect>)| -> Vec<(f64, Vec<Effect>)> {
                let with = |stiffness: f64| others.iter().cloned().chain([drive.clone().with(&[stiffness])]).collect();
                nodes.iter().map(|(own, stiffness)| (w * own, with(*stiffness))).collect()
            };
            around = around.iter().flat_map(beside).collect();
        }
        let part = |(w, drives): (f64, Vec<Effect>)| Some((w, self.simulated(&drives, commands)?));
        let parts = around.into_iter().map(part).collect::<Option<Vec<_>>>()?;
        match &parts[..] {
            [(_, alone)] => Some(Arc::clone(alone)),
            _ => Some(Arc::new(CarriedOut::mixed(&parts.iter().map(|(w, part)| (*w, &**part)).collect::<Vec<_>>()))),
        }
    }

    fn simulated(&self, drives: &[Effect], commands: &Commands) -> Option<Arc<CarriedOut>> {
        self.simulated.of(drives, REMEMBERED_SIMULATIONS, || commands.swung(&self.plant.with_effects(drives)).ok())
    }

    fn corrected(&self, drives: &[Effect], carried_out: &CarriedOut, run: &Run, grid_s: &[f64]) -> Swing {
        // Commands throw a motor within milliseconds, and its link hardly at once: what the motor did between two rows must be
        // taken off as it was put on, or links would be thrown too.
        let CarriedOut { motor, link, link_rate } = carried_out;
        let at = |i: usize, t_s: f64| {
            Some([
                link.at(i, t_s)? - motor.at(i, t_s)?,
                link_rate.at(i, t_s)? - motor.rate_at(i, t_s)?,
                link_rate.rate_at(i, t_s)? - motor.acceleration_at(i, t_s)?,
            ])
        };
        let joints = 0..self.ages_s.len();
        let swings = |i: usize| drives.iter().any(|drive| drive.index().is_none_or(|joint| joint == i + 1));
        let of_joint = |i: usize| {
            let times = if swings(i) { grid_s } else { &[] };
            times.iter().map(|t_s| at(i, *t_s).unwrap_or_default()).collect()
        };
        let ahead = joints.clone().map(of_joint).collect();
        let expected = Run { joint_command: Some(motor.clone()), joints: run.joints.clone(), ..Run::default() };
        let reading = |i: usize| readings(&expected, i, &self.plant.sensors, &|_| self.ages_s[i], grid_s);
        let readings = joints.map(reading).collect();
        Swing { expected, readings, ahead }
    }
}

/// Stiffnesses around this one at which drives are simulated, each with its weight; where it is one of them, that alone.
fn nodes(stiffness_n_m_rad: f64, weights: fn(f64) -> [f64; 4]) -> Vec<(f64, f64)> {
    let at = place(stiffness_n_m_rad);
    if (at - at.round()).abs() < NEAR {
        return vec![(1.0, at_place(at.round()))];
    }
    let before = at.floor();
    let around = [-1.0, 0.0, 1.0, 2.0].map(|k| at_place(before + k));
    weights(at - before).into_iter().zip(around).filter(|(w, _)| *w != 0.0).collect()
}

/// Four stiffnesses around this one, and other than it, at which drives are simulated: two on each side.
pub(crate) fn around(stiffness_n_m_rad: f64) -> [f64; 4] {
    let at = place(stiffness_n_m_rad);
    let (below, above) = ((at - NEAR).floor(), (at + NEAR).ceil());
    [below - 1.0, below, above, above + 1.0].map(at_place)
}

/// Where a stiffness lies among those at which drives are simulated, which are at whole numbers.
fn place(stiffness_n_m_rad: f64) -> f64 {
    IN_THREEFOLD * (stiffness_n_m_rad / SIMULATED_N_M_RAD).ln() / 3.0_f64.ln()
}

/// The stiffness at a place, N m/rad.
pub(crate) fn at_place(place: f64) -> f64 {
    SIMULATED_N_M_RAD * 3.0_f64.powf(place / IN_THREEFOLD)
}

/// Weights of values at -1, 0, 1 and 2 in the cubic through them (Lagrange), from 0 to 1.
fn cubic(at: f64) -> [f64; 4] {
    let (a, b, c, d) = (at + 1.0, at, at - 1.0, at - 2.0);
    [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0]
}

/// The same of the straight line through the middle two.
fn linear(at: f64) -> [f64; 4] {
    [0.0, 1.0 - at, at, 0.0]
}

fn is_elastic(effect: &Effect) -> bool {
    effect.id() == "joint_flexibility"
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use fss_experiments::measured::Many;

    /// Of what a joint 2 does; the others rest.
    fn joint_2(t_s: &[f64], value: impl Fn(f64) -> f64) -> Many {
        let rest = vec![0.0; t_s.len()];
        let values = vec![rest.clone(), t_s.iter().map(|t| value(*t)).collect(), rest.clone(), rest];
        Many { t_s: t_s.to_vec(), values }
    }

    #[test]
    fn a_link_is_not_thrown_where_its_motor_is() {
        let plant = Plant::parse(include_str!("../../../../deploy/etc/plants/fss.toml")).unwrap();
        let swings = Swings::new(&Trial::of(&plant), vec![0.0; 4]);
        let t_s: Vec<f64> = (0..400).map(|k| 0.005 * f64::from(k)).collect();
        // Told to go on at another rate at 1 s, the motor does so at once, and its link within a tenth of a second.
        let motor = joint_2(&t_s, |t| 0.2 * (t - 1.0).max(0.0));
        let link_rate = |t: f64| 0.2 * (1.0 - (-(t - 1.0).max(0.0) / 0.1).exp());
        let link = joint_2(&t_s, |t| 0.2 * (t - 1.0).max(0.0) - 0.1 * link_rate(t));
        let carried_out = CarriedOut { motor, link, link_rate: joint_2(&t_s, link_rate) };
        let grid_s: Vec<f64> = (0..200).map(|k| 0.01 * f64::from(k)).collect();
        let soft = Effect::new("joint_flexibility").unwrap().at(2).with(&[150.0]);
        let swing = swings.corrected(&[soft], &carried_out, &Run::default(), &grid_s);
        for (k, t_s) in grid_s.iter().enumerate() {
            let rate = swing.readings[1][k].value[1] + swing.ahead[1][k][1];
            assert!((rate - link_rate(*t_s)).abs() < 1e-3, "{rate} rad/s at {t_s} s, not {}", link_rate(*t_s));
        }
    }

    #[test]
    fn a_cubic_goes_through_what_it_is_given_and_between_as_a_cubic_does() {
        let value = |x: f64| 2.0 - x + 0.5 * x * x - 0.25 * x * x * x;
        for at in [0.0, 0.2, 0.7, 1.0] {
            let sum: f64 = cubic(at).iter().zip([-1.0, 0.0, 1.0, 2.0]).map(|(w, x)| w * value(x)).sum();
            assert!((sum - value(at)).abs() < 1e-12, "{sum} at {at}");
        }
    }

    #[test]
    fn a_stiffness_lies_between_those_at_which_drives_are_simulated() {
        for stiffness in [66.0, 150.0, 207.0, 2900.0] {
            let around = nodes(stiffness, linear);
            assert!(around[0].1 < stiffness && stiffness < around[1].1, "{stiffness}: {around:?}");
            let mean: f64 = nodes(stiffness, cubic).iter().map(|(w, node)| w * node.ln()).sum();
            assert!((mean - stiffness.ln()).abs() < 1e-9, "{stiffness}");
        }
        let [a, b, c, d] = around(SIMULATED_N_M_RAD);
        assert!(a < b && b < SIMULATED_N_M_RAD && SIMULATED_N_M_RAD < c && c < d, "{:?}", [a, b, c, d]);
        for alone in [200.0, 600.0, 200.0 / 3.0] {
            let around = nodes(alone, cubic);
            assert!(matches!(around[..], [(_, node)] if (node - alone).abs() < 1e-9 * alone), "{around:?}");
        }
    }
}
