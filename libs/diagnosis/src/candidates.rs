//! The causes that a plant can have, each with the coordinates in which a prediction is linear and their priors.

mod laws;

use crate::servo_response::elasticity;
use fss_plant::effects::catalogue;
use fss_plant::{Effect, EffectKind, Index, Physics, Place, Plant, Prior, Response, SLAB_WIDTHS, effects};
use laws::{base_laws, laws_by_angle, laws_by_rate};

/// Standard deviation of a discrete cause's coordinate about 1.
pub(crate) const DISCRETE_SD: f64 = 0.01;

/// A possible cause.
#[derive(Clone, Debug)]
pub(crate) struct Candidate {
    /// The effect at its nominal values.
    pub(crate) nominal: Effect,
    /// The kind that it is one of, for the prior: each kind is as likely as any other.
    pub(crate) kind: String,
    pub(crate) prior: Prior,
    /// Value of the shape, of [`Response::Shape`] and [`Response::Scale`]; of [`Response::Onset`] when it begins, s; of a spring, or a
    /// shift in time, the size of its coordinate that its columns are taken at.
    shape: f64,
    /// What lies between its shape and those of its neighbours where it may be anywhere between: of a law in time Hz, of a scale the
    /// logarithm of their ratio, of an onset s.
    spacing: Option<f64>,
    /// Number of coordinates.
    pub(crate) size: usize,
    /// Whether it is a law that no known effect is.
    pub(crate) is_law: bool,
}

impl Candidate {
    /// Bounds of a coordinate.
    pub(crate) fn bounds(&self, coordinate: usize) -> [f64; 2] {
        let parameter = &self.nominal.about().parameters[coordinate.min(self.nominal.values().len() - 1)];
        let nominal = self.nominal.values()[coordinate.min(self.nominal.values().len() - 1)];
        match self.prior.response {
            _ if self.is_law => [f64::NEG_INFINITY, f64::INFINITY],
            Response::Linear => [parameter.lower - nominal, parameter.upper - nominal],
            Response::Strength | Response::Shape(_) | Response::Scale(_) | Response::Onset if coordinate == 0 => {
                [parameter.lower - nominal, parameter.upper - nominal]
            }
            Response::Inverse => [0.0, f64::INFINITY],
            _ => [f64::NEG_INFINITY, f64::INFINITY],
        }
    }

    /// Special values of the first coordinate.
    pub(crate) fn points(&self) -> Vec<f64> {
        self.prior.points.iter().map(|value| value - self.nominal.values()[0]).collect()
    }

    /// In how many ways it may depart from nominal: each width of the slabs, with all parts or one alone, and each special value.
    pub(crate) fn classes(&self) -> usize {
        if self.prior.response == Response::Discrete { 1 } else { self.slabs() + self.prior.points.len() }
    }

    /// Of a shift in time: the standard deviation of the one slab that it has.
    fn slab(&self) -> Option<f64> {
        (self.prior.response == Response::Linear && self.shape > 0.0 && !self.is_law).then_some(self.shape)
    }

    fn slabs(&self) -> usize {
        if self.slab().is_some() {
            return 1;
        }
        let has_parts = self.prior.response == Response::Linear && self.size > 1 && !self.is_law;
        let parts = if has_parts { 1 + self.prior.part(self.size - 1) } else { 1 };
        SLAB_WIDTHS.len() * if parts > 1 { 1 + parts } else { 1 }
    }

    /// Mean and standard deviation of a coordinate in a class, before any data.
    pub(crate) fn prior_in(&self, class: usize, coordinate: usize) -> (f64, f64) {
        if self.prior.response == Response::Discrete {
            return (1.0, DISCRETE_SD);
        }
        if class >= self.slabs() {
            return (self.points()[class - self.slabs()], self.prior.spike[coordinate]);
        }
        if let Some(sd) = self.slab() {
            return (0.0, sd);
        }
        let (width, alone) = (SLAB_WIDTHS[class % SLAB_WIDTHS.len()], class / SLAB_WIDTHS.len());
        let departs = alone == 0 || alone == self.prior.part(coordinate) + 1;
        (0.0, if departs { width * self.prior.typical[coordinate] } else { self.prior.spike[coordinate] })
    }

    /// A size of a coordinate at which its action is seen and not yet far from proportional, that of its narrowest slab, on the
    /// side that its bounds allow.
    pub(crate) fn probe(&self, coordinate: usize) -> f64 {
        if self.prior.response == Response::Inverse {
            return self.shape;
        }
        let typical = self.slab().unwrap_or(SLAB_WIDTHS[0] * self.prior.typical[coordinate]);
        if self.bounds(coordinate)[1] < typical { -typical } else { typical }
    }

    /// Whether it is a law of a joint, which shows in the joints' channels alone.
    pub(crate) fn is_law_of_joint(&self) -> bool {
        self.is_law && self.nominal.channel().is_some_and(|channel| channel.starts_with("joint_"))
    }

    /// Whether links move on their drives otherwise with it.
    pub(crate) fn is_elastic(&self, plant: &Plant) -> bool {
        let with = |effects: &[Effect]| elasticity(&Physics::with(plant, effects));
        let probed: Vec<f64> = (0..self.size).map(|i| self.probe(i)).collect();
        with(&self.at(&probed)) != with(&[])
    }

    /// The effects at these coordinates; none where all are 0.
    pub(crate) fn at(&self, c: &[f64]) -> Vec<Effect> {
        if c.iter().all(|c| *c == 0.0) {
            return Vec::new();
        }
        if self.is_law {
            return self.law(c);
        }
        let nominal = self.nominal.values();
        let mut values = nominal.to_vec();
        match self.prior.response {
            Response::Linear => values.iter_mut().zip(c).for_each(|(v, c)| *v += c),
            Response::Strength => {
                values[0] = nominal[0] + c[0];
                (1..c.len()).for_each(|i| values[i] = if c[0] == 0.0 { 0.0 } else { c[i] / c[0] });
            }
            Response::Shape(_) => {
                values[0] = nominal[0] + c[0];
                values[1] = self.shape;
            }
            Response::Scale(_) => {
                values[0] = nominal[0] + c[0];
                values[1] = c.get(1).copied().unwrap_or(self.shape.ln()).exp();
            }
            Response::Onset => values[0] = nominal[0] + c[0],
            Response::Inverse => values[0] = 1.0 / (c[0] + 1.0 / nominal[0]).max(1e-9),
            Response::Discrete => {}
        }
        for (value, parameter) in values.iter_mut().zip(self.nominal.about().parameters) {
            *value = value.clamp(parameter.lower, parameter.upper);
        }
        let effect = self.nominal.clone().with(&values);
        let begins_s = c.get(1).copied().unwrap_or(self.shape);
        vec![if self.begins_late() { effect.from_onset(begins_s) } else { effect }]
    }

    /// Whether it begins in the course of a run.
    pub(crate) fn begins_late(&self) -> bool {
        self.prior.response == Response::Onset && self.shape > 0.0
    }

    /// A law's coordinates are its strength, or the strengths of its cosine and sine, of a force along x, then y. Behind them its
    /// frequency may stand, where that is not the candidate's own.
    fn law(&self, c: &[f64]) -> Vec<Effect> {
        let (strengths, frequency) = c.split_at(self.size);
        if self.size == 1 {
            return vec![self.nominal.clone().with(strengths)];
        }
        let frequency = frequency.first().copied().unwrap_or(self.shape);
        let part = |along: f64, c: &[f64]| {
            let strength = c[0].hypot(c[1]);
            (strength > 0.0).then(|| self.nominal.clone().with(&[strength, frequency, along, c[0].atan2(c[1])]))
        };
        let along = [0.0, std::f64::consts::FRAC_PI_2];
        strengths.chunks(2).zip(along).filter_map(|(c, along)| part(along, c)).collect()
    }

    /// Between which the likeliest shape is sought, those of its neighbours: frequencies of a law in time, logarithms of a scale, onsets.
    pub(crate) fn shapes(&self) -> Option<[f64; 2]> {
        let is_scale = matches!(self.prior.response, Response::Scale(_));
        let own = if is_scale { self.shape.ln() } else { self.shape };
        self.spacing.map(|spacing| [own - spacing, own + spacing])
    }
}

/// What the runs are that causes are sought in.
pub(crate) struct Records {
    /// The longest run's length, s.
    pub(crate) duration_s: f64,
    /// Least and largest rate of each joint, rad/s.
    pub(crate) rates_rad_s: Vec<[f64; 2]>,
    /// Range of each joint's angle, rad.
    pub(crate) ranges_rad: Vec<f64>,
    /// Whether datagrams command joints, so that links swing on elastic drives.
    pub(crate) swing: bool,
}

/// Every cause that the plant can have, laws among them.
pub(crate) fn candidates(plant: &Plant, records: &Records) -> Vec<Candidate> {
    let of = |effect: &Effect, suffix: &str| of(effect, plant, suffix, records);
    let mut all: Vec<Candidate> = effects::candidates(plant).iter().flat_map(|effect| of(effect, "")).collect();
    // What all thrusters or all links share lies upstream of them.
    let shared = |kind: &&&dyn EffectKind| {
        kind.about().index == Index::Thruster && kind.prior(plant, None).response == Response::Linear
    };
    for kind in catalogue().iter().filter(shared).filter(|_| !plant.thrusters.is_empty()) {
        all.extend(of(&Effect::of(*kind).nominal(plant), " of all"));
    }
    all.extend(if plant.base.clamped {
        laws_by_rate(plant, &records.rates_rad_s)
    } else {
        base_laws(plant, records.duration_s)
    });
    // Where gravity acts in the plane, masses other than stated make torques by angle, too.
    if plant.table.gravity_m_s2 == [0.0; 2] {
        all.extend(laws_by_angle(plant, &records.ranges_rad));
    }
    // What a clamped base lacks has no typical size.
    let has_size =
        |c: &Candidate| c.prior.response == Response::Discrete || c.prior.typical[..c.size].iter().all(|t| *t > 0.0);
    all.retain(has_size);
    all
}

/// What swings on a spring tells its frequency: stiffnesses are tried over the widths of the prior, in octaves.
const OCTAVES: std::ops::RangeInclusive<i32> = -4..=2;

/// Times in a run at which what may begin in its course is tried.
const ONSETS: usize = 19;

fn of(effect: &Effect, plant: &Plant, suffix: &str, records: &Records) -> Vec<Candidate> {
    let prior = effect.kind().prior(plant, effect.index().map(|i| i - 1));
    let kind = format!("{}{suffix}", effect.id());
    let one = |size: usize, shape: f64| Candidate {
        nominal: effect.clone(),
        kind: kind.clone(),
        prior,
        shape,
        spacing: None,
        size,
        is_law: false,
    };
    match prior.response {
        // What a shift in time does is in proportion to it only while the motion is even: each slab is a candidate of its own, with the
        // column at its width.
        Response::Linear if effect.about().place == Place::Time && effect.values().len() == 1 => {
            SLAB_WIDTHS.iter().map(|width| one(1, width * prior.typical[0])).collect()
        }
        Response::Linear | Response::Strength => vec![one(effect.values().len(), 0.0)],
        Response::Shape(values) => values.iter().map(|value| one(1, *value)).collect(),
        Response::Scale(values) => {
            let spacing = Some(values.windows(2).map(|v| (v[1] / v[0]).ln()).fold(0.0, f64::max));
            values.iter().map(|value| Candidate { spacing, ..one(1, *value) }).collect()
        }
        Response::Onset => {
            let between_s = records.duration_s / (ONSETS + 1) as f64;
            let later = (1..=ONSETS).map(|k| Candidate { spacing: Some(between_s), ..one(1, k as f64 * between_s) });
            std::iter::once(one(1, 0.0)).chain(later).collect()
        }
        Response::Inverse if records.swing => {
            OCTAVES.map(|octave| one(1, prior.typical[0] * 2.0_f64.powi(octave))).collect()
        }
        Response::Inverse => vec![one(1, SLAB_WIDTHS[0] * prior.typical[0])],
        Response::Discrete => vec![one(1, 0.0)],
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_scale_is_anywhere_between_those_that_are_tried() {
        let plant = Plant::default_laboratory().unwrap();
        let records = Records { duration_s: 40.0, rates_rad_s: Vec::new(), ranges_rad: Vec::new(), swing: false };
        let all = candidates(&plant, &records);
        let mut tried: Vec<[f64; 2]> = all
            .iter()
            .filter(|c| c.kind == "joint_stribeck_friction" && c.nominal.index() == Some(2))
            .map(|c| c.shapes().unwrap())
            .collect();
        tried.sort_by(|a, b| a[0].total_cmp(&b[0]));
        assert!(tried.len() > 1 && tried.windows(2).all(|two| two[0][1] > two[1][0]), "{tried:?}");
        let sticks = all.iter().find(|c| c.kind == "joint_stribeck_friction").unwrap();
        let at = |c: &[f64]| sticks.at(c)[0].values().to_vec();
        assert!((at(&[0.2, 0.05_f64.ln()])[1] - 0.05).abs() < 1e-12, "{:?}", at(&[0.2, 0.05_f64.ln()]));
        assert_eq!(at(&[0.2])[0], 0.2);
    }

    #[test]
    fn a_cause_departs_from_nominal_with_all_its_coordinates_or_with_one() {
        let plant = Plant::default_laboratory().unwrap();
        let records = Records { duration_s: 40.0, rates_rad_s: Vec::new(), ranges_rad: Vec::new(), swing: false };
        let all = candidates(&plant, &records);
        let rubs = all.iter().find(|c| c.kind == "base_coulomb_drag").unwrap();
        let is_slab = |class: usize, i: usize| rubs.prior_in(class, i).1 > 100.0 * rubs.prior.spike[i];
        let departs: Vec<[bool; 2]> = (0..rubs.classes()).map(|class| [0, 1].map(|i| is_slab(class, i))).collect();
        for support in [[true, true], [true, false], [false, true]] {
            assert_eq!(departs.iter().filter(|d| **d == support).count(), SLAB_WIDTHS.len(), "{departs:?}");
        }
    }

    #[test]
    fn the_components_of_a_vector_depart_together() {
        let plant = Plant::default_laboratory().unwrap();
        let records = Records { duration_s: 40.0, rates_rad_s: Vec::new(), ranges_rad: Vec::new(), swing: false };
        let all = candidates(&plant, &records);
        let supports = |kind: &str| -> Vec<Vec<bool>> {
            let own = all.iter().find(|c| c.kind == kind).unwrap();
            let is_slab = |class: usize, i: usize| own.prior_in(class, i).1 > own.prior.spike[i];
            let of_class = |class: usize| (0..own.size).map(|i| is_slab(class, i)).collect();
            (0..own.classes()).step_by(SLAB_WIDTHS.len()).map(of_class).collect()
        };
        for kind in ["table_tilt", "base_com", "marker_offset"] {
            assert_eq!(supports(kind), [[true, true]], "{kind}");
        }
        assert_eq!(supports("body_force"), [[true, true, true], [true, true, false], [false, false, true]]);
    }
}
