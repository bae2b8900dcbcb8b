//! What these experiments can tell apart.
//!
//! Every uncertain value of the plant is moved by its standard deviation, every effect of the catalogue by its typical
//! size, and twin flights say what the sensors make of it. So a hidden effect's dose can be told beyond what the plant's
//! tolerances could do by themselves, and whether another effect of the catalogue could do the same.

use super::twins::{Baseline, Difference, Twins};
use fss_plant::{Effect, Plant, effects};
use miette::Result;
use rayon::prelude::*;

/// Uncertain values are let off by as many standard deviations.
const TOLERANCE: f64 = 2.0;
/// An effect of which another explains this share is not separable: a cosine of 0.9.
const EXPLAINED: f64 = 0.81;
/// Sweeps of the coordinate descent.
const SWEEPS: usize = 60;

/// The responses of the sensors, at the plant as its file says.
pub struct Survey {
    /// To each uncertain value.
    values: Vec<Vec<f64>>,
    /// Products of these.
    gram: Vec<Vec<f64>>,
    /// To each effect: directions that its parameters span.
    effects: Vec<(Effect, Vec<Vec<f64>>)>,
}

/// What a survey says of a hidden effect.
pub struct Surveyed {
    /// The dose beyond what tolerances could do.
    pub dose: f64,
    /// Whether no other effect could do the same.
    pub is_separable: bool,
}

impl Survey {
    /// Flies all twins; this takes about a minute. `say` hears each that is done.
    ///
    /// # Errors
    /// Where the plant is no mechanism.
    pub fn new(plant: &Plant, twins: &Twins, say: &(dyn Fn() + Sync)) -> Result<Self> {
        let baseline = twins.baseline(plant)?;
        let response = |laboratory: &Plant| {
            let difference = twins.difference(laboratory, &baseline).map(|difference| difference.samples());
            say();
            difference
        };
        let values: Vec<Vec<f64>> = moved(plant).par_iter().map(response).collect::<Result<_>>()?;
        let gram = values.iter().map(|a| values.iter().map(|b| dot(a, b)).collect()).collect();
        let columns = |effect: &Effect| {
            let responses = steps(effect).into_iter().map(|step| response(&plant.with_effects(&[step])));
            Ok((effect.clone(), orthonormal(responses.collect::<Result<_>>()?)))
        };
        let effects = effects::candidates(plant).par_iter().map(columns).collect::<Result<_>>()?;
        Ok(Self { values, gram, effects })
    }

    /// How many twins a survey of this plant flies.
    pub fn size(plant: &Plant) -> usize {
        moved(plant).len() + effects::candidates(plant).iter().map(|effect| steps(effect).len()).sum::<usize>()
    }

    /// What there is to be said of `effect` in the laboratory whose baseline is given.
    ///
    /// # Errors
    /// Where the effect makes no mechanism.
    pub fn of(&self, effect: &Effect, room: &Plant, twins: &Twins, baseline: &Baseline) -> Result<Surveyed> {
        let difference: Difference = twins.difference(&room.with_effects(std::slice::from_ref(effect)), baseline)?;
        let mut left = difference.samples();
        self.take_off_tolerances(&mut left);
        let whole = dot(&left, &left).max(1e-12);
        let is_same = |other: &Effect| {
            other.id() == effect.id() && other.index() == effect.index() && other.channel() == effect.channel()
        };
        let others = self.effects.iter().filter(|(other, _)| !is_same(other));
        let share = |basis: &[Vec<f64>]| basis.iter().map(|b| dot(b, &left).powi(2)).sum::<f64>() / whole;
        let best = others.map(|(_, basis)| share(basis)).fold(0.0, f64::max);
        Ok(Surveyed { dose: difference.dose_of(&left), is_separable: best < EXPLAINED })
    }

    /// Takes off what the uncertain values could do within their tolerance: least squares in a box, by coordinates.
    fn take_off_tolerances(&self, samples: &mut [f64]) {
        let products: Vec<f64> = self.values.iter().map(|value| dot(value, samples)).collect();
        let mut moved = vec![0.0; self.values.len()];
        for _ in 0..SWEEPS {
            for i in 0..moved.len() {
                let others: f64 =
                    self.gram[i].iter().zip(&moved).map(|(g, m)| g * m).sum::<f64>() - self.gram[i][i] * moved[i];
                moved[i] = ((products[i] - others) / self.gram[i][i].max(1e-12)).clamp(-TOLERANCE, TOLERANCE);
            }
        }
        for (value, by) in self.values.iter().zip(&moved) {
            samples.iter_mut().zip(value).for_each(|(sample, v)| *sample -= by * v);
        }
    }
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

/// The plant with each of its uncertain values in turn off by one standard deviation.
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

/// The effect with each of its parameters in turn moved by its typical size; one that only shapes an effect, of typical
/// size, beside it.
fn steps(nominal: &Effect) -> Vec<Effect> {
    let parameters = nominal.about().parameters;
    if nominal.id() == "valve_swap" {
        return vec![nominal.clone()];
    }
    if nominal.id() == "joint_flexibility" {
        return vec![nominal.clone().with(&[500.0])];
    }
    let is_shape = |i: usize| super::score::is_shape(parameters[i].name);
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
