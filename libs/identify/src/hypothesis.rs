//! What could be wrong: every effect of the catalogue, as coordinates that the data can be asked about.

use crate::trial::Trial;
use fss_experiments::measured::Run;
use fss_plant::{Effect, Place, Plant, effects};

/// One possible cause.
#[derive(Clone, Debug)]
pub(crate) struct Hypothesis {
    /// The effect where it does nothing.
    pub(crate) nominal: Effect,
    /// The effect where its sensitivities are taken: the same, but that an effect with a shape (the rest angle of a
    /// spring) has some strength there, without which its shape could not be felt.
    pub(crate) probe: Effect,
    /// Whether the parameters after the first are a shape.
    pub(crate) has_shape: bool,
    /// An exchange of wires is there or not: it has no size.
    pub(crate) is_discrete: bool,
}

/// Effects whose first parameter is a strength and whose others say of what: where a spring rests, how fast friction fades.
const SHAPED: &[&str] = &[
    "tether_torsion",
    "tether_linear",
    "joint_spring",
    "joint_stribeck_friction",
    "drive_kinematic_error",
    "joint_backlash",
];
/// Wind-up of a drive per torque at which its sensitivity is taken, rad/(N m): it follows its torque at once.
const COMPLIANCE_RAD_N_M: f64 = 2e-4;
/// The same around a drive that is elastic already, share of its own.
const COMPLIANCE_STEP: f64 = 0.05;
/// Periods a turn at which a drive's kinematic error is looked for.
const CYCLES: &[f64] = &[1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
/// Widths of a drive's play at which it is looked for, rad: how long a link takes from one side to the other is no matter of proportion.
const PLAYS_RAD: &[f64] = &[0.0005, 0.002, 0.006];

/// Every cause that these runs could show.
pub(crate) fn hypotheses(plant: &Plant, runs: &[Run]) -> Vec<Hypothesis> {
    let mut candidates = effects::candidates(plant);
    // Of these, all thrusters may have the same: what they share is upstream. (All late alike is a clock.)
    for id in ["thruster_gain", "thruster_rise_time"] {
        candidates.extend(Effect::new(id).ok().map(|e| e.nominal(plant)));
    }
    candidates.retain(|e| is_askable(e, runs));
    candidates.iter().flat_map(hypotheses_of).collect()
}

fn hypotheses_of(nominal: &Effect) -> Vec<Hypothesis> {
    let about = nominal.about();
    let has_shape = SHAPED.contains(&about.id);
    let is_discrete = about.id == "valve_swap";
    let strong = |mut probe: Effect| {
        let values = [probe.values()[0] + about.parameters[0].scale];
        probe = probe.with(&values);
        probe
    };
    let probed_at = |probe: Effect| Hypothesis { nominal: nominal.clone(), probe, has_shape, is_discrete };
    if about.id == "joint_backlash" {
        return PLAYS_RAD.iter().map(|gap| probed_at(nominal.clone().with(&[*gap]))).collect();
    }
    if about.id == "joint_flexibility" {
        return vec![probed_at(nominal.clone().with(&[1.0 / COMPLIANCE_RAD_N_M]))];
    }
    if about.id == "drive_kinematic_error" {
        let at = |cycles: &f64| {
            let nominal = nominal.clone().with(&[0.0, *cycles]);
            let probe = strong(nominal.clone());
            Hypothesis { nominal, probe, has_shape, is_discrete }
        };
        return CYCLES.iter().map(at).collect();
    }
    vec![probed_at(if has_shape { strong(nominal.clone()) } else { nominal.clone() })]
}

/// Drives whose links may swing on them, where logs tell what these were told.
pub(crate) fn swinging(plant: &Plant, runs: &[Run]) -> Vec<Hypothesis> {
    if runs.iter().all(|run| run.commands.is_none()) {
        return Vec::new();
    }
    let drives = effects::candidates(plant).into_iter().filter(|e| e.id() == "joint_flexibility");
    // What a swing does is no matter of proportion: it has a shape.
    let swings =
        |drive: Effect| Hypothesis { nominal: drive.clone(), probe: drive, has_shape: true, is_discrete: false };
    drives.map(swings).collect()
}

/// Whether anything in these runs could ever show the effect.
fn is_askable(effect: &Effect, runs: &[Run]) -> bool {
    let any = |f: &dyn Fn(&Run) -> bool| runs.iter().any(f);
    let opens = |i: usize| any(&|r| r.fires(i));
    let joints = any(&|r| r.joints.is_some());
    // A joint at rest is held by friction, of whatever size up to its most: what its motor gives then goes nowhere.
    let moves = effect.index().is_none_or(|joint| runs.iter().any(|run| run.moves(joint)));
    let mocap = any(&|r| r.base_pose.is_some());
    let gyro = any(&|r| r.gyro.is_some());
    let valves = any(&Run::fires_at_all);
    match effect.id() {
        "clock_offset" => match effect.channel() {
            Some("mocap") => mocap,
            Some("base_pose" | "ee_pose") => mocap && any(&|r| r.ee_pose.is_some()),
            Some("gyro") => gyro && mocap,
            Some("joints") => joints,
            Some("valves") => valves,
            _ => false,
        },
        "thruster_leak" => true,
        "valve_swap" => {
            effect.index().is_some_and(&opens) || effect.get("other_index").is_some_and(|i| opens(i as usize))
        }
        "gyro_bias" | "gyro_scale" => gyro && mocap,
        "mocap_latency" | "marker_offset" | "marker_yaw" | "mocap_rotation" => mocap,
        "torque_constant"
        | "torque_sensor"
        | "joint_spring"
        | "joint_coulomb_friction"
        | "joint_viscous_friction"
        | "joint_stribeck_friction" => joints && moves,
        "payload" | "link_mass" | "link_com" | "link_inertia" => joints,
        _ => match effect.about().place {
            Place::Thruster => effect.index().map_or(valves, opens),
            Place::Base | Place::Mass => true,
            _ => joints,
        },
    }
}

impl Hypothesis {
    /// Whether an effect is this cause, whatever its size.
    pub(crate) fn is_of(&self, effect: &Effect) -> bool {
        let own = &self.nominal;
        own.id() == effect.id() && own.index() == effect.index() && own.channel() == effect.channel()
    }

    /// Whether another is this cause too, whatever its size, and only looked for at another size.
    pub(crate) fn is_same_cause(&self, other: &Self) -> bool {
        self.is_of(&other.nominal) && self.nominal.values()[1..] == other.nominal.values()[1..]
    }

    /// The same cause around `effect`, which acts already: what more or less of it would do.
    pub(crate) fn around(&self, effect: &Effect) -> Self {
        Self { nominal: effect.clone(), probe: effect.clone(), has_shape: false, is_discrete: self.is_discrete }
    }

    /// The same cause, its sensitivities taken where it has these values.
    pub(crate) fn probed_at(&self, values: &[f64]) -> Self {
        Self { probe: self.with(values), ..self.clone() }
    }

    /// Number of coordinates.
    pub(crate) fn size(&self) -> usize {
        if self.is_discrete || self.nominal.id() == "drive_kinematic_error" { 1 } else { self.parameters() }
    }

    /// Number of parameters that are fitted: of an exchange none.
    pub(crate) fn parameters(&self) -> usize {
        if self.is_discrete { 0 } else { self.nominal.values().len() }
    }

    /// A stiffness that is nominally without bound is asked for by its inverse.
    pub(crate) fn is_compliance(&self) -> bool {
        self.nominal.id() == "joint_flexibility"
    }

    /// Whether it is a drive on which a link swings.
    pub(crate) fn is_swing(&self) -> bool {
        self.is_compliance() && self.has_shape
    }

    /// The pairs of effects between which each coordinate is differenced, and the step.
    pub(crate) fn differences(&self) -> Vec<(Option<Effect>, Effect, f64)> {
        if self.is_discrete {
            return vec![(None, self.nominal.clone(), 1.0)];
        }
        if self.is_compliance() {
            let own = 1.0 / self.nominal.values()[0];
            let probed = 1.0 / self.probe.values()[0];
            let step = if probed > own { probed - own } else { COMPLIANCE_STEP * own };
            return vec![(None, self.with(&[1.0 / (own + step)]), step)];
        }
        let parameters = self.nominal.about().parameters;
        (0..self.size())
            .map(|i| {
                let step = 0.1 * parameters[i].scale;
                if self.has_shape && i == 0 {
                    (None, self.probe.clone(), self.probe.values()[0] - self.nominal.values()[0])
                } else if self.has_shape {
                    (Some(self.probe.clone()), moved(&self.probe, i, step), step)
                } else {
                    (None, moved(&self.nominal, i, step), step)
                }
            })
            .collect()
    }

    /// The effect at coefficients of its coordinates, within its bounds.
    pub(crate) fn at(&self, coefficients: &[f64]) -> Effect {
        if self.is_discrete {
            return self.nominal.clone();
        }
        let mut values = self.probe.values().to_vec();
        if self.is_compliance() {
            values[0] = 1.0 / coefficients[0].max(1e-7);
        } else if self.has_shape {
            let reference = self.probe.values()[0] - self.nominal.values()[0];
            let strength = coefficients[0];
            values[0] = self.nominal.values()[0] + strength;
            for (i, c) in coefficients.iter().enumerate().skip(1) {
                let shift = c * reference / strength;
                let limit = 30.0 * self.nominal.about().parameters[i].scale;
                values[i] += if shift.is_finite() { shift.clamp(-limit, limit) } else { 0.0 };
            }
        } else {
            values.iter_mut().zip(coefficients).for_each(|(v, c)| *v += c);
        }
        bounded(&self.probe, &values)
    }

    /// Whether the effect is where it does nothing.
    pub(crate) fn is_idle(&self, effect: &Effect) -> bool {
        if self.is_discrete {
            return false;
        }
        if self.is_compliance() {
            return effect.values()[0] > 5e4;
        }
        let parameters = self.nominal.about().parameters;
        let moved = |i: usize| (effect.values()[i] - self.nominal.values()[i]).abs() > 1e-6 * parameters[i].scale;
        if self.has_shape { !moved(0) } else { !(0..effect.values().len()).any(moved) }
    }

    /// The effect with these values, within its bounds.
    pub(crate) fn with(&self, values: &[f64]) -> Effect {
        bounded(&self.nominal, values)
    }
}

fn moved(effect: &Effect, parameter: usize, step: f64) -> Effect {
    let mut values = effect.values().to_vec();
    values[parameter] += step;
    effect.clone().with(&values)
}

fn bounded(effect: &Effect, values: &[f64]) -> Effect {
    let mut within: Vec<f64> =
        values.iter().zip(effect.about().parameters).map(|(v, p)| v.clamp(p.lower, p.upper)).collect();
    match (effect.id(), effect.channel()) {
        // All of motion capture late is a latency; as a wrong clock it can only be early.
        ("clock_offset", Some("mocap")) => within[0] = within[0].min(0.0),
        // Static friction that fades no more within the speeds of an arm is dry friction.
        ("joint_stribeck_friction", _) => within[1] = within[1].clamp(0.002, 0.2),
        _ => {}
    }
    effect.clone().with(&within)
}

/// A trial with an effect, or without.
pub(crate) fn with(trial: &Trial, effect: Option<&Effect>) -> Trial {
    effect.map_or_else(|| trial.clone(), |e| trial.with(e))
}
