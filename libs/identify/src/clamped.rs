//! A clamped arm: its joints are simulated from a fitted state, driven by the measured current or by nothing.

use crate::trial::{Flight, Record, RowInfo, Span, Trial, Whitened};
use fss_experiments::measured::{Drive, Joints, Run};
use fss_multibody::{Coordinates, ModelError};
use fss_plant::{Effect, JointCommand, Place, Plant, Simulation};
use std::ops::Range;

/// Samples closer than this are averaged, s.
const BIN_S: f64 = 0.01;
/// Longest step of the simulation, s.
const STEP_S: f64 = 0.005;
/// Windows of a run that are looked at, at most: spread evenly, they say as much as all.
const MOST_WINDOWS: usize = 8;
/// A window with fewer samples cannot hold an initial state and say anything.
const FEWEST_SAMPLES: usize = 8;

/// A run of a clamped arm.
pub(crate) struct Clamped {
    name: String,
    joints: Joints,
    drive: Drive,
    links: usize,
    channels: Vec<String>,
    windows: Vec<Range<usize>>,
    spans: Vec<Span>,
}

impl Clamped {
    /// `None` where the run lacks what it takes: angles and rates of all joints.
    pub(crate) fn new(trial: &Trial, run: &Run, window_s: f64) -> Option<Self> {
        let links = trial.plant.link_count();
        let joints =
            run.joints.as_ref().filter(|j| j.q_rad.len() >= links && j.qd_rad_s.len() >= links && links > 0)?;
        if !run.tells_what_drives() {
            return None;
        }
        let mut windows = Vec::new();
        let mut from = 0;
        while from < joints.t_s.len() {
            let to = joints.t_s.partition_point(|t| *t < joints.t_s[from] + window_s);
            if to - from >= FEWEST_SAMPLES {
                windows.push(from..to);
            }
            from = to;
        }
        let stride = windows.len().div_ceil(MOST_WINDOWS).max(1);
        let windows: Vec<Range<usize>> = windows.into_iter().step_by(stride).collect();
        let channels = (1..=links).map(|i| format!("q{i}")).chain((1..=links).map(|i| format!("qd{i}"))).collect();
        let spans = windows.iter().map(|w| span(&trial.plant, run.drive, joints, w)).collect();
        let (name, joints) = (run.name.clone(), joints.clone());
        Some(Self { name, joints, drive: run.drive, links, channels, windows, spans })
    }
}

/// How fast the square of each joint's rate wanders off where its drive is known by noisy currents, rad^2/s^3: they are what
/// the simulation is driven by.
pub(crate) fn wander(plant: &Plant, drive: Drive, joints: &Joints, window: &Range<usize>) -> Vec<f64> {
    let links = plant.link_count();
    let still = vec![0.0; links];
    let (Ok(model), false) = (plant.model(), drive == Drive::Free || joints.current_a.is_empty()) else { return still };
    let mut q = Coordinates::zeros();
    for (i, angle) in joints.q_rad.iter().take(links).enumerate() {
        q[3 + i] = angle[window.start];
    }
    let arm = model.mass_matrix(&q).view((3, 3), (links, links)).into_owned();
    let Some(inverse) = arm.try_inverse() else { return still };
    let interval_s = (joints.t_s[window.end - 1] - joints.t_s[window.start]) / (window.len() - 1).max(1) as f64;
    let torque_n_m = |j: usize| plant.links[j].torque_constant_n_m_a * plant.sensors.current_a;
    (0..links)
        .map(|i| (0..links).map(|j| (inverse[(i, j)] * torque_n_m(j)).powi(2)).sum::<f64>() * interval_s)
        .collect()
}

fn span(plant: &Plant, drive: Drive, joints: &Joints, window: &Range<usize>) -> Span {
    let links = plant.link_count();
    let sd = [plant.sensors.encoder_rad.max(1e-7), plant.sensors.encoder_rate_rad_s.max(1e-6)];
    let wander = wander(plant, drive, joints, window);
    let middle_s = 0.5 * (joints.t_s[window.start] + joints.t_s[window.end - 1]);
    let variance = |k: usize, i: usize| {
        let away_s = (joints.t_s[k] - middle_s).abs();
        let grows = if i < links { away_s.powi(3) / 3.0 } else { away_s };
        sd[i / links].powi(2) + wander[i % links] * grows
    };
    let mut rows = Vec::new();
    for k in window.clone() {
        for i in 0..2 * links {
            rows.push(RowInfo { channel: i, t_s: joints.t_s[k], variance: variance(k, i) });
        }
    }
    let mut whitening = Vec::new();
    let mut from = window.start;
    while from < window.end {
        let to = joints.t_s.partition_point(|t| *t < joints.t_s[from] + BIN_S - 1e-6).clamp(from + 1, window.end);
        for i in 0..2 * links {
            // Samples of a bin share how far the motion has wandered off, and have a noise each.
            let (own, count) = (sd[i / links].powi(2), (to - from) as f64);
            let weight = 1.0 / (count * own + count * count * (variance(from, i) - own)).sqrt();
            let row = |k: usize| (((k - window.start) * 2 * links + i) as u32, weight);
            whitening.push(Whitened { channel: i, sum: (from..to).map(row).collect() });
        }
        from = to;
    }
    let first = |values: &[Vec<f64>]| values.iter().take(links).map(|v| v[window.start]).collect::<Vec<_>>();
    let mut guess = first(&joints.q_rad);
    guess.extend(first(&joints.qd_rad_s));
    let steps = (0..2 * links).map(|i| if i < links { 1e-5 } else { 1e-4 }).collect();
    let (from_s, to_s) = (joints.t_s[window.start], joints.t_s[window.end - 1]);
    Span { from_s, to_s, guess, steps, prior_count: 0, rows, whitening }
}

impl Record for Clamped {
    fn name(&self) -> &str {
        &self.name
    }

    fn channels(&self) -> &[String] {
        &self.channels
    }

    fn spans(&self) -> &[Span] {
        &self.spans
    }

    fn feels(&self, effect: &Effect) -> bool {
        matches!(effect.about().place, Place::Joint | Place::Mass | Place::Time | Place::Base)
    }

    fn is_chaotic(&self) -> bool {
        true
    }

    fn flight<'a>(&'a self, trial: &Trial) -> Result<Box<dyn Flight + 'a>, ModelError> {
        let simulation = Simulation::new(&trial.to_plant(), 0)?.in_steps_of(STEP_S);
        Ok(Box::new(ClampedFlight { record: self, simulation }))
    }
}

struct ClampedFlight<'a> {
    record: &'a Clamped,
    simulation: Simulation,
}

impl Flight for ClampedFlight<'_> {
    fn residuals(&self, window: usize, unknowns: &[Vec<f64>]) -> Vec<Vec<f64>> {
        unknowns.iter().map(|x| self.rows(&self.record.windows[window], x)).collect()
    }
}

impl ClampedFlight<'_> {
    fn rows(&self, window: &Range<usize>, start: &[f64]) -> Vec<f64> {
        let (joints, n) = (&self.record.joints, self.record.links);
        let mut simulation = self.simulation.clone();
        simulation.begin_at(joints.t_s[window.start]);
        simulation.set_state([0.0; 3], [0.0; 3], &start[..n], &start[n..2 * n]);
        let mut out = Vec::with_capacity(window.len() * 2 * n);
        for k in window.clone() {
            let physics = simulation.physics();
            out.extend((0..n).map(|i| {
                let (q_rad, qd_rad_s) = simulation.joint(i);
                let late = physics.sensors.link_age_s(i) * qd_rad_s;
                joints.q_rad[i][k] - physics.joints[i].encoder_reading(q_rad - late)
            }));
            out.extend((0..n).map(|i| joints.qd_rad_s[i][k] - physics.joints[i].encoder_scale * simulation.joint(i).1));
            if k + 1 < window.end {
                drive(&mut simulation, self.record.drive, joints, k);
                simulation.step(joints.t_s[k + 1] - joints.t_s[k]);
            }
        }
        out
    }
}

/// Has the joints driven by their currents from sample `k` to the next: by their mean, since a current that is measured
/// changes between its samples as angles do. Whoever commanded a joint, its current is what drove it.
pub(crate) fn drive(simulation: &mut Simulation, drive: Drive, joints: &Joints, k: usize) {
    for i in 0..simulation.physics().joints.len() {
        let current = joints.current_a.get(i).map(|a| 0.5 * (a[k] + a.get(k + 1).unwrap_or(&a[k])));
        let command = match (drive, current) {
            (Drive::Free, _) | (_, None) => JointCommand::Free,
            (_, Some(current_a)) => JointCommand::Current { current_a },
        };
        simulation.set_joint(i, command);
    }
}
