//! Causes that these data cannot tell apart at all: what one does, or some do together, another does with another size.

use crate::problem::{Column, Linearized, Member, Present, Problem, difference};
use fss_estimation::Columns;
use fss_multibody::ModelError;
use nalgebra::{Cholesky, DVector};
use rayon::prelude::*;

/// Actions whose cosine, whitened, is beyond this are one and the same.
const IDENTICAL: f64 = 0.999;
/// Where the cosine of two columns, which are of other sizes, is below this, their actions are not compared.
const ALIKE: f64 = 0.5;
/// Steps in which the size of a cause is sought that acts as another does.
const SIZING_STEPS: usize = 4;

/// A prediction of every block.
type Predictions = Vec<Vec<f64>>;

impl Problem {
    /// Candidates that can do what these causes of the model do together, each at the coordinates at which it does: of as many
    /// coordinates as one cause, of fewer than several.
    pub(crate) fn acting_alike(
        &self,
        linearized: &Linearized,
        hyper: &[f64],
        model: &[Present],
        causes: &[usize],
    ) -> Result<Vec<(usize, Vec<f64>)>, ModelError> {
        let is_meant = |p: &&Present| causes.contains(&p.candidate);
        let (base, sizes): (Vec<usize>, Vec<f64>) = model
            .iter()
            .filter(is_meant)
            .flat_map(|p| self.parameters_of(p.candidate).zip(p.coordinates.iter().copied()))
            .unzip();
        let Some(products) = self.products(linearized, &[hyper.to_vec()], &base).pop() else {
            return Ok(Vec::new());
        };
        let rest: Vec<Present> = model.iter().filter(|p| !is_meant(p)).cloned().collect();
        let (without, with) = (self.predictions(&rest)?, self.predictions(model)?);
        let action = |of: &Predictions| -> Vec<Column> {
            of.iter().zip(&without).map(|(with, without)| difference(with, without, 1.0)).collect()
        };
        let mine = action(&with);
        // Products of their linearized action with every column.
        let sizes = DVector::from_vec(sizes);
        let with_all = products.with_base.rows(1, base.len()).tr_mul(&sizes);
        let square: f64 = base.iter().zip(&sizes).map(|(p, size)| size * with_all[p + 1]).sum();
        let is_as_simple = |size: usize| if causes.len() == 1 { size == base.len() } else { size < base.len() };
        let mut out = Vec::new();
        let others = (0..self.candidates.len()).filter(|c| !causes.contains(c) && !self.candidates[*c].is_law);
        for other in others.filter(|c| is_as_simple(self.candidates[*c].size)) {
            let own = self.parameters_of(other);
            let cross = with_all.rows(own.start + 1, own.len()).into_owned();
            let Some(sized) = Cholesky::new(products.own[other].clone()).map(|c| c.solve(&cross)) else { continue };
            if cross.dot(&sized) < ALIKE * ALIKE * square {
                continue;
            }
            let mut coordinates = sized.as_slice().to_vec();
            // Actions are not in proportion to sizes: the size that fits best is found in a few steps.
            for _ in 0..SIZING_STEPS {
                let mut replaced = rest.clone();
                replaced.push(Present { candidate: other, coordinates: coordinates.clone() });
                let [a, cross, b] = self.whitened_products(hyper, &mine, &action(&self.predictions(&replaced)?));
                if cross.abs() > IDENTICAL * (a * b).sqrt() {
                    out.push((other, coordinates));
                    break;
                }
                coordinates = coordinates.iter().map(|c| if b > 0.0 { c * cross / b } else { 0.0 }).collect();
            }
        }
        Ok(out)
    }

    fn predictions(&self, model: &[Present]) -> Result<Predictions, ModelError> {
        let effects = self.effects(model);
        self.members.par_iter().map(|m| m.block.predict(&self.plant, &effects)).collect()
    }

    /// Scalar products of two actions, whitened: of the first with itself, of both, of the second with itself.
    fn whitened_products(&self, hyper: &[f64], first: &[Column], second: &[Column]) -> [f64; 3] {
        let of_member = |((member, a), b): ((&Member, &Column), &Column)| {
            let mut white = Columns::of(&[a, b]);
            member.block.whiten(self.hyper_of(member, hyper), &mut white);
            let row = |k: usize| [white.row(k)[0], white.row(k)[1]];
            (0..white.rows()).map(row).fold([0.0; 3], |s, [a, b]| [s[0] + a * a, s[1] + a * b, s[2] + b * b])
        };
        let each = self.members.par_iter().zip(first).zip(second).map(of_member);
        each.reduce(|| [0.0; 3], |a, b| std::array::from_fn(|i| a[i] + b[i]))
    }
}
