//! Columns of causes and uncertain values: differences of predictions about a model.

use crate::block::Block;
use crate::candidates::Candidate;
use crate::problem::{Column, Linearized, Member, Present, Problem, SetValue, Slope, difference, is_same};
use fss_multibody::ModelError;
use fss_plant::{Effect, Plant, Response};
use rayon::prelude::*;

/// Share of its typical size above which a coordinate's secant through zero is taken, not a probe.
const SECANT_ABOVE: f64 = 0.05;
/// Step of a tangent over the probe's size.
const TANGENT_STEP: f64 = 0.4;
/// The same of a spring's coordinate over its size: a swing's frequency stays almost what it is.
const SPRING_STEP: f64 = 0.05;
/// Step of a contact's slope to either side, over its size.
const NEAR_STEP: f64 = 0.05;

impl Problem {
    /// Linearizes every block about a model and hyper-parameters. Candidates that are not `wanted` in a block keep the columns that are
    /// `known` of them, or get none; so do uncertain values, or get theirs.
    pub(crate) fn linearized(
        &self,
        (model, hyper): (&[Present], &[f64]),
        slope: Slope,
        wanted: &(dyn Fn(usize, &Member) -> bool + Sync),
        known: Linearized,
    ) -> Result<Linearized, ModelError> {
        let mut known = known.columns;
        known.resize_with(self.members.len(), || vec![Vec::new(); 1 + self.parameters()]);
        let columns = self.members.par_iter().zip(known);
        let columns = columns.map(|(m, known)| {
            let wanted: Vec<bool> = (0..self.candidates.len()).map(|c| wanted(c, m)).collect();
            m.block.forget(self.hyper_of(m, hyper));
            self.columns(m.block.as_ref(), (model, slope), &wanted, known)
        });
        let mut size = vec![0.0; self.parameters()];
        let continuous = |p: &&Present| self.candidates[p.candidate].prior.response != Response::Discrete;
        for present in model.iter().filter(continuous) {
            let own = self.parameters_of(present.candidate).zip(&present.coordinates);
            own.for_each(|(p, value)| size[p] = value.abs());
        }
        Ok(Linearized { columns: columns.collect::<Result<_, _>>()?, size })
    }

    /// The causes of a model that have a shape, by their place in it, and between which the likeliest is.
    pub(crate) fn shapes_of(&self, model: &[Present]) -> Vec<(usize, [f64; 2])> {
        let shapes = |present: &Present| {
            let own = &self.candidates[present.candidate];
            own.shapes().filter(|_| present.coordinates.len() > own.size)
        };
        model.iter().enumerate().filter_map(|(at, present)| Some((at, shapes(present)?))).collect()
    }

    /// Adds to what is linearized about a model a parameter that nothing else has: the departure of the shape of its cause `at`, in proportion,
    /// from differences by `step` to either side.
    pub(crate) fn add_shape(
        &self,
        linearized: &mut Linearized,
        model: &[Present],
        (at, step): (usize, f64),
    ) -> Result<(), ModelError> {
        let moved = |by: f64| {
            let mut moved = model.to_vec();
            let shape = moved[at].coordinates.len() - 1;
            moved[at].coordinates[shape] += by;
            self.effects(&moved)
        };
        let (upper, lower) = (moved(step), moved(-step));
        let of_member = |m: &Member| {
            let predict = |effects: &[Effect]| m.block.predict(&self.plant, effects);
            Ok(difference(&predict(&upper)?, &predict(&lower)?, 2.0 * step))
        };
        let all: Vec<Column> = self.members.par_iter().map(of_member).collect::<Result<_, ModelError>>()?;
        linearized.columns.iter_mut().zip(all).for_each(|(columns, own)| columns.push(own));
        linearized.size.push(0.0);
        Ok(())
    }

    fn columns(
        &self,
        block: &dyn Block,
        (model, slope): (&[Present], Slope),
        wanted: &[bool],
        mut columns: Vec<Column>,
    ) -> Result<Vec<Column>, ModelError> {
        let plant = &self.plant;
        let base = block.predict(plant, &self.effects(model))?;
        let mut data: Vec<f64> = block.measured().iter().zip(&base).map(|(y, p)| y - p).collect();
        for (i, (value, at)) in self.uncertain.iter().zip(self.uncertain_parameters()).enumerate() {
            if columns[1 + at].is_empty() {
                let moved = value.moved(plant, 1.0);
                let there = block.predict(&moved, &self.effects_of(&moved, model))?;
                columns[1 + at] = difference(&there, &base, 1.0);
            }
            let now = self.tuning.by(i);
            if now != 0.0 {
                add(&mut data, now, &columns[1 + at]);
            }
        }
        for candidate in 0..self.candidates.len() {
            if !wanted[candidate] {
                continue;
            }
            let present = model.iter().find(|p| p.candidate == candidate);
            let own = match self.as_uncertain(candidate, model, &columns) {
                Some(own) => own,
                None => self.candidate_columns(block, (plant, model), slope, candidate, &base)?,
            };
            for (i, column) in own.into_iter().enumerate() {
                let theta = present.map_or(0.0, |p| p.coordinates[i]);
                if theta != 0.0 {
                    add(&mut data, theta, &column);
                }
                columns[1 + self.first[candidate] + i] = column;
            }
        }
        columns[0] = data.iter().map(|v| *v as f32).collect();
        Ok(columns)
    }

    /// The columns of a candidate all of whose coordinates set uncertain values: these values' own. What one direction does is linearized
    /// once, or the difference of two would tell a cause from what is uncertain.
    fn as_uncertain(&self, candidate: usize, model: &[Present], columns: &[Column]) -> Option<Vec<Column>> {
        let own = &self.candidates[candidate].nominal;
        if model.iter().any(|p| is_same(&self.candidates[p.candidate].nominal, own)) {
            return None;
        }
        let column = |p: usize| {
            let SetValue { uncertain, deviation } = self.sets[p]?;
            let own = &columns[1 + self.uncertain_parameters().start + uncertain];
            Some(own.iter().map(|v| v / deviation as f32).collect())
        };
        self.parameters_of(candidate).map(column).collect()
    }

    /// A column for each coordinate of a candidate: secants through zero where the model has it, probes where not, and of a contact
    /// slopes about its size.
    fn candidate_columns(
        &self,
        block: &dyn Block,
        (plant, model): (&Plant, &[Present]),
        slope: Slope,
        candidate: usize,
        base: &[f64],
    ) -> Result<Vec<Column>, ModelError> {
        let own = &self.candidates[candidate];
        let zero = vec![0.0; own.size];
        let now = model.iter().find(|p| p.candidate == candidate).map_or(&zero, |p| &p.coordinates);
        // The same effect with another shape makes way.
        let makes_way = |p: &Present| {
            let other = &self.candidates[p.candidate];
            let is_discrete = own.prior.response == Response::Discrete;
            p.candidate != candidate && !is_discrete && is_same(&other.nominal, &own.nominal)
        };
        let others: Vec<Present> =
            model.iter().filter(|p| p.candidate != candidate && !makes_way(p)).cloned().collect();
        let predict = |coordinates: &[f64]| {
            let mut other = others.clone();
            other.push(Present { candidate, coordinates: coordinates.to_vec() });
            block.predict(plant, &self.effects(&other))
        };
        let without = if model.iter().any(makes_way) { Some(predict(&zero)?) } else { None };
        let base = without.as_deref().unwrap_or(base);
        if own.prior.response == Response::Discrete {
            let there = predict(&[1.0])?;
            let absent = if now[0] == 0.0 { None } else { Some(predict(&zero)?) };
            return Ok(vec![
                absent.map_or_else(|| difference(&there, base, 1.0), |absent| difference(base, &absent, 1.0)),
            ]);
        }
        if own.prior.is_contact && *now != zero {
            return near_slopes(own, now, &predict);
        }
        if slope == Slope::Tangent && own.prior.response != Response::Strength {
            let is_spring = own.prior.response == Response::Inverse;
            let step = |i: usize| if is_spring { SPRING_STEP * now[i] } else { TANGENT_STEP * own.probe(i) };
            let tangent = |i: usize| Ok(difference(&predict(&moved(now, i, now[i] + step(i)))?, base, step(i)));
            return (0..own.size).map(tangent).collect();
        }
        secants(own, now, base, &predict)
    }
}

fn add(to: &mut [f64], by: f64, column: &Column) {
    to.iter_mut().zip(column).for_each(|(to, value)| *to += by * f64::from(*value));
}

/// What a candidate's coordinates make a block read.
type Predict<'a> = dyn Fn(&[f64]) -> Result<Vec<f64>, ModelError> + 'a;

fn moved(from: &[f64], i: usize, to: f64) -> Vec<f64> {
    let mut coordinates = from.to_vec();
    coordinates[i] = to;
    coordinates
}

/// Slopes of a contact about its size, within its bounds: through its absence they would be another motion's.
fn near_slopes(own: &Candidate, now: &[f64], predict: &Predict) -> Result<Vec<Column>, ModelError> {
    let slope = |i: usize| {
        let step = NEAR_STEP * if now[i] == 0.0 { own.probe(i) } else { now[i] };
        let [lower, upper] = [-step, step].map(|by| (now[i] + by).max(own.bounds(i)[0]));
        Ok(difference(&predict(&moved(now, i, upper))?, &predict(&moved(now, i, lower))?, upper - lower))
    };
    (0..own.size).map(slope).collect()
}

/// Secants through zero of the coordinates that a candidate has, and what the others do in the small.
fn secants(own: &Candidate, now: &[f64], base: &[f64], predict: &Predict) -> Result<Vec<Column>, ModelError> {
    let zero = vec![0.0; own.size];
    let is_strength = own.prior.response == Response::Strength && !own.is_law;
    let strength = if now[0] == 0.0 { own.probe(0) } else { now[0] };
    let mut columns = Vec::with_capacity(own.size);
    // Of a strength with places: the strength alone, at the places 0.
    let alone = if is_strength { Some(predict(&moved(&zero, 0, strength))?) } else { None };
    for i in 0..own.size {
        let significant = now[i].abs() > SECANT_ABOVE * own.prior.typical[i];
        columns.push(match &alone {
            Some(alone) if i == 0 => difference(alone, &predict(&zero)?, strength),
            _ if significant => difference(base, &predict(&moved(now, i, 0.0))?, now[i]),
            Some(alone) => difference(&predict(&moved(&moved(&zero, 0, strength), i, strength))?, alone, strength),
            None => difference(&predict(&moved(now, i, now[i] + own.probe(i)))?, base, own.probe(i)),
        });
    }
    Ok(columns)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::block::HyperParameter;
    use crate::tuning::Tuning;
    use fss_estimation::Columns;
    use fss_plant::Physics;

    /// Reads the square of the second joint's dry friction.
    struct Squared;

    impl Block for Squared {
        fn measured(&self) -> &[f64] {
            &[0.0]
        }

        fn predict(&self, plant: &Plant, effects: &[Effect]) -> Result<Vec<f64>, ModelError> {
            Ok(vec![Physics::with(plant, effects).joints[1].friction.coulomb_n_m.powi(2)])
        }

        fn hyper_parameters(&self) -> &[HyperParameter] {
            &[]
        }

        fn whiten(&self, _: &[f64], _: &mut Columns) -> f64 {
            0.0
        }

        fn channel_of_row(&self) -> &[usize] {
            &[0]
        }

        fn channels(&self) -> &[String] {
            &[]
        }

        fn time_of_row(&self) -> &[f64] {
            &[0.0]
        }

        fn noise_of_row(&self) -> &[f64] {
            &[1.0]
        }
    }

    #[test]
    fn an_absent_cause_and_the_uncertain_value_that_it_sets_have_one_column() {
        let mut plant = Plant::default_laboratory().unwrap();
        plant.uncertainty.get_or_insert_default().coulomb_friction_n_m = 0.01;
        let friction_n_m = plant.links[1].coulomb_friction_n_m;
        let problem = Problem::new(&plant, &[], &Tuning::default()).unwrap();
        let is_friction = |nominal: &Effect| nominal.id() == "joint_coulomb_friction" && nominal.index() == Some(2);
        let wanted: Vec<bool> = problem.candidates.iter().map(|c| is_friction(&c.nominal)).collect();
        let candidate = wanted.iter().position(|wanted| *wanted).unwrap();
        let none = vec![Vec::new(); 1 + problem.parameters()];
        let columns = problem.columns(&Squared, (&[], Slope::Secant), &wanted, none).unwrap();
        let own = f64::from(columns[1 + problem.first[candidate]][0]);
        // About the stated deviation, not about the cause's own size: f + (f + 0.01).
        assert!((own - (2.0 * friction_n_m + 0.01)).abs() < 1e-7, "{own}");
    }
}
