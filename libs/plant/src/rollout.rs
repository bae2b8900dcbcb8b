//! The base alone, fast: joints and thrusters go as recorded, the base follows from the momentum.
//!
//! Where the joints' motion is known, base and arm obey six equations: the base moves with what the momentum leaves
//! after the arm's share (resolved momentum; Umetani and Yoshida, 1989), and only forces from outside change the
//! momentum. Joint accelerations are not needed, so that nothing has to be differentiated.

use fss_multibody::{Coordinates, JointVector, MAX_DOF, Model, ModelError, State};
use nalgebra::Vector3;

use crate::effect::Effect;
use crate::file::Plant;
use crate::physics::{BaseMotion, Physics, Stream, ThrusterPhysics};
use crate::thrust::plume_hit;
use crate::valves::Valve;

/// Joint angles and rates at one time; zero beyond the last joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointSample {
    /// Joint angles without encoder errors (rad).
    pub q_rad: JointVector,
    /// Joint rates (rad/s).
    pub qd_rad_s: JointVector,
}

/// Motion of the base frame at one time, table frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaseSample {
    /// Time since the start of the run (s).
    pub t_s: f64,
    /// Pose (m, m, rad).
    pub pose: [f64; 3],
    /// Velocity (m/s, m/s, rad/s).
    pub velocity: [f64; 3],
}

/// Commanded levels of a run's thrusters, 0 to 1: each row holds until the next. Valves are the levels 0 and 1.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ValveHistory {
    rows: Vec<(f64, Vec<f64>)>,
}

impl ValveHistory {
    /// Rows of stamp (s) and commands, levels or the states of valves (`bool`), in order of time.
    pub fn new<L: Copy + Into<f64>>(rows: Vec<(f64, Vec<L>)>) -> Self {
        let levels = |row: Vec<L>| row.into_iter().map(Into::into).collect();
        Self { rows: rows.into_iter().map(|(stamp_s, row)| (stamp_s, levels(row))).collect() }
    }

    /// All pulses, thruster by thruster, each thruster's in order of time.
    pub fn pulses(&self) -> Vec<Pulse> {
        let count = self.rows.iter().map(|(_, levels)| levels.len()).max().unwrap_or(0);
        (0..count).flat_map(|thruster| self.pulses_of(thruster)).collect()
    }

    fn pulses_of(&self, thruster: usize) -> Vec<Pulse> {
        let mut out: Vec<Pulse> = Vec::new();
        let mut was_pushing = false;
        for (stamp_s, levels) in &self.rows {
            let pushes = levels.get(thruster).is_some_and(|level| *level > REST_LEVEL);
            if pushes && !was_pushing {
                out.push(Pulse { thruster, from_s: *stamp_s, to_s: f64::INFINITY });
            } else if was_pushing
                && !pushes
                && let Some(pulse) = out.last_mut()
            {
                pulse.to_s = *stamp_s;
            }
            was_pushing = pushes;
        }
        out
    }

    /// The same commands with the level 0 in place of a pulse.
    pub fn without(&self, pulse: &Pulse) -> Self {
        let mut rows = self.rows.clone();
        let first = rows.partition_point(|(stamp_s, _)| *stamp_s < pulse.from_s);
        let end = rows.partition_point(|(stamp_s, _)| *stamp_s < pulse.to_s);
        for (_, levels) in &mut rows[first..end] {
            if let Some(level) = levels.get_mut(pulse.thruster) {
                *level = 0.0;
            }
        }
        Self { rows }
    }
}

/// Largest level at which a thruster rests. A propeller idles at a few hundredths of the full level and hardly pushes there.
const REST_LEVEL: f64 = 0.1;

/// A maximal interval in which one thruster is commanded above rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulse {
    /// The thruster that is commanded, from 0.
    pub thruster: usize,
    /// Stamp of the first command above rest (s).
    pub from_s: f64,
    /// Stamp of the first command at rest again (s); infinite where the record ends before.
    pub to_s: f64,
}

/// Steps of equal length that a rollout takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Time of the first sample since the start of the run (s).
    pub start_s: f64,
    /// Length of a step (s).
    pub step_s: f64,
    /// Number of steps.
    pub steps: usize,
}

/// A lag leaves `exp(-60)` of a level after so many time constants: 1e-26.
const FORGOTTEN_AFTER: f64 = 60.0;

/// From when it holds (s), what acts, and the mechanism.
type Stage = (f64, Physics, Model);

/// The plant, ready for rollouts.
#[derive(Debug, Clone)]
pub struct Rollout {
    stages: Vec<Stage>,
}

/// Base pose and momentum: linear, and angular about the table's origin.
#[derive(Debug, Clone, Copy)]
struct Momentum {
    pose: Vector3<f64>,
    momentum: Vector3<f64>,
}

impl Rollout {
    /// The plant with its effects. Disturbance and noise play no part, gas use does not change the mass.
    ///
    /// # Errors
    /// When effects make a mass or an inertia impossible.
    pub fn new(plant: &Plant) -> Result<Self, ModelError> {
        Self::with(plant, &plant.effects)
    }

    /// The plant's nominal values with exactly these effects.
    ///
    /// # Errors
    /// When effects make a mass or an inertia impossible.
    pub fn with(plant: &Plant, effects: &[Effect]) -> Result<Self, ModelError> {
        let stages = Physics::stages(plant, effects)
            .into_iter()
            .map(|(t, physics)| physics.model(0.0).map(|model| (t, physics, model)));
        Ok(Self { stages: stages.collect::<Result<_, _>>()? })
    }

    /// What acts at `t_s`.
    pub fn physics(&self, t_s: f64) -> &Physics {
        &self.stages[self.stage(t_s)].1
    }

    /// The mechanism at `t_s`.
    pub fn model(&self, t_s: f64) -> &Model {
        &self.stages[self.stage(t_s)].2
    }

    fn stage(&self, t_s: f64) -> usize {
        self.stages.iter().rposition(|(onset, ..)| t_s >= *onset).unwrap_or(0)
    }

    /// Mean thrust on the base in each step of the grid, base axes, about the base frame's origin
    /// `[N, N, N m]`: what the thrusters make of their commands. `joints` is as in [`Rollout::run`]; plumes that hit the arm
    /// push it.
    ///
    /// Lag and curve are integrated in closed form. Droop takes the other thrusters at their means, and a trend is that of
    /// the step's middle.
    pub fn thrust(&self, commands: &ValveHistory, grid: &Grid, joints: &[JointSample]) -> Vec<[f64; 3]> {
        let mut out = Vec::with_capacity(grid.steps);
        self.each_step(commands, grid, |stage, valves, middle_s| {
            let arm = joints.get(2 * out.len() + 1).or(joints.last());
            out.push(mean_thrust(stage, valves, middle_s, arm));
        });
        out
    }

    /// Mean force of each thruster in each step of the grid (N), as [`Rollout::thrust`] sums them up: one row a thruster.
    pub fn thruster_forces(&self, commands: &ValveHistory, grid: &Grid) -> Vec<Vec<f64>> {
        let mut out = vec![Vec::with_capacity(grid.steps); self.stages[0].1.thrusters.len()];
        self.each_step(commands, grid, |(_, physics, _), valves, middle_s| {
            for (row, force) in out.iter_mut().zip(mean_forces(physics, valves, middle_s)) {
                row.push(force);
            }
        });
        out
    }

    /// Lets the thrusters follow their commands through the grid; `see` is told of each step the stage, the thrusters with
    /// their means over the step, and the step's middle (s).
    fn each_step(&self, commands: &ValveHistory, grid: &Grid, mut see: impl FnMut(&Stage, &[Valve], f64)) {
        let early = self.physics(grid.start_s).sensors.clock_offset_s[Stream::Valves as usize];
        let count = self.stages[0].1.thrusters.len();
        let mut states = vec![Valve::new(); count];
        // The first pass only brings the thrusters to the start of the grid, from the row that held when their memory begins.
        let forgotten_s = grid.start_s - memory_s(self.physics(grid.start_s - 0.5 * grid.step_s));
        let forgotten = commands.rows.partition_point(|(stamp, _)| stamp - early < forgotten_s);
        let mut rows = commands.rows[forgotten.saturating_sub(1)..].iter().peekable();
        let mut now = f64::NEG_INFINITY;
        for step in 0..=grid.steps {
            let to = grid.start_s + step as f64 * grid.step_s;
            let middle = to - 0.5 * grid.step_s;
            let stage = &self.stages[self.stage(middle)];
            let thrusters = &stage.1.thrusters;
            while let Some((stamp, levels)) = rows.next_if(|(stamp, _)| stamp - early < to) {
                for (valve, thruster) in states.iter_mut().zip(thrusters) {
                    let level = levels.get(thruster.line).copied().unwrap_or(0.0);
                    if step == 0 && now.is_finite() {
                        valve.advance(now, stamp - early, thruster);
                    }
                    valve.command(level, stamp - early + thruster.delay_s);
                }
                if step == 0 {
                    now = stamp - early;
                }
            }
            let from = if now.is_finite() { now } else { to - grid.step_s };
            if from < to {
                for (valve, thruster) in states.iter_mut().zip(thrusters) {
                    valve.mean = valve.advance(from, to, thruster);
                }
            }
            now = to;
            if step > 0 {
                see(stage, &states, middle);
            }
        }
    }

    /// Motion of the base from `start` through the grid, written to `out` (its first `steps + 1` samples).
    ///
    /// `joints` holds a sample at every half step, `2 steps + 1` of them, or one alone for an arm that stays as it is;
    /// missing ones repeat the last. `thrust` is what [`Rollout::thrust`] gives for the same grid, or empty.
    pub fn run(
        &self,
        start: &BaseSample,
        grid: &Grid,
        joints: &[JointSample],
        thrust: &[[f64; 3]],
        out: &mut [BaseSample],
    ) {
        let rest = JointSample { q_rad: JointVector::zeros(), qd_rad_s: JointVector::zeros() };
        let joint = |half: usize| joints.get(half).or(joints.last()).unwrap_or(&rest);
        let mut stage = self.stage(grid.start_s);
        let mut state = self.momentum_of(stage, start, joint(0));
        for (step, sample) in out.iter_mut().take(grid.steps + 1).enumerate() {
            let t_s = grid.start_s + step as f64 * grid.step_s;
            let now = self.stage(t_s + 1e-9);
            if now != stage {
                // Velocities go on as they are, momentum is what the new masses make of it.
                let rates = self.rates(stage, t_s, &state, joint(2 * step), [0.0; 3]);
                let before = BaseSample { t_s, pose: state.pose.into(), velocity: rates.pose.into() };
                stage = now;
                state = self.momentum_of(stage, &before, joint(2 * step));
            }
            let push = thrust.get(step).copied().unwrap_or([0.0; 3]);
            let k1 = self.rates(stage, t_s, &state, joint(2 * step), push);
            *sample = BaseSample { t_s, pose: state.pose.into(), velocity: k1.pose.into() };
            if step < grid.steps {
                // The rule of the middle: its error, the change of acceleration times step^2 / 24, is far below any sensor.
                let half = 0.5 * grid.step_s;
                let middle =
                    Momentum { pose: state.pose + half * k1.pose, momentum: state.momentum + half * k1.momentum };
                let k2 = self.rates(stage, t_s + half, &middle, joint(2 * step + 1), push);
                state.pose += grid.step_s * k2.pose;
                state.momentum += grid.step_s * k2.momentum;
            }
        }
    }

    /// Velocity of the base and what changes the momentum.
    #[inline]
    fn rates(&self, stage: usize, t_s: f64, state: &Momentum, joint: &JointSample, thrust: [f64; 3]) -> Momentum {
        let (_, physics, model) = &self.stages[stage];
        let q = coordinates(&state.pose, &joint.q_rad);
        let velocity = model.base_twist(&q, &joint.qd_rad_s, &about_base(&state.pose, &state.momentum));
        let (sin, cos) = state.pose.z.sin_cos();
        let mut force = Vector3::new(cos * thrust[0] - sin * thrust[1], sin * thrust[0] + cos * thrust[1], thrust[2]);
        if !physics.base_laws.is_empty() {
            let base = BaseMotion { t_s, pose: state.pose.into(), velocity: velocity.into() };
            force += Vector3::from(physics.base_wrench(&base));
        }
        let mut push = about_origin(&state.pose, &force);
        let [gx, gy] = physics.gravity_m_s2;
        if gx != 0.0 || gy != 0.0 {
            let centre = model.center_of_mass(&q);
            push += model.total_mass_kg() * Vector3::new(gx, gy, centre.x * gy - centre.y * gx);
        }
        Momentum { pose: velocity, momentum: push }
    }

    fn momentum_of(&self, stage: usize, base: &BaseSample, joint: &JointSample) -> Momentum {
        let pose = Vector3::from(base.pose);
        let q = coordinates(&pose, &joint.q_rad);
        let v = coordinates(&Vector3::from(base.velocity), &joint.qd_rad_s);
        let momentum = self.stages[stage].2.momentum(&State { q, v }).about_base();
        Momentum { pose, momentum: about_origin(&pose, &momentum) }
    }
}

/// How long a command matters (s): what it leaves of an earlier level afterwards is far below the last digit.
fn memory_s(physics: &Physics) -> f64 {
    let of = |t: &ThrusterPhysics| t.delay_s + t.min_on_s + FORGOTTEN_AFTER * t.rise_s.max(t.fall_s);
    physics.thrusters.iter().map(of).fold(0.0, f64::max)
}

/// Mean force of each thruster in a step around `t_s` (N).
fn mean_forces(physics: &Physics, valves: &[Valve], t_s: f64) -> impl Iterator<Item = f64> {
    let trend = physics.supply.trend(t_s);
    let level_sum: f64 = valves.iter().map(|v| v.mean[0]).sum();
    let thrusters = valves.iter().zip(&physics.thrusters);
    thrusters.map(move |(valve, thruster)| trend * thruster.mean_force_n(valve.mean, level_sum, &physics.supply))
}

fn mean_thrust(stage: &Stage, valves: &[Valve], t_s: f64, arm: Option<&JointSample>) -> [f64; 3] {
    let (_, physics, model) = stage;
    let mut sum = [0.0; 3];
    let forces = mean_forces(physics, valves, t_s).zip(&physics.thrusters);
    for (force, thruster) in forces.filter(|(force, _)| *force != 0.0) {
        let mut unit = thruster.unit_wrench();
        // In base axes the plume and the arm are where the joints say, wherever the base is.
        let hit = arm.and_then(|arm| plume_hit(thruster, model, &coordinates(&Vector3::zeros(), &arm.q_rad)));
        if let Some(hit) = hit {
            unit[0] += hit.push[0];
            unit[1] += hit.push[1];
            unit[2] += hit.at_m[0] * hit.push[1] - hit.at_m[1] * hit.push[0];
        }
        for (s, u) in sum.iter_mut().zip(unit) {
            *s += force * u;
        }
    }
    sum
}

fn coordinates(base: &Vector3<f64>, joints: &JointVector) -> Coordinates {
    let mut q = Coordinates::zeros();
    q.fixed_rows_mut::<3>(0).copy_from(base);
    q.fixed_rows_mut::<{ MAX_DOF - 3 }>(3).copy_from(joints);
    q
}

fn about_origin(pose: &Vector3<f64>, base: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(base.x, base.y, base.z + pose.x * base.y - pose.y * base.x)
}

fn about_base(pose: &Vector3<f64>, origin: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(origin.x, origin.y, origin.z - pose.x * origin.y + pose.y * origin.x)
}
