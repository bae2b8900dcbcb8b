//! How well a set's estimate is known.

use super::estimate::ColumnsOfSet;
use super::space::{Found, HyperPoint, Search};
use crate::problem::{Linearized, Present, Slope};
use fss_estimation::evidence::SetPosterior;
use fss_multibody::ModelError;
use nalgebra::DMatrix;

/// Step of a shape to either side of the likeliest, over what lies between its neighbours.
const SHAPE_STEP: f64 = 0.03;

/// How well a set's coordinates are known.
pub(crate) struct Estimate {
    /// Posterior of the coordinates, in the order of the set's causes.
    pub(crate) coordinates: SetPosterior,
    /// Standard deviation of each cause's shape; 0 where it has none.
    pub(crate) shapes: Vec<f64>,
}

impl Search<'_> {
    /// How well a set's estimate is known, in its tangent space: what a coordinate does need not be in proportion to it, and the secants
    /// that compare presence with absence, `in_secants`, do not tell that.
    pub(super) fn known(
        &self,
        about: &Linearized,
        (model, set): (&[Present], &Found),
        (hyper, in_secants): (&[f64], SetPosterior),
    ) -> Result<Estimate, ModelError> {
        let mut shapes = vec![0.0; set.causes.len()];
        let Some(columns) = self.columns_of(self.problem.of_uncertain(about), set, model) else {
            return Ok(Estimate { coordinates: in_secants, shapes });
        };
        let posterior = |model: &[Present], slope: Slope| -> Result<Option<SetPosterior>, ModelError> {
            Ok(columns.point(model, slope, hyper)?.and_then(|point| point.posterior.of_set(&columns.slabs)))
        };
        let tangents = columns.point(model, Slope::Tangent, hyper)?;
        let mut coordinates = tangents.and_then(|point| self.in_any_class(&point, set, &columns)).unwrap_or(in_secants);
        for (at, present) in model.iter().enumerate() {
            let own = &self.problem.candidates[present.candidate];
            let place = set.causes.iter().position(|c| *c == present.candidate);
            let (Some(place), Some([lower, upper]), true) = (place, own.shapes(), present.coordinates.len() > own.size)
            else {
                continue;
            };
            let step = SHAPE_STEP * (upper - lower);
            let beside = |by: f64| {
                let mut beside = model.to_vec();
                beside[at].coordinates[own.size] += by;
                posterior(&beside, Slope::Secant)
            };
            let (Some(before), Some(here), Some(after)) = (beside(-step)?, beside(0.0)?, beside(step)?) else {
                continue;
            };
            // Of a flat prior and a likelihood with this curvature; the coordinates move along with the shape.
            let bend = (before.log_evidence + after.log_evidence - 2.0 * here.log_evidence) / (step * step);
            let variance = (12.0 / (upper - lower).powi(2) - bend.min(0.0)).recip();
            let moves = |i: usize| (after.mean[i] - before.mean[i]) / (2.0 * step);
            let n = coordinates.mean.len();
            coordinates.covariance += DMatrix::from_fn(n, n, |i, j| moves(i) * moves(j) * variance);
            shapes[place] = variance.sqrt();
        }
        Ok(Estimate { coordinates, shapes })
    }

    /// The posterior of a set's coordinates in its classes, widened by what others of each cause's classes say: whether a bias alone departs,
    /// or a scale, too, is part of what is not known.
    fn in_any_class(&self, point: &HyperPoint, set: &Found, columns: &ColumnsOfSet) -> Option<SetPosterior> {
        let others = set.causes.iter().enumerate().flat_map(|(place, cause)| {
            let others = (0..self.classes(*cause)).filter(move |class| *class != set.classes[place]);
            others.map(move |class| (place, class))
        });
        let in_other = |(place, class): (usize, usize)| {
            let mut classes = set.classes.clone();
            classes[place] = class;
            point.posterior.of_set(&self.slabs(&set.causes, &classes, &columns.position)?)
        };
        let others: Vec<SetPosterior> = others.filter_map(in_other).collect();
        Some(point.posterior.of_set(&columns.slabs)?.among(&others))
    }
}
