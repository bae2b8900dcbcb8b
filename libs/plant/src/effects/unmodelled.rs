//! `unmodelled`
//!
//! The diagnosis says so with a channel and words; in a simulation the channels `base_force`,
//! `base_torque` and `joint_torque_1`.. act as strength sin(2 pi frequency t + phase). Where a channel ends with
//! `_by_place`, the way of the base along the direction (m) stands for the time; `base_torque_by_heading` counts the
//! base's turns, `joint_torque_1_by_angle`.. the joint's. `joint_torque_1_by_rate`.. resists as the strength times the
//! square of the joint's rate, N m s2/rad2. `base_force_by_velocity` is the strength (N s/m) times the base's velocity along the
//! direction, and points the phase further round than that; `base_torque_by_rate` the strength (N m s/rad) times its rate. All others
//! only describe.
//!
//! What was fitted to data says nothing of where they were not: outside `from` and `to` nothing acts.

use crate::effect::Effect;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place};
use crate::physics::{BaseLaw, BaseMotion, JointLaw, Physics};

pub(super) struct Unmodelled;

const ABOUT: About = About {
    id: "unmodelled",
    sentence: "Something acts that no other effect explains.",
    place: Place::Unknown,
    index: Index::Channel,
    parameters: &[
        Parameter::new("strength", "", "size in the unit of the channel: N, N m")
            .within(-1000000.0, 1000000.0)
            .scale(0.01),
        Parameter::new("frequency_Hz", "Hz", "of a periodic action; 0 is steady").within(0.0, 1000.0).scale(0.1),
        Parameter::new("direction_rad", "rad", "of a force, in the table frame").within(-7.0, 7.0).scale(0.3),
        Parameter::new("phase_rad", "rad", "of a periodic action at the start of the run")
            .nominal(std::f64::consts::FRAC_PI_2)
            .within(-7.0, 7.0)
            .scale(0.3),
        Parameter::new("from", "", "it acts from here on, in the unit of what it depends on: s, m, turns, m/s, rad/s")
            .within(-1000000.0, 1000000.0),
        Parameter::new("to", "", "and up to here; everywhere where both are the same").within(-1000000.0, 1000000.0),
    ],
};

type Law = fn(&[f64; MAX_PARAMETERS], &BaseMotion) -> [f64; 3];

impl EffectKind for Unmodelled {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        let values = effect.padded();
        let base = |law: Law, depends_on_velocity| BaseLaw { law, values, depends_on_velocity };
        match effect.channel() {
            Some("base_force") => physics.base_laws.push(base(force, false)),
            Some("base_torque") => physics.base_laws.push(base(torque, false)),
            Some("base_force_by_place") => physics.base_laws.push(base(force_by_place, false)),
            Some("base_force_by_velocity") => physics.base_laws.push(base(force_by_velocity, true)),
            Some("base_torque_by_rate") => physics.base_laws.push(base(torque_by_rate, true)),
            Some("base_torque_by_heading") => physics.base_laws.push(base(torque_by_heading, false)),
            Some(channel) => {
                let Some(of_joint) = channel.strip_prefix("joint_torque_") else { return };
                let (joint, by) = of_joint.split_once("_by_").unwrap_or((of_joint, "time"));
                let law = match by {
                    "angle" => joint_torque_by_angle,
                    "rate" => joint_torque_by_rate,
                    "time" => joint_torque,
                    _ => return,
                };
                let joint = joint.parse::<usize>().ok().and_then(|n| n.checked_sub(1));
                if let Some(joint) = joint.filter(|j| *j < physics.joints.len()) {
                    physics.joint_laws.push(JointLaw { joint, law, values: effect.padded() });
                }
            }
            None => {}
        }
    }
}

/// The strength where `along`, what the law depends on, is where it acts.
fn strength(p: &[f64; MAX_PARAMETERS], along: f64) -> f64 {
    let is_everywhere = p[4] == p[5];
    if is_everywhere || (p[4]..=p[5]).contains(&along) { p[0] } else { 0.0 }
}

/// `along` counts seconds, metres or turns.
fn sine(p: &[f64; MAX_PARAMETERS], along: f64) -> f64 {
    strength(p, along) * (std::f64::consts::TAU * p[1] * along + p[3]).sin()
}

fn force(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    let (sin, cos) = p[2].sin_cos();
    let size = sine(p, base.t_s);
    [size * cos, size * sin, 0.0]
}

fn force_by_place(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    let (sin, cos) = p[2].sin_cos();
    let size = sine(p, cos * base.pose[0] + sin * base.pose[1]);
    [size * cos, size * sin, 0.0]
}

fn force_by_velocity(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    let (sin, cos) = p[2].sin_cos();
    let along = cos * base.velocity[0] + sin * base.velocity[1];
    let size = strength(p, along) * along;
    let (sin, cos) = (p[2] + p[3]).sin_cos();
    [size * cos, size * sin, 0.0]
}

fn torque_by_rate(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    let along = base.velocity[2];
    [0.0, 0.0, strength(p, along) * along]
}

fn torque_by_heading(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    [0.0, 0.0, sine(p, base.pose[2] / std::f64::consts::TAU)]
}

fn torque(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    [0.0, 0.0, sine(p, base.t_s)]
}

fn joint_torque(p: &[f64; MAX_PARAMETERS], t_s: f64, _q_rad: f64, _qd_rad_s: f64) -> f64 {
    sine(p, t_s)
}

fn joint_torque_by_angle(p: &[f64; MAX_PARAMETERS], _t_s: f64, q_rad: f64, _qd_rad_s: f64) -> f64 {
    sine(p, q_rad / std::f64::consts::TAU)
}

fn joint_torque_by_rate(p: &[f64; MAX_PARAMETERS], _t_s: f64, _q_rad: f64, qd_rad_s: f64) -> f64 {
    -strength(p, qd_rad_s) * qd_rad_s.abs() * qd_rad_s
}
