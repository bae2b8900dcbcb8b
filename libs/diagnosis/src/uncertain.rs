//! Values of a plant that are known only so well: `[uncertainty]` of the plant file.
//!
//! They are never named as causes. They take up what they may, as far as their standard deviations make it likely.

use crate::problem::is_same;
use crate::servo_response::own_servo;
use fss_plant::{Effect, Plant, Servo, Uncertainty, Valves};

/// Gains of a servo are known to this share: a driver's tuning follows its load and its supply.
const GAIN_SHARE: f64 = 0.15;
/// Times in which valves open and close are known to this share: they follow pressure, supply and temperature.
const VALVE_TIME_SHARE: f64 = 0.3;

/// One uncertain value.
#[derive(Clone, Debug)]
pub struct Uncertain {
    /// What it is, for reports.
    pub name: String,
    /// Standard deviation, SI units.
    pub sd: f64,
    /// Which link or thruster, from 0.
    pub index: usize,
    /// What it is of a servo that follows datagrams; `None` of all other values.
    pub of_servo: Option<OfServo>,
    value: Value,
}

/// What a servo's answer to its datagrams hangs on, far from linearly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OfServo {
    /// A gain.
    Gain,
    /// The dry friction that it works against.
    DryFriction,
}

impl OfServo {
    fn of(value: &Uncertain, plant: &Plant) -> Option<Self> {
        let there = value.moved(plant, 1.0);
        let (own, moved) = (plant.links.get(value.index)?, there.links.get(value.index)?);
        if there.servo(value.index) != plant.servo(value.index) {
            return Some(Self::Gain);
        }
        (moved.coulomb_friction_n_m != own.coulomb_friction_n_m).then_some(Self::DryFriction)
    }
}

/// A field of a plant, of the link or thruster of an index.
type Field = fn(&mut Plant, usize) -> &mut f64;

/// Where in a plant a value stands.
#[derive(Clone, Copy, Debug)]
enum Value {
    /// In one field.
    Field(Field),
    /// A thruster's thrust at level 1, by which a curve is scaled.
    Thrust,
    /// Stamps of a stream, a channel of `clock_offset`, less true time: an effect of the plant.
    Stamps(&'static str),
}

impl Value {
    fn of(self, plant: &Plant, index: usize) -> f64 {
        match self {
            Self::Field(field) => *field(&mut plant.clone(), index),
            Self::Thrust => plant.thrust_n(index),
            Self::Stamps(stream) => plant.effects.iter().find(|e| are_stamps(e, stream)).map_or(0.0, |e| e.values()[0]),
        }
    }

    fn set(self, plant: &mut Plant, index: usize, value: f64) {
        match self {
            Self::Field(field) => *field(plant, index) = value,
            Self::Thrust => plant.set_thrust_n(index, value),
            Self::Stamps(stream) => {
                plant.effects.retain(|e| !are_stamps(e, stream));
                plant.effects.extend(stamps(stream).map(|e| e.with(&[value])));
            }
        }
    }
}

/// Streams of the links whose stamps hang on the radio's transit: their telemetry, and the datagrams that command them.
const OF_LINKS: [&str; 2] = ["joints", "joint_command"];

/// The effect that the stamps of a stream are wrong by a constant.
fn stamps(stream: &str) -> Option<Effect> {
    Some(Effect::new("clock_offset").ok()?.on(stream))
}

fn are_stamps(effect: &Effect, stream: &str) -> bool {
    stamps(stream).is_some_and(|own| is_same(&own, effect))
}

/// Whether an effect is an error of the stamps of a link's stream.
pub(crate) fn are_link_stamps(effect: &Effect) -> bool {
    OF_LINKS.iter().any(|stream| are_stamps(effect, stream))
}

impl Uncertain {
    /// Its value in a plant, SI units.
    pub fn of(&self, plant: &Plant) -> f64 {
        self.value.of(plant, self.index)
    }

    /// The plant with this value moved by `by` standard deviations.
    pub fn moved(&self, plant: &Plant, by: f64) -> Plant {
        let value = self.of(plant);
        // A mass or a friction cannot become negative, however unsure the laboratory is of it.
        let floor = if value > 0.0 && self.is_positive() { 0.05 * value } else { f64::NEG_INFINITY };
        let mut plant = plant.clone();
        self.value.set(&mut plant, self.index, (value + by * self.sd).max(floor));
        plant
    }

    /// Whether it adds to this cause, which acts just as it does: links' stamps are late beside a clock that is wrong.
    pub(crate) fn adds_to(&self, cause: &Effect) -> bool {
        matches!(self.value, Value::Stamps(stream) if are_stamps(cause, stream))
    }

    fn is_positive(&self) -> bool {
        !(matches!(self.value, Value::Stamps(_)) || self.name.contains("joint1") || self.name.contains("offset"))
    }
}

/// Every uncertain value of a plant: those that its file states, and where it states any, what no file states of a floating vehicle:
/// the gains of its arm's servos and the times of its valves. Where the arm follows datagrams, it is told what servos' answers hang on.
pub(crate) fn uncertain(plant: &Plant, follows_datagrams: bool) -> Vec<Uncertain> {
    let mut all = stated(plant);
    if plant.uncertainty.is_some() && !plant.base.clamped {
        (0..plant.links.len()).for_each(|i| gains(plant.servo(i), i, &mut add_to(&mut all)));
        if plant.thrusters.iter().any(|thruster| !thruster.is_proportional()) {
            valve_times(&plant.valves, &mut add_to(&mut all));
        }
        if follows_datagrams {
            all.extend(arrival(plant));
            for value in &mut all {
                value.of_servo = OfServo::of(value, plant);
            }
        }
    }
    all
}

/// Adds a value in one field, where it is uncertain at all.
fn add_to(all: &mut Vec<Uncertain>) -> impl FnMut(String, f64, usize, Field) {
    move |name, sd, index, value| {
        if sd > 0.0 {
            all.push(Uncertain { name, sd, index, of_servo: None, value: Value::Field(value) });
        }
    }
}

/// The values that `[uncertainty]` states.
pub fn stated(plant: &Plant) -> Vec<Uncertain> {
    let Some(u) = &plant.uncertainty else { return Vec::new() };
    let mut all = Vec::new();
    let mut add = add_to(&mut all);
    if !plant.base.clamped {
        add("base mass_kg".into(), u.base_mass_kg, 0, |p, _| &mut p.base.mass_kg);
        add("base inertia_kg_m2".into(), u.base_inertia_kg_m2, 0, |p, _| &mut p.base.inertia_kg_m2);
    }
    if !plant.links.is_empty() {
        add("joint1 x_m".into(), u.joint1_xy_m, 0, |p, _| &mut p.base.joint1_xy_m[0]);
        add("joint1 y_m".into(), u.joint1_xy_m, 0, |p, _| &mut p.base.joint1_xy_m[1]);
        add("joint1 angle_rad".into(), u.joint1_angle_rad, 0, |p, _| &mut p.base.joint1_angle_rad);
    }
    for i in 0..plant.links.len() {
        links(u, i, &mut add);
    }
    drop(add);
    let other = |name: String, sd, index, value| Uncertain { name, sd, index, of_servo: None, value };
    if u.link_stamp_s > 0.0 && !plant.links.is_empty() {
        all.push(other("link stamps_s".into(), u.link_stamp_s, 0, Value::Stamps(OF_LINKS[0])));
    }
    if u.thrust_n > 0.0 {
        let thrust = |i: usize| other(format!("thruster {} thrust_N", i + 1), u.thrust_n, i, Value::Thrust);
        all.extend((0..plant.thrusters.len()).map(thrust));
    }
    all
}

/// When datagrams reach their links, on average: the radio that takes telemetry takes them, and its transit is known as well.
fn arrival(plant: &Plant) -> Option<Uncertain> {
    let sd = plant.uncertainty.as_ref().map_or(0.0, |u| u.link_stamp_s);
    let value = Value::Stamps(OF_LINKS[1]);
    (sd > 0.0).then(|| Uncertain { name: "datagrams' stamps_s".into(), sd, index: 0, of_servo: None, value })
}

fn links(u: &Uncertainty, i: usize, add: &mut impl FnMut(String, f64, usize, Field)) {
    let name = |what: &str| format!("link {} {what}", i + 1);
    add(name("length_m"), u.link_length_m, i, |p, i| &mut p.links[i].length_m);
    add(name("com_to_next_joint_m"), u.com_to_next_joint_m, i, |p, i| &mut p.links[i].com_to_next_joint_m);
    add(name("mass_kg"), u.link_mass_kg, i, |p, i| &mut p.links[i].mass_kg);
    add(name("inertia_kg_m2"), u.link_inertia_kg_m2, i, |p, i| &mut p.links[i].inertia_kg_m2);
    add(name("joint_offset_rad"), u.joint_offset_rad, i, |p, i| &mut p.links[i].joint_offset_rad);
    add(name("coulomb_friction_N_m"), u.coulomb_friction_n_m, i, |p, i| &mut p.links[i].coulomb_friction_n_m);
    add(name("viscous_friction_N_m_s_rad"), u.viscous_friction_n_m_s_rad, i, |p, i| {
        &mut p.links[i].viscous_friction_n_m_s_rad
    });
    add(name("torque_constant_N_m_A"), u.torque_constant_n_m_a, i, |p, i| &mut p.links[i].torque_constant_n_m_a);
}

fn gains(of: &Servo, i: usize, add: &mut impl FnMut(String, f64, usize, Field)) {
    let name = |what: &str| format!("servo {} {what}", i + 1);
    add(name("position_gain_1_s"), GAIN_SHARE * of.position_gain_1_s, i, |p, i| &mut own_servo(p, i).position_gain_1_s);
    add(name("velocity_gain_N_m_s_rad"), GAIN_SHARE * of.velocity_gain_n_m_s_rad, i, |p, i| {
        &mut own_servo(p, i).velocity_gain_n_m_s_rad
    });
    add(name("velocity_integral_N_m_rad"), GAIN_SHARE * of.velocity_integral_n_m_rad, i, |p, i| {
        &mut own_servo(p, i).velocity_integral_n_m_rad
    });
}

fn valve_times(of: &Valves, add: &mut impl FnMut(String, f64, usize, Field)) {
    add("valves rise_s".into(), VALVE_TIME_SHARE * of.rise_s, 0, |p, _| &mut p.valves.rise_s);
    add("valves fall_s".into(), VALVE_TIME_SHARE * of.fall_s, 0, |p, _| &mut p.valves.fall_s);
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn stamps_that_are_late_may_be_early_as_well_and_a_friction_is_never_negative() {
        let mut plant = Plant::default_laboratory().unwrap();
        let stated = plant.uncertainty.get_or_insert_default();
        (stated.link_stamp_s, stated.coulomb_friction_n_m) = (5e-4, 1.0);
        plant.effects.extend(OF_LINKS.iter().map(|stream| stamps(stream).unwrap().with(&[1e-4])));
        let moved = |name: &str| {
            let all = uncertain(&plant, true);
            let value = all.iter().find(|value| value.name.contains(name)).unwrap();
            value.of(&value.moved(&plant, -1.0))
        };
        for stream in ["link stamps", "datagrams' stamps"] {
            assert!((moved(stream) + 4e-4).abs() < 1e-12, "{stream}: {}", moved(stream));
        }
        assert!(moved("coulomb_friction") > 0.0);
    }
}
