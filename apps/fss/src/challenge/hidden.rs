//! What a seed hides: effects, their sizes, and the laboratory around them.
//!
//! The laboratory differs from the plant file in everything that a real one differs in: its values are drawn within their
//! uncertainty, its servos are tuned a little differently, its joints stick a little. That is no fault.

use super::survey::Survey;
use super::twins::{Baseline, Twins};
use fss_plant::{Effect, Plant, effects};
use miette::{IntoDiagnostic, Result};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// How often nothing, two effects, and something outside the catalogue is hidden; else it is one effect.
const SHARES: [f64; 3] = [0.20, 0.15, 0.10];
/// Doses are drawn between these, evenly in their logarithm.
const DOSES: (f64, f64) = (0.3, 30.0);
/// No parameter departs further from nominal than this many times its typical size.
const LARGEST: f64 = 15.0;
/// Servos are tuned differently by this share.
const SERVO_SPREAD: f64 = 0.03;
/// Half a table less room for the arm, m.
const EDGE_M: f64 = 1.9;

/// What kind of secret a seed has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Nothing is hidden.
    None,
    /// One effect of the catalogue.
    One,
    /// Two effects of the catalogue.
    Two,
    /// Something that the catalogue does not have.
    Outside,
}

/// An effect in plain words and numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Its id.
    pub effect: String,
    /// Which thruster, link or joint, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub index: Option<usize>,
    /// Which data stream.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel: Option<String>,
    /// When it begins, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub onset_s: Option<f64>,
    /// Its values by name.
    pub parameters: BTreeMap<String, f64>,
}

impl Record {
    /// Of an effect.
    pub fn of(effect: &Effect) -> Self {
        let names = effect.about().parameters.iter().map(|p| p.name.to_owned());
        Self {
            effect: effect.id().to_owned(),
            index: effect.index(),
            channel: effect.channel().map(str::to_owned),
            onset_s: effect.onset_s(),
            parameters: names.zip(effect.values().iter().copied()).collect(),
        }
    }

    /// Whether two are the same cause, whatever their size.
    pub fn is_same_cause(&self, other: &Self) -> bool {
        if self.effect == "valve_swap" && other.effect == "valve_swap" {
            let pair = |r: &Self| {
                let own = r.index.unwrap_or(0);
                let other = r.parameters.get("other_index").map_or(0, |i| *i as usize);
                (own.min(other), own.max(other))
            };
            return pair(self) == pair(other);
        }
        self.effect == other.effect && self.index == other.index && self.channel == other.channel
    }
}

impl std::fmt::Display for Record {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.effect)?;
        if let Some(index) = self.index {
            write!(f, " {index}")?;
        }
        if let Some(channel) = &self.channel {
            write!(f, " of {channel}")?;
        }
        let values: Vec<_> = self.parameters.iter().map(|(name, value)| format!("{name} {}", short(*value))).collect();
        if !values.is_empty() {
            write!(f, " ({})", values.join(", "))?;
        }
        self.onset_s.map_or(Ok(()), |onset_s| write!(f, " from {onset_s:.1} s"))
    }
}

/// Four digits that count.
pub fn short(value: f64) -> String {
    let digits = if value == 0.0 { 0 } else { (3 - value.abs().log10().floor() as i32).clamp(0, 9) };
    format!("{value:.0$}", digits as usize)
}

/// One hidden effect.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct HiddenEffect {
    /// What it is.
    #[serde(flatten)]
    pub record: Record,
    /// Values at which it would do nothing.
    pub nominal: BTreeMap<String, f64>,
    /// RMS of what it does to the sensors, over noise and disturbance ([`Twins`]).
    pub dose: f64,
    /// The same beyond what the plant's tolerances could do, where a survey was made ([`super::survey::Survey`]).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dose_beyond_tolerance: Option<f64>,
    /// Whether these experiments can tell it from every other effect of the catalogue, where a survey was made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub is_separable: Option<bool>,
}

impl HiddenEffect {
    /// The dose that counts: beyond tolerances, where that is known.
    pub fn clear_dose(&self) -> f64 {
        self.dose_beyond_tolerance.unwrap_or(self.dose)
    }
}

/// The sealed envelope.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Envelope {
    /// `fss-challenge-envelope/1`.
    pub format: String,
    /// The seed that all of this was drawn from.
    pub seed: u64,
    /// How much is hidden.
    pub kind: Kind,
    /// What is hidden.
    pub effects: Vec<HiddenEffect>,
}

/// A seed's secret and the laboratory that has it.
pub struct Secret {
    /// What to open in the end.
    pub envelope: Envelope,
    /// The laboratory.
    pub laboratory: Plant,
}

/// Draws the secret of a seed.
///
/// # Errors
/// Where the plant and an effect make no mechanism.
pub fn draw(seed: u64, plant: &Plant, twins: &Twins, survey: Option<&Survey>) -> Result<Secret> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let room = laboratory(plant, &mut random);
    let lot: f64 = random.random();
    let kind = match lot {
        lot if lot < SHARES[0] => Kind::None,
        lot if lot < SHARES[0] + SHARES[1] => Kind::Two,
        lot if lot < SHARES[0] + SHARES[1] + SHARES[2] => Kind::Outside,
        _ => Kind::One,
    };
    let baseline = twins.baseline(&room)?;
    let mut hidden: Vec<(Effect, f64)> = Vec::new();
    while hidden.len() < [0, 1, 2, 1][kind as usize] {
        let unit = if kind == Kind::Outside { outside(plant, &mut random) } else { inside(plant, &mut random) };
        if hidden.iter().all(|(other, _)| other.id() != unit.nominal.id()) {
            let wanted = DOSES.0 * (DOSES.1 / DOSES.0).powf(random.random());
            hidden.push(sized(&unit, &room, twins, &baseline, wanted)?);
        }
    }
    let mut effects = Vec::new();
    for (effect, dose) in &hidden {
        let nominal = effect.clone().nominal(plant);
        let surveyed = survey.map(|survey| survey.of(effect, &room, twins, &baseline)).transpose()?;
        let dose_beyond_tolerance = surveyed.as_ref().map(|s| s.dose);
        let is_separable = surveyed.map(|s| s.is_separable);
        effects.push(HiddenEffect {
            record: Record::of(effect),
            nominal: Record::of(&nominal).parameters,
            dose: *dose,
            dose_beyond_tolerance,
            is_separable,
        });
    }
    let hidden: Vec<Effect> = hidden.into_iter().map(|(effect, _)| effect).collect();
    let envelope = Envelope { format: "fss-challenge-envelope/1".to_owned(), seed, kind, effects };
    Ok(Secret { envelope, laboratory: room.with_effects(&hidden) })
}

/// The plant as a real laboratory has it, nothing being wrong.
fn laboratory(plant: &Plant, random: &mut ChaCha8Rng) -> Plant {
    let mut room = plant.drawn(random.random());
    let mut about = |value: &mut f64, share: f64| *value *= 1.0 + share * (2.0 * random.random::<f64>() - 1.0);
    about(&mut room.servo.position_gain_1_s, SERVO_SPREAD);
    about(&mut room.servo.velocity_gain_n_m_s_rad, SERVO_SPREAD);
    about(&mut room.servo.velocity_integral_n_m_rad, SERVO_SPREAD);
    // Dry friction is somewhat larger at rest than in motion: within what is uncertain of it.
    let sticks_n_m = plant.uncertainty.as_ref().map_or(0.0, |u| 0.5 * u.coulomb_friction_n_m) * random.random::<f64>();
    if let Ok(sticks) = Effect::new("joint_stribeck_friction")
        && !plant.links.is_empty()
    {
        room.effects.push(sticks.with(&[sticks_n_m, 0.03]));
    }
    room
}

/// An effect whose size is still open.
struct Unit {
    nominal: Effect,
    /// Departure of each parameter at size 1; a parameter that is no size has none.
    departure: Vec<f64>,
}

impl Unit {
    fn effect(&self, size: f64) -> Effect {
        let parameters = self.nominal.about().parameters;
        let values: Vec<f64> = (self.nominal.values().iter().zip(&self.departure).zip(parameters))
            .map(|((value, departure), parameter)| {
                let kept = if parameter.nominal.is_none() && *value > 0.0 { 0.3 * value } else { parameter.lower };
                let there = value + size * departure;
                if *departure == 0.0 { *value } else { there.clamp(kept.max(parameter.lower), parameter.upper) }
            })
            .collect();
        if self.nominal.id() == "joint_flexibility" {
            return self.nominal.clone().with(&[(1000.0 / size.max(1e-9)).clamp(20.0, 1e5)]);
        }
        self.nominal.clone().with(&values)
    }

    /// The least size that is worth hiding: play makes a joint elastic, which shows however little there is of it.
    fn smallest(&self) -> f64 {
        if self.nominal.id() == "joint_backlash" { 0.2 } else { 1e-3 }
    }

    /// The size that brings a parameter to the largest departure that is allowed.
    fn largest(&self) -> f64 {
        let parameters = self.nominal.about().parameters.iter();
        let shares = parameters.zip(&self.departure).map(|(p, departure)| departure.abs() / p.scale);
        LARGEST / shares.fold(f64::MIN_POSITIVE, f64::max)
    }
}

/// All of motion capture on a late clock is a latency of it, to the last bit: that has one name.
fn one_name<'a>(effect: &'a Effect, candidates: &'a [Effect]) -> &'a Effect {
    let latency = candidates.iter().find(|e| e.id() == "mocap_latency");
    latency.filter(|_| effect.id() == "clock_offset" && effect.channel() == Some("mocap")).unwrap_or(effect)
}

/// Any effect of the catalogue that this laboratory can have.
fn inside(plant: &Plant, random: &mut ChaCha8Rng) -> Unit {
    // The stack has no target, and records its commands by the clock that everything else is measured by.
    let can_be = |e: &Effect| !matches!(e.channel(), Some("target_pose" | "joint_command"));
    let candidates: Vec<Effect> = effects::candidates(plant).into_iter().filter(can_be).collect();
    let mut ids: Vec<&str> = candidates.iter().map(Effect::id).collect();
    ids.dedup();
    let id = ids[random.random_range(0..ids.len())];
    let members: Vec<&Effect> = candidates.iter().filter(|e| e.id() == id).collect();
    let mut nominal = one_name(members[random.random_range(0..members.len())], &candidates).clone();
    if id == "payload" && random.random::<f64>() < 0.3 {
        nominal = nominal.from_onset(random.random_range(8.0..30.0));
    }
    let mut departure: Vec<f64> = Vec::new();
    let mut values = nominal.values().to_vec();
    let directions: Vec<f64> = values.iter().map(|_| StandardNormal.sample(random)).collect();
    for (i, parameter) in nominal.about().parameters.iter().enumerate() {
        departure.push(0.0);
        match parameter.name {
            "other_index" => {}
            "rest_rad" if id == "tether_torsion" => values[i] = random.random_range(-PI..PI),
            "rest_rad" => values[i] = random.random_range(-1.0..1.0),
            "anchor_x_m" | "anchor_y_m" => values[i] = random.random_range(-1.5..1.5),
            "velocity_rad_s" => values[i] = 0.02 * 5_f64.powf(random.random()),
            "cycles_per_rev" => values[i] = f64::from(random.random_range(1..=6_u8)),
            _ => departure[i] = directions[i] * parameter.scale,
        }
        let is_lowest = values[i] <= parameter.lower;
        let is_early = parameter.name == "offset_s" && nominal.channel() != Some("valves");
        if is_lowest || is_early || (id == "thruster_gain" && random.random::<f64>() < 0.6) {
            departure[i] = departure[i].abs() * if id == "thruster_gain" { -1.0 } else { 1.0 };
        }
        // A stream cannot show what is still to come, and a valve not open before its command.
        if parameter.name == "offset_s" && nominal.channel() == Some("valves") {
            departure[i] = -departure[i].abs();
        }
        if parameter.name == "delay_s" {
            departure[i] = departure[i].abs();
        }
    }
    let length =
        departure.iter().zip(nominal.about().parameters).map(|(d, p)| (d / p.scale).powi(2)).sum::<f64>().sqrt();
    if length > 0.0 {
        for d in &mut departure {
            *d /= length;
        }
    }
    Unit { nominal: nominal.with(&values), departure }
}

/// Something that no effect of the catalogue is: forces that follow a clock, the place, the heading or a joint's angle.
fn outside(plant: &Plant, random: &mut ChaCha8Rng) -> Unit {
    let joint = random.random_range(1..=plant.link_count().max(1));
    let (channel, frequency, words) = match random.random_range(0..if plant.links.is_empty() { 4 } else { 6_u8 }) {
        0 => ("base_force".to_owned(), random.random_range(0.1..0.5), "a force that comes and goes with the clock"),
        1 => ("base_torque".to_owned(), random.random_range(0.1..0.5), "a torque that comes and goes with the clock"),
        2 => ("base_force_by_place".to_owned(), random.random_range(1.5..5.0), "a table with waves"),
        3 => ("base_torque_by_heading".to_owned(), random.random_range(4.0..9.0), "a torque that the heading decides"),
        4 => (format!("joint_torque_{joint}"), random.random_range(0.1..0.5), "a joint shaken by the clock"),
        _ => (format!("joint_torque_{joint}_by_angle"), random.random_range(9.0..25.0), "a joint that cogs"),
    };
    let values = [0.0, frequency, random.random_range(-PI..PI), random.random_range(-PI..PI)];
    let kind = effects::find("unmodelled").unwrap_or(effects::catalogue()[0]);
    let nominal = Effect::of(kind).on(&channel).described(words).with(&values);
    Unit { nominal, departure: vec![0.01, 0.0, 0.0, 0.0] }
}

/// The effect at a size that gives it a dose of the lot, where that keeps the vehicle on its table; and its dose.
fn sized(unit: &Unit, room: &Plant, twins: &Twins, baseline: &Baseline, wanted: f64) -> Result<(Effect, f64)> {
    let largest = unit.largest();
    let mut size = 1.0_f64.min(largest);
    for trial in 0.. {
        let effect = unit.effect(size);
        effect.validate(room).into_diagnostic()?;
        let shown = twins.shown(room, baseline, std::slice::from_ref(&effect))?;
        let is_there = shown.dose <= 1e-3 || (shown.dose / wanted).ln().abs() < 0.2 || trial >= 4;
        let is_on_table = shown.farthest_m < EDGE_M;
        if is_on_table && is_there || trial >= 10 {
            return Ok((effect, shown.dose));
        }
        let towards = (wanted / shown.dose.max(1e-6)).clamp(0.01, 100.0);
        let next = (size * if is_on_table { towards } else { towards.min(0.6) }).clamp(unit.smallest(), largest);
        if is_on_table && (next - size).abs() < 1e-3 * size {
            return Ok((effect, shown.dose));
        }
        size = next;
    }
    Ok((unit.nominal.clone(), 0.0))
}
