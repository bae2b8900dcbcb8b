//! One case: a laboratory drawn from what the diagnosis believes beforehand, runs in it, and what the diagnosis says of them.

use fss_diagnosis::diagnosis::{Cause, Diagnosis};
use fss_diagnosis::drawn_causes;
use fss_estimation::statistics::normal_cdf;
use fss_experiments::measured::{Poses, Run, Series};
use fss_multibody::ModelError;
use fss_plant::effects::UNMODELLED;
use fss_plant::{Effect, Instruments, Plant, Simulation};
use miette::{IntoDiagnostic, Result};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;

/// Runs of a case.
pub(super) const RUNS: u64 = 2;
/// Length of a run (s).
pub(super) const RUN_S: f64 = 33.0;
/// Period of the thrusters' commands (s), and share of them that open a valve.
const PULSE_S: f64 = 0.25;
const OPEN_SHARE: f64 = 0.25;
/// Largest distance of the start from the middle of the table along each axis (m).
const START_M: f64 = 0.5;
/// Standard deviations of the velocity at the start (m/s, m/s, rad/s).
const START_VELOCITY: [f64; 3] = [0.02, 0.02, 0.05];
/// Stamps are this much behind the simulation's time (s), so that a sensor whose clock is late can be simulated: it shows what
/// comes after its stamp. No clock is drawn farther off.
const BEHIND_S: f64 = 0.5;

/// How an asserted cause is judged.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Assertion {
    /// It acts, or what these data cannot tell from it.
    ByName,
    /// One of its alternatives acts.
    AsAlternative,
    /// None of them acts.
    Wrong,
}

/// What a case came to.
pub(super) struct Case {
    /// Causes that act.
    pub drawn: usize,
    /// Those of them that are asserted, by name or as an alternative.
    pub recovered: usize,
    /// Those of them of which no inclusion probability is told.
    pub untold: usize,
    /// What is asserted, laws included.
    pub asserted: Vec<Assertion>,
    /// Inclusion probabilities that are told, and whether the cause acts.
    pub inclusion: Vec<(f64, bool)>,
    /// Ranks of the true values in their posteriors, of the asserted causes that act (0 to 1).
    pub ranks: Vec<f64>,
}

/// Draws and diagnoses a case; `None` where what was drawn is no mechanism.
pub(super) fn run(plant: &Plant, seed: u64, number: u64) -> Result<Option<Case>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(number);
    let causes = drawn_causes(plant, RUN_S, &mut random);
    let mut effects = causes.concat();
    for (stream, offset_s) in [("mocap", BEHIND_S), ("gyro", BEHIND_S), ("valves", -BEHIND_S)] {
        effects.push(Effect::new("clock_offset").into_diagnostic()?.on(stream).with(&[offset_s]));
    }
    let laboratory = plant.drawn(random.random()).with_effects(&effects);
    let runs: Result<Vec<Run>, ModelError> =
        (1..=RUNS).map(|run| flown(&laboratory, format!("run {run}"), &mut random)).collect();
    let Ok(runs) = runs else { return Ok(None) };
    let diagnosis = fss_diagnosis::diagnose(plant, &runs, &[], &|_| {}).into_diagnostic()?;
    Ok(Some(Case::of(&diagnosis, &causes)))
}

/// A run with random pulses of all thrusters.
fn flown(laboratory: &Plant, name: String, random: &mut ChaCha8Rng) -> Result<Run, ModelError> {
    let thrust_levels = pulses(laboratory.thrusters.len(), random);
    let mut simulation = Simulation::new(laboratory, random.random())?;
    let mut instruments = Instruments::new(0, random.random());
    let place = [START_M, START_M, PI].map(|largest| random.random_range(-largest..largest));
    simulation.set_state(place, START_VELOCITY.map(|sd| sd * normal(random)), &[], &[]);
    let period_s = 1.0 / laboratory.sensors.mocap_rate_hz;
    let steps = ((RUN_S + 2.0 * BEHIND_S) / period_s).round() as usize;
    let (mut poses, mut gyro) = (Poses::default(), Series::default());
    let mut commands = thrust_levels.iter().peekable();
    for step in 0..=steps {
        let now_s = step as f64 * period_s;
        let stamp_s = now_s - BEHIND_S;
        // Earlier, a sensor would show what was before the simulation began.
        if stamp_s >= BEHIND_S {
            if let Some(pose) = instruments.mocap_base(&simulation) {
                poses.t_s.push(stamp_s);
                poses.values.push(pose);
            }
            gyro.t_s.push(stamp_s);
            gyro.values.push(instruments.gyro(&simulation));
        }
        while let Some((commanded_s, levels)) = commands.next_if(|(at_s, _)| at_s - BEHIND_S < now_s + period_s) {
            for (line, level) in levels.iter().enumerate() {
                simulation.set_level(line, *level, commanded_s - BEHIND_S);
            }
        }
        simulation.step(period_s);
    }
    Ok(Run { name, base_pose: Some(poses), gyro: Some(gyro), thrust_levels, ..Run::default() })
}

/// Levels of each thruster: in each period its valve is open or shut by chance.
fn pulses(thrusters: usize, random: &mut ChaCha8Rng) -> Vec<(f64, Vec<f64>)> {
    let periods = (RUN_S / PULSE_S) as usize;
    let mut rows = Vec::with_capacity(periods);
    for period in 0..periods {
        let levels = (0..thrusters).map(|_| f64::from(random.random::<f64>() < OPEN_SHARE)).collect();
        rows.push((BEHIND_S + period as f64 * PULSE_S, levels));
    }
    rows
}

impl Case {
    fn of(diagnosis: &Diagnosis, truth: &[Vec<Effect>]) -> Self {
        let names = |cause: &Cause| -> [Vec<Effect>; 2] {
            let (equivalent, other): (Vec<_>, Vec<_>) = cause.alternatives.iter().partition(|a| a.is_equivalent);
            let own = std::iter::once(cause.effect.clone()).chain(equivalent.into_iter().map(|a| a.effect.clone()));
            [own.collect(), other.into_iter().map(|a| a.effect.clone()).collect()]
        };
        let mut classes: Vec<[Vec<Effect>; 2]> = diagnosis.causes.iter().map(names).collect();
        for (i, law) in diagnosis.laws.iter().enumerate() {
            // The two components of a force are one law.
            if !diagnosis.laws[..i].iter().any(|other| is_same(other, law)) {
                classes.push([vec![law.clone()], Vec::new()]);
            }
        }
        let holds = |names: &[Effect], cause: &[Effect]| {
            names.iter().any(|name| cause.iter().any(|effect| is_same(effect, name)))
        };
        let acts = |names: &[Effect]| truth.iter().any(|cause| holds(names, cause));
        let judged = |[own, other]: &[Vec<Effect>; 2]| match (acts(own), acts(other)) {
            (true, _) => Assertion::ByName,
            (false, true) => Assertion::AsAlternative,
            (false, false) => Assertion::Wrong,
        };
        let is_recovered = |cause: &&Vec<Effect>| classes.iter().flatten().any(|names| holds(names, cause));
        let is_untold = |cause: &&Vec<Effect>| {
            !diagnosis.inclusion.iter().any(|(effect, _)| holds(std::slice::from_ref(effect), cause))
        };
        let inclusion = diagnosis.inclusion.iter().map(|(effect, p)| (*p, acts(std::slice::from_ref(effect))));
        Self {
            drawn: truth.len(),
            recovered: truth.iter().filter(is_recovered).count(),
            untold: truth.iter().filter(is_untold).count(),
            asserted: classes.iter().map(judged).collect(),
            inclusion: inclusion.collect(),
            ranks: diagnosis.causes.iter().flat_map(|cause| ranks(cause, truth)).collect(),
        }
    }
}

/// Ranks of the true values in the normal posterior of a cause, where it is what acts; values that are not estimated have none.
fn ranks(cause: &Cause, truth: &[Vec<Effect>]) -> Vec<f64> {
    let Some(drawn) = truth.iter().flatten().find(|effect| is_same(effect, &cause.effect)) else { return Vec::new() };
    let estimates = cause.effect.values().iter().zip(&cause.std);
    let known = drawn.values().iter().zip(estimates).filter(|(_, (_, std))| std.is_finite() && **std > 0.0);
    known.map(|(value, (mean, std))| normal_cdf((value - mean) / std)).collect()
}

/// Whether two are the same cause, whatever its size. The diagnosis takes frequencies from the length of what was measured,
/// which is a little less than the run's: they are the same within half a step of its grid.
fn is_same(a: &Effect, b: &Effect) -> bool {
    let same = a.id() == b.id() && a.index() == b.index() && a.channel() == b.channel();
    let apart = |name: &str| (a.get(name).unwrap_or(0.0) - b.get(name).unwrap_or(0.0)).abs();
    match a.id() {
        UNMODELLED => same && apart("frequency_Hz") < 0.25 / RUN_S,
        "valve_swap" => same && apart("other_index") < 0.5,
        _ => same,
    }
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}
