//! How well a set's estimate is known.

use super::estimate::ColumnsOfSet;
use super::space::{Found, Search};
use crate::problem::{Linearized, Present};
use fss_estimation::evidence::{SetPosterior, Slab, SpikePosterior};
use fss_multibody::ModelError;

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
        let columns = self.columns_of(self.problem.of_uncertain(about), set, model);
        let known = columns.map(|columns| -> Result<Option<SetPosterior>, ModelError> {
            let tangent = columns.tangent_point(model, hyper)?;
            Ok(tangent.and_then(|(point, of_shapes)| self.in_any_class(&point, set, &columns, &of_shapes)))
        });
        let Some(mut coordinates) = known.transpose()?.flatten() else {
            return Ok(Estimate { coordinates: in_secants, shapes });
        };
        // The shapes stand behind the coordinates.
        let size = in_secants.mean.len();
        for (k, (at, _)) in self.problem.shapes_of(model).into_iter().enumerate() {
            if let Some(place) = set.causes.iter().position(|c| *c == model[at].candidate) {
                shapes[place] = coordinates.covariance[(size + k, size + k)].sqrt();
            }
        }
        coordinates.mean.truncate(size);
        coordinates.covariance = coordinates.covariance.view((0, 0), (size, size)).into_owned();
        Ok(Estimate { coordinates, shapes })
    }

    /// The posterior of a set's coordinates in its classes, widened by what others of each cause's classes say: whether a bias alone departs,
    /// or a scale, too, is part of what is not known.
    fn in_any_class(
        &self,
        point: &SpikePosterior,
        set: &Found,
        columns: &ColumnsOfSet,
        shapes: &[Slab],
    ) -> Option<SetPosterior> {
        let others = set.causes.iter().enumerate().flat_map(|(place, cause)| {
            let others = (0..self.classes(*cause)).filter(move |class| *class != set.classes[place]);
            others.map(move |class| (place, class))
        });
        let in_other = |(place, class): (usize, usize)| {
            let mut classes = set.classes.clone();
            classes[place] = class;
            point.of_set(&[self.slabs(&set.causes, &classes, &columns.position)?.as_slice(), shapes].concat())
        };
        let others: Vec<SetPosterior> = others.filter_map(in_other).collect();
        Some(point.of_set(&[columns.slabs.as_slice(), shapes].concat())?.among(&others))
    }
}
