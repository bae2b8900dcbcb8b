//! What a vehicle does in an experiment as its plant file says: the joints' motion, the valves, and the base that follows.
//!
//! Joints are taken to follow their reference, so that nothing needs to be flown to know the path.

use fss_mission::{ArmGoal, BaseGoal, Mission, Phase};
use fss_multibody::{Coordinates, JointVector, Model, State};
use fss_plant::{BaseSample, Grid, JointSample, Plant, Rollout, ValveHistory};
use miette::{IntoDiagnostic, Result};
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Between two samples of the base, s; joints are known at half of it.
pub(super) const STEP_S: f64 = 0.05;
/// Time in which sines fade in and out, s.
const FADE_S: f64 = 3.0;

/// The path of one experiment. Joint values stand at every half step, the base at every step.
pub(super) struct Path {
    /// Encoder angles, rad.
    pub q_rad: Vec<JointVector>,
    /// Their rates, rad/s.
    pub qd_rad_s: Vec<JointVector>,
    /// Their accelerations, rad/s^2.
    pub qdd_rad_s2: Vec<JointVector>,
    /// Torques that the drives pass on, N m.
    pub torque_n_m: Vec<JointVector>,
    /// Valve commands.
    pub valves: ValveHistory,
    /// The base.
    pub base: Vec<BaseSample>,
}

impl Path {
    /// Of a mission that commands base and arm open loop.
    ///
    /// # Errors
    /// Where the plant is no mechanism.
    pub(super) fn of(mission: &Mission, plant: &Plant) -> Result<Self> {
        let steps = (mission.duration_s() / STEP_S) as usize;
        let q_rad: Vec<JointVector> =
            (0..=2 * steps).map(|half| reference(mission, half as f64 * STEP_S / 2.0)).collect();
        let qd_rad_s = derivative(&q_rad);
        let qdd_rad_s2 = derivative(&qd_rad_s);
        let rollout = Rollout::with(plant, &[]).into_diagnostic()?;
        let valves = ValveHistory::new(openings(mission, plant.thrusters.len()));
        let joints: Vec<JointSample> =
            q_rad.iter().zip(&qd_rad_s).map(|(q, qd)| JointSample { q_rad: *q, qd_rad_s: *qd }).collect();
        let grid = Grid { start_s: 0.0, step_s: STEP_S, steps };
        let thrust = rollout.thrust(&valves, &grid, &joints);
        let start = BaseSample { t_s: 0.0, pose: mission.initial.base_pose, velocity: mission.initial.base_rate };
        let mut base = vec![start; steps + 1];
        rollout.run(&start, &grid, &joints, &thrust, &mut base);
        let torque_n_m = (0..=2 * steps)
            .map(|half| {
                let at = &base[half / 2];
                let push = table_axes(at, thrust.get(half / 2).copied().unwrap_or_default());
                drive_torques(rollout.model(0.0), at, &joints[half], &qdd_rad_s2[half], &push)
            })
            .collect();
        Ok(Self { q_rad, qd_rad_s, qdd_rad_s2, torque_n_m, valves, base })
    }

    /// Number of steps.
    pub(super) fn steps(&self) -> usize {
        self.base.len() - 1
    }

    /// How far from the middle of the table the base comes along an axis, m.
    pub(super) fn farthest_m(&self) -> f64 {
        farthest_m(&self.base)
    }

    /// How fast the base turns, rad/s.
    pub(super) fn fastest_rad_s(&self) -> f64 {
        self.base.iter().map(|sample| sample.velocity[2].abs()).fold(0.0, f64::max)
    }
}

/// How far from the middle of the table a base comes along an axis, m.
pub(super) fn farthest_m(base: &[BaseSample]) -> f64 {
    base.iter().map(|sample| sample.pose[0].abs().max(sample.pose[1].abs())).fold(0.0, f64::max)
}

/// A force and torque in base axes, in table axes instead.
pub(super) fn table_axes(base: &BaseSample, [fx, fy, torque]: [f64; 3]) -> Vector3<f64> {
    let (sin, cos) = base.pose[2].sin_cos();
    Vector3::new(cos * fx - sin * fy, sin * fx + cos * fy, torque)
}

/// Coordinates of arm and base, or their rates.
pub(super) fn coordinates(base: [f64; 3], joints: &JointVector) -> Coordinates {
    let mut all = Coordinates::zeros();
    all.as_mut_slice()[..3].copy_from_slice(&base);
    all.as_mut_slice()[3..].copy_from_slice(joints.as_slice());
    all
}

/// Torques that drives pass on to links which accelerate as given while `push` acts on the base, table axes (N, N, N m).
pub(super) fn drive_torques(
    model: &Model,
    base: &BaseSample,
    joints: &JointSample,
    qdd_rad_s2: &JointVector,
    push: &Vector3<f64>,
) -> JointVector {
    let state = State { q: coordinates(base.pose, &joints.q_rad), v: coordinates(base.velocity, &joints.qd_rad_s) };
    let accelerations = model.prescribed_dynamics(&state, qdd_rad_s2, push);
    let forces = model.inverse_dynamics(&state, &accelerations);
    JointVector::from_fn(|i, _| forces[3 + i])
}

/// Central differences of a series at half steps.
pub(super) fn derivative(series: &[JointVector]) -> Vec<JointVector> {
    let last = series.len().saturating_sub(1);
    (0..series.len())
        .map(|i| {
            let (before, after) = (i.saturating_sub(1), (i + 1).min(last));
            (series[after] - series[before]) / ((after - before).max(1) as f64 * STEP_S / 2.0)
        })
        .collect()
}

/// Encoder angles that the mission asks for at `t_s` after its start.
fn reference(mission: &Mission, t_s: f64) -> JointVector {
    let mut from = JointVector::zeros();
    from.iter_mut().zip(&mission.initial.q_rad).for_each(|(own, q)| *own = *q);
    let mut begins_s = 0.0;
    for phase in &mission.phases {
        let own_s = t_s - begins_s;
        let at = asked(phase, &from, own_s.min(phase.longest_s()));
        if own_s <= phase.longest_s() {
            return at;
        }
        from = at;
        begins_s += phase.longest_s();
    }
    from
}

fn asked(phase: &Phase, from: &JointVector, t_s: f64) -> JointVector {
    let towards = |goal: &[f64], share: f64| {
        JointVector::from_fn(|i, _| from[i] + goal.get(i).map_or(0.0, |goal| (goal - from[i]) * share))
    };
    match &phase.arm {
        ArmGoal::Joints(goal) => towards(goal, quintic(t_s / phase.duration_s)),
        ArmGoal::Sines { about_rad, sines } => {
            let mut q_rad = towards(about_rad, quintic(t_s / FADE_S));
            let envelope = quintic(t_s / FADE_S) * (1.0 - quintic((t_s - phase.duration_s + FADE_S) / FADE_S));
            for sine in sines {
                q_rad[sine.joint] +=
                    envelope * sine.amplitude_rad * (TAU * sine.frequency_hz * t_s + sine.phase_rad).sin();
            }
            q_rad
        }
        _ => *from,
    }
}

/// Share of a way from rest to rest with continuous acceleration.
fn quintic(share: f64) -> f64 {
    let u = share.clamp(0.0, 1.0);
    u * u * u * (10.0 + u * (-15.0 + 6.0 * u))
}

/// Valves as commanded, where that changes.
fn openings(mission: &Mission, count: usize) -> Vec<(f64, Vec<bool>)> {
    let mut pulses: Vec<(f64, f64, usize)> = Vec::new();
    let mut begins_s = 0.0;
    for phase in &mission.phases {
        if let BaseGoal::Valves(own) = &phase.base {
            for pulse in own {
                let opens_s = begins_s + pulse.at_s;
                pulses.extend(pulse.thrusters.iter().map(|thruster| (opens_s, opens_s + pulse.for_s, *thruster)));
            }
        }
        begins_s += phase.longest_s();
    }
    let mut times: Vec<f64> = pulses.iter().flat_map(|(opens_s, shuts_s, _)| [*opens_s, *shuts_s]).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let open_at = |t_s: f64| {
        let is_open = |thruster| {
            pulses.iter().any(|(opens_s, shuts_s, own)| *own == thruster && (*opens_s..*shuts_s).contains(&t_s))
        };
        (t_s, (0..count).map(is_open).collect())
    };
    times.into_iter().map(open_at).collect()
}
