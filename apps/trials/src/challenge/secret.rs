//! What a seed hides: effects and their sizes.

use super::effect_size::{Difference, Yardstick};
use super::path::Path;
use super::record::{CLEAR_EFFECT_SIZE, Envelope, HiddenEffect, Kind, Record};
use super::separability::{Tolerances, is_separable};
use fss_plant::{Effect, Plant, effects};
use miette::{IntoDiagnostic, Result};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::PI;

/// How often nothing, two effects, and something outside the catalogue is hidden; else it is one effect.
const SHARES: [f64; 3] = [0.20, 0.15, 0.10];
/// Effect sizes are drawn between these, evenly in their logarithm.
const EFFECT_SIZES: (f64, f64) = (0.3, 30.0);
/// No parameter departs further from nominal than this many times its typical size.
const LARGEST: f64 = 15.0;
/// Half a table less room for the arm, m.
const EDGE_M: f64 = 1.9;
/// An effect smaller than this does nothing.
const NO_EFFECT_SIZE: f64 = 1e-3;
/// The random stream of a seed that draws its secret.
const STREAM: u64 = 3;

/// A seed's secret.
pub(super) struct Secret {
    /// What to open in the end.
    pub envelope: Envelope,
    /// What the laboratory has beside its plant.
    pub effects: Vec<Effect>,
}

/// Draws the secret of a seed in a vehicle whose experiments have these paths.
///
/// # Errors
/// Where the plant and an effect make no mechanism.
pub(super) fn draw(seed: u64, plant: &Plant, is_own_vehicle: bool, paths: Vec<&Path>) -> Result<Secret> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(STREAM);
    let lot: f64 = random.random();
    let kind = match lot {
        lot if lot < SHARES[0] => Kind::None,
        lot if lot < SHARES[0] + SHARES[1] => Kind::Two,
        lot if lot < SHARES[0] + SHARES[1] + SHARES[2] => Kind::Outside,
        _ => Kind::One,
    };
    let (format, links) = ("fss-challenge-envelope/2".to_owned(), plant.link_count());
    let mut envelope = Envelope { format, seed, is_own_vehicle, links, kind, effects: Vec::new() };
    let mut effects: Vec<Effect> = Vec::new();
    if kind == Kind::None {
        return Ok(Secret { envelope, effects });
    }
    let yardstick = Yardstick::new(plant, paths)?;
    let tolerances = Tolerances::new(plant, &yardstick)?;
    while effects.len() < 1 + usize::from(kind == Kind::Two) {
        let unit = if kind == Kind::Outside { outside(plant, &mut random) } else { inside(plant, &mut random) };
        if effects.iter().any(|other| other.id() == unit.nominal.id()) {
            continue;
        }
        let wanted = EFFECT_SIZES.0 * (EFFECT_SIZES.1 / EFFECT_SIZES.0).powf(random.random());
        let (effect, difference) = sized(&unit, plant, &yardstick, wanted)?;
        let left = tolerances.take_off(&difference);
        let effect_size_beyond_tolerance = difference.effect_size_of(&left);
        let is_asked = kind == Kind::One && effect_size_beyond_tolerance >= CLEAR_EFFECT_SIZE;
        envelope.effects.push(HiddenEffect {
            record: Record::of(&effect),
            nominal: Record::of(&effect.clone().nominal(plant)).parameters,
            effect_size: difference.effect_size(),
            effect_size_beyond_tolerance,
            is_separable: if is_asked { Some(is_separable(&effect, &left, plant, &yardstick)?) } else { None },
        });
        effects.push(effect);
    }
    Ok(Secret { envelope, effects })
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
    // The stack has no target, and records its commands by the clock that everything else is measured by. Without an arm
    // there is nothing to carry and no stream of it.
    let has_arm = plant.link_count() > 0;
    let can_be = |e: &Effect| match e.channel() {
        Some("target_pose" | "joint_command") => false,
        Some("joints" | "ee_pose") => has_arm,
        _ => has_arm || e.id() != "payload",
    };
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

/// The effect with the wanted effect size, where that keeps the vehicle on its table; and what it does then.
fn sized(unit: &Unit, plant: &Plant, yardstick: &Yardstick<'_>, wanted: f64) -> Result<(Effect, Difference)> {
    let largest = unit.largest();
    let mut size = 1.0_f64.min(largest);
    let mut trial = 0;
    loop {
        let effect = unit.effect(size);
        effect.validate(plant).into_diagnostic()?;
        let laboratory = plant.with_effects(std::slice::from_ref(&effect));
        let difference = yardstick.difference(&laboratory)?;
        let effect_size = difference.effect_size();
        let is_there = effect_size < NO_EFFECT_SIZE || (effect_size / wanted).ln().abs() < 0.2 || trial >= 4;
        let is_on_table = yardstick.farthest_m(&laboratory)? < EDGE_M;
        let towards = (wanted / effect_size.max(NO_EFFECT_SIZE)).clamp(0.01, 100.0);
        let next = (size * if is_on_table { towards } else { towards.min(0.6) }).clamp(unit.smallest(), largest);
        let is_bounded = (next - size).abs() < 1e-3 * size;
        if is_on_table && (is_there || is_bounded) || trial >= 10 {
            return Ok((effect, difference));
        }
        size = next;
        trial += 1;
    }
}
