//! Causes that these data cannot tell apart at all: what one does, the other does with another size.

use crate::problem::{Linearized, Present, Problem, difference};
use fss_estimation::Columns;
use fss_multibody::ModelError;
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
    /// Candidates that can do what a cause of the model does, each at the coordinates at which it does.
    pub(crate) fn acting_alike(
        &self,
        linearized: &Linearized,
        hyper: &[f64],
        model: &[Present],
        present: &Present,
    ) -> Result<Vec<(usize, Vec<f64>)>, ModelError> {
        let own = present.candidate;
        let base: Vec<usize> = self.parameters_of(own).collect();
        let Some(products) = self.products(linearized, &[hyper.to_vec()], &base).pop() else {
            return Ok(Vec::new());
        };
        let rest: Vec<Present> = model.iter().filter(|p| p.candidate != own).cloned().collect();
        let (without, with) = (self.predictions(&rest)?, self.predictions(model)?);
        let action = |of: &Predictions| -> Predictions {
            of.iter().zip(&without).map(|(with, without)| difference(with, without, 1.0)).collect()
        };
        let mine = action(&with);
        let mut out = Vec::new();
        let others = (0..self.candidates.len()).filter(|c| *c != own && !self.candidates[*c].is_law);
        for other in others.filter(|c| self.candidates[*c].size == base.len()) {
            let first = self.parameters_of(other).start;
            let sized = |i: usize| {
                let (cross, a, b) = (
                    products.with_base[(i + 1, first + i + 1)],
                    products.with_base[(i + 1, base[i] + 1)],
                    products.own[other][(i, i)],
                );
                (cross.abs() > ALIKE * (a * b).sqrt()).then(|| present.coordinates[i] * cross / b)
            };
            let Some(mut coordinates) = (0..base.len()).map(sized).collect::<Option<Vec<f64>>>() else { continue };
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
    fn whitened_products(&self, hyper: &[f64], first: &Predictions, second: &Predictions) -> [f64; 3] {
        let of_member = |((member, a), b): ((&crate::problem::Member, &Vec<f64>), &Vec<f64>)| {
            let mut white = Columns::of(&[a, b]);
            member.block.whiten(self.hyper_of(member, hyper), &mut white);
            let row = |k: usize| [white.row(k)[0], white.row(k)[1]];
            (0..white.rows()).map(row).fold([0.0; 3], |s, [a, b]| [s[0] + a * a, s[1] + a * b, s[2] + b * b])
        };
        let each = self.members.par_iter().zip(first).zip(second).map(of_member);
        each.reduce(|| [0.0; 3], |a, b| std::array::from_fn(|i| a[i] + b[i]))
    }
}
