//! The shape of a cause: a law's frequency, the rate at which static friction fades, a late onset. Its likelihood has many maxima.

use super::estimate::{ColumnsOfSet, STANDS_STILL};
use super::space::{Found, Search};
use crate::problem::{Linearized, Present};
use fss_multibody::ModelError;

/// Steps of estimation at each shape that is tried: what a cause does need not be in proportion to its size.
const AT_SHAPE: usize = 3;

/// Where the parabola through the highest of equally spaced values and its neighbours is highest, or that value where it ends the row.
fn vertex(values: &[(f64, f64)]) -> f64 {
    let highest = (0..values.len()).max_by(|a, b| values[*a].1.total_cmp(&values[*b].1)).unwrap_or(0);
    let (Some((left, before)), Some((right, after))) =
        (highest.checked_sub(1).map(|i| values[i]), values.get(highest + 1))
    else {
        return values[highest].0;
    };
    let bend = before + after - 2.0 * values[highest].1;
    let shift = 0.25 * (right - left) * (before - after) / bend;
    values[highest].0 + if bend < 0.0 { shift } else { 0.0 }
}

impl Search<'_> {
    /// Moves a cause of the model to its likeliest shape, by parabolas through the logarithm of the marginal likelihood.
    pub(super) fn find_shape(
        &self,
        about: &Linearized,
        model: &mut [Present],
        (at, [lower, upper]): (usize, [f64; 2]),
        set: &Found,
        hyper: &[f64],
    ) -> Result<(), ModelError> {
        let Some(columns) = self.columns_of(self.problem.of_uncertain(about), set, model) else { return Ok(()) };
        let size = self.problem.candidates[model[at].candidate].size;
        let (mut middle, mut step) = (f64::midpoint(lower, upper), 0.25 * (upper - lower));
        for halves in [2, 1] {
            let mut values = Vec::new();
            for k in -halves..=halves {
                let shape = middle + f64::from(k) * step;
                values.push((shape, self.log_evidence_at_shape(&columns, (model, at), shape, set, hyper)?));
            }
            middle = vertex(&values);
            step *= 0.125;
        }
        model[at].coordinates[size] = middle;
        Ok(())
    }

    /// The logarithm of the marginal likelihood where a cause of the model has this shape, about the size that suits it, at which the
    /// model is left.
    fn log_evidence_at_shape(
        &self,
        columns: &ColumnsOfSet,
        (model, at): (&mut [Present], usize),
        shape: f64,
        set: &Found,
        hyper: &[f64],
    ) -> Result<f64, ModelError> {
        let Present { candidate, .. } = model[at];
        let size = self.problem.candidates[candidate].size;
        model[at].coordinates[size] = shape;
        let mut value = f64::NEG_INFINITY;
        for _ in 0..AT_SHAPE {
            let point = columns.point(model, hyper)?;
            let Some(posterior) = point.and_then(|point| point.posterior.of_set(&columns.slabs)) else { break };
            value = posterior.log_evidence;
            let (now, deviations) = self.presented(set, &posterior);
            let own = now.iter().zip(&deviations).find(|(present, _)| present.candidate == candidate);
            let Some((now, deviations)) = own else { break };
            let moved = model[at].coordinates.iter().zip(&now.coordinates).zip(deviations);
            let still = moved.into_iter().all(|((before, now), sd)| (before - now).abs() <= STANDS_STILL * sd);
            if still {
                break;
            }
            model[at].coordinates[..size].copy_from_slice(&now.coordinates);
        }
        Ok(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_highest_at_its_vertex_and_a_row_that_rises_at_its_end() {
        let row = |of: &dyn Fn(f64) -> f64| {
            (-2..=2).map(|k| 0.5 + 0.1 * f64::from(k)).map(|x| (x, of(x))).collect::<Vec<_>>()
        };
        assert!((vertex(&row(&|x| 3.0 - 7.0 * (x - 0.537).powi(2))) - 0.537).abs() < 1e-12);
        assert_eq!(vertex(&row(&|x| x)), 0.7);
        assert_eq!(vertex(&row(&|_| 1.0)), 0.7);
    }
}
