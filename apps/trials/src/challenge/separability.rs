//! What the experiments of a vehicle can tell apart.
//!
//! Each uncertain value of the plant is moved by its standard deviation: what that does to the sensors is taken off a hidden
//! effect, within two standard deviations. Then each other effect of the catalogue is moved by its typical size: the share of
//! the rest that it explains, the squared cosine between the two, says whether it could stand in the hidden one's place.

use super::effect_size::{Difference, Yardstick};
use super::record::is_shape;
use fss_plant::{Effect, Plant, effects};
use miette::Result;

/// Uncertain values are let off by as many standard deviations.
const TOLERANCE: f64 = 2.0;
/// An effect of which another explains this share is not separable: a cosine of 0.9.
const EXPLAINED: f64 = 0.81;
/// Sweeps of the coordinate descent.
const SWEEPS: usize = 60;
/// A drive that is softer than this swings visibly, N m/rad.
const TYPICAL_STIFFNESS_N_M_RAD: f64 = 500.0;

/// What a vehicle's uncertain values do to the sensors.
pub(super) struct Tolerances {
    responses: Vec<Vec<f64>>,
    /// Products of these.
    gram: Vec<Vec<f64>>,
}

impl Tolerances {
    /// Of the plant whose yardstick is given.
    ///
    /// # Errors
    /// Where the plant is no mechanism.
    pub(super) fn new(plant: &Plant, yardstick: &Yardstick<'_>) -> Result<Self> {
        let response = |laboratory: &Plant| yardstick.difference(laboratory).map(|difference| difference.samples());
        let responses: Vec<Vec<f64>> = moved(plant).iter().map(response).collect::<Result<_>>()?;
        let gram = responses.iter().map(|a| responses.iter().map(|b| dot(a, b)).collect()).collect();
        Ok(Self { responses, gram })
    }

    /// What the uncertain values leave of a difference: least squares in a box, by coordinates.
    pub(super) fn take_off(&self, difference: &Difference) -> Vec<f64> {
        let mut left = difference.samples();
        let products: Vec<f64> = self.responses.iter().map(|response| dot(response, &left)).collect();
        let mut moved = vec![0.0; self.responses.len()];
        for _ in 0..SWEEPS {
            for i in 0..moved.len() {
                let others: f64 =
                    self.gram[i].iter().zip(&moved).map(|(g, m)| g * m).sum::<f64>() - self.gram[i][i] * moved[i];
                moved[i] = ((products[i] - others) / self.gram[i][i].max(1e-12)).clamp(-TOLERANCE, TOLERANCE);
            }
        }
        for (response, by) in self.responses.iter().zip(&moved) {
            left.iter_mut().zip(response).for_each(|(sample, v)| *sample -= by * v);
        }
        left
    }
}

/// Whether no other effect of the catalogue explains what is `left` of `effect`.
///
/// # Errors
/// Where another effect makes no mechanism.
pub(super) fn is_separable(effect: &Effect, left: &[f64], plant: &Plant, yardstick: &Yardstick<'_>) -> Result<bool> {
    let whole = dot(left, left).max(1e-12);
    let is_same = |other: &Effect| {
        other.id() == effect.id() && other.index() == effect.index() && other.channel() == effect.channel()
    };
    let mut others: Vec<Effect> = effects::candidates(plant).into_iter().filter(|other| !is_same(other)).collect();
    // What acts in the same place is the likeliest to do the same, and one such effect is enough.
    others.sort_by_key(|other| other.about().place != effect.about().place);
    for other in &others {
        let responses = steps(other)
            .into_iter()
            .map(|step| yardstick.difference(&plant.with_effects(&[step])).map(|difference| difference.samples()));
        let basis = orthonormal(responses.collect::<Result<_>>()?);
        let share = basis.iter().map(|direction| dot(direction, left).powi(2)).sum::<f64>() / whole;
        if share >= EXPLAINED {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Directions of length 1, at right angles, that span the columns (Gram and Schmidt).
fn orthonormal(columns: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for mut own in columns {
        let before = dot(&own, &own).sqrt();
        for other in &basis {
            let along = dot(&own, other);
            own.iter_mut().zip(other).for_each(|(a, b)| *a -= along * b);
        }
        let length = dot(&own, &own).sqrt();
        if length > 1e-6 * before {
            own = own.into_iter().map(|a| a / length).collect();
            basis.push(own);
        }
    }
    basis
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The plant with each of its uncertain values in turn moved by one standard deviation.
fn moved(plant: &Plant) -> Vec<Plant> {
    let Some(u) = plant.uncertainty.clone() else { return Vec::new() };
    let mut all = Vec::new();
    let mut with = |std: f64, change: &dyn Fn(&mut Plant)| {
        if std > 0.0 {
            let mut moved = plant.clone();
            change(&mut moved);
            all.push(moved);
        }
    };
    with(u.base_mass_kg, &|p| p.base.mass_kg += u.base_mass_kg);
    with(u.base_inertia_kg_m2, &|p| p.base.inertia_kg_m2 += u.base_inertia_kg_m2);
    with(u.joint1_xy_m, &|p| p.base.joint1_xy_m[0] += u.joint1_xy_m);
    with(u.joint1_xy_m, &|p| p.base.joint1_xy_m[1] += u.joint1_xy_m);
    with(u.joint1_angle_rad, &|p| p.base.joint1_angle_rad += u.joint1_angle_rad);
    for i in 0..plant.thrusters.len() {
        with(u.thrust_n, &|p| p.set_thrust_n(i, plant.thrust_n(i) + u.thrust_n));
    }
    for i in 0..plant.links.len() {
        with(u.link_length_m, &|p| p.links[i].length_m += u.link_length_m);
        with(u.com_to_next_joint_m, &|p| p.links[i].com_to_next_joint_m += u.com_to_next_joint_m);
        with(u.link_mass_kg, &|p| p.links[i].mass_kg += u.link_mass_kg);
        with(u.link_inertia_kg_m2, &|p| p.links[i].inertia_kg_m2 += u.link_inertia_kg_m2);
        with(u.joint_offset_rad, &|p| p.links[i].joint_offset_rad += u.joint_offset_rad);
        with(u.coulomb_friction_n_m, &|p| p.links[i].coulomb_friction_n_m += u.coulomb_friction_n_m);
        with(u.viscous_friction_n_m_s_rad, &|p| p.links[i].viscous_friction_n_m_s_rad += u.viscous_friction_n_m_s_rad);
        with(u.torque_constant_n_m_a, &|p| p.links[i].torque_constant_n_m_a += u.torque_constant_n_m_a);
    }
    all
}

/// The effect with each of its parameters in turn moved by its typical size. A parameter that only shapes an effect is moved
/// beside a size that is typical.
fn steps(nominal: &Effect) -> Vec<Effect> {
    let parameters = nominal.about().parameters;
    if nominal.id() == "valve_swap" {
        return vec![nominal.clone()];
    }
    if nominal.id() == "joint_flexibility" {
        return vec![nominal.clone().with(&[TYPICAL_STIFFNESS_N_M_RAD])];
    }
    let is_shape = |i: usize| is_shape(parameters[i].name);
    let sizes: Vec<f64> = parameters.iter().enumerate().map(|(i, p)| if is_shape(i) { 0.0 } else { p.scale }).collect();
    let add = |offsets: &[f64]| {
        let values: Vec<f64> = nominal.values().iter().zip(offsets).map(|(v, o)| v + o).collect();
        nominal.clone().with(&values)
    };
    let mut all = Vec::new();
    for (i, parameter) in parameters.iter().enumerate() {
        let mut offsets = if is_shape(i) { sizes.clone() } else { vec![0.0; sizes.len()] };
        offsets[i] = parameter.scale;
        let is_delayed_valve = nominal.channel() == Some("valves");
        if is_delayed_valve {
            offsets[i] = -offsets[i];
        }
        all.push(add(&offsets));
    }
    all
}
