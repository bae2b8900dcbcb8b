//! The estimate of a set of causes: where its stiffnesses are likeliest, then Gauss-Newton steps.

use super::space::{Found, HyperPoint, Search};
use crate::gram::GramCache;
use crate::problem::{Linearized, Present, Slope, is_same};
use fss_estimation::evidence::{SetPosterior, Slab, SpikePosterior};
use fss_multibody::ModelError;
use fss_plant::Response;

/// A change of a coordinate below this share of its deviation stands still.
pub(super) const STANDS_STILL: f64 = 0.5;
/// Steps of estimation about one set at the most.
const POLISHED: usize = 6;
/// Step of a shape to either side, over what lies between its neighbours.
const SHAPE_STEP: f64 = 0.03;
/// A spring's octave is scanned in so many steps to either side, each a twentieth of a swing's frequency.
const SCANNED: i32 = 4;

/// What it takes to linearize about a set of causes, and their priors.
pub(super) struct ColumnsOfSet<'a> {
    search: &'a Search<'a>,
    /// Columns of the uncertain values.
    uncertain: Linearized,
    present: Vec<usize>,
    parameters: Vec<usize>,
    pub(super) position: Vec<Option<usize>>,
    pub(super) slabs: Vec<Slab>,
}

impl ColumnsOfSet<'_> {
    /// Everything that follows from the data, about a model of these causes.
    pub(super) fn point(&self, model: &[Present], hyper: &[f64]) -> Result<Option<HyperPoint>, ModelError> {
        let problem = self.search.problem;
        let known = problem.of_uncertain(&self.uncertain);
        let linearized = problem.linearized((model, hyper), Slope::Secant, &|c, _| self.present.contains(&c), known)?;
        Ok(self.search.point(&linearized, hyper, &self.parameters, &GramCache::default()))
    }

    /// The same in the model's tangent space, in which each shape that it has is a parameter, too: its departure from the model's. Behind
    /// the set's priors stand those of the shapes, in the order of the model.
    pub(super) fn tangent_point(
        &self,
        model: &[Present],
        hyper: &[f64],
    ) -> Result<Option<(SpikePosterior, Vec<Slab>)>, ModelError> {
        let problem = self.search.problem;
        let known = problem.of_uncertain(&self.uncertain);
        let wanted = |c: usize, _: &_| self.present.contains(&c);
        let mut linearized = problem.linearized((model, hyper), Slope::Tangent, &wanted, known)?;
        let (mut parameters, mut shapes) = (self.parameters.clone(), Vec::new());
        for (at, [lower, upper]) in problem.shapes_of(model) {
            problem.add_shape(&mut linearized, model, (at, SHAPE_STEP * (upper - lower)))?;
            // As of an even distribution between the neighbours.
            let (sd, bounds) = ((upper - lower) / 12.0_f64.sqrt(), [f64::NEG_INFINITY, f64::INFINITY]);
            shapes.push(Slab { parameter: parameters.len(), mean: 0.0, sd, bounds });
            parameters.push(problem.parameters() + shapes.len() - 1);
        }
        let gram = problem.gram((&linearized, &linearized.size), hyper, &parameters, &GramCache::default());
        let mut spikes = problem.spikes_of(&linearized, &self.parameters);
        spikes.extend(shapes.iter().map(|shape| shape.sd));
        Ok(gram.and_then(|gram| SpikePosterior::new(&gram, &spikes)).map(|posterior| (posterior, shapes)))
    }

    /// The logarithm of the marginal likelihood, the first coordinate of one cause as it is in the model.
    fn log_evidence_given(&self, model: &[Present], at: usize, hyper: &[f64]) -> Result<f64, ModelError> {
        let (own, problem) = (&model[at], self.search.problem);
        let known = |s: &Slab| {
            if Some(s.parameter) != self.position[problem.first[own.candidate]] {
                return *s;
            }
            let sd = problem.candidates[own.candidate].prior.spike[0];
            Slab { mean: own.coordinates[0], sd, bounds: [f64::NEG_INFINITY, f64::INFINITY], ..*s }
        };
        let slabs: Vec<Slab> = self.slabs.iter().map(known).collect();
        let posterior = self.point(model, hyper)?.and_then(|point| point.posterior.of_set(&slabs));
        Ok(posterior.map_or(f64::NEG_INFINITY, |p| p.log_evidence))
    }
}

impl Search<'_> {
    pub(super) fn columns_of<'a>(
        &'a self,
        uncertain: Linearized,
        set: &Found,
        model: &[Present],
    ) -> Option<ColumnsOfSet<'a>> {
        let present: Vec<usize> = model.iter().map(|p| p.candidate).collect();
        let (parameters, position) = self.parameters_with(&present);
        let slabs = self.slabs(&set.causes, &set.classes, &position)?;
        Some(ColumnsOfSet { search: self, uncertain, present, parameters, position, slabs })
    }

    /// The estimate of a set, stiffnesses and shapes that the model before does not have at their likeliest: what swings on
    /// a spring tells its frequency, so that the likelihood has many maxima. `None` where a drive that does not give way is likelier
    /// than any.
    pub(super) fn scanned(
        &self,
        about: &Linearized,
        (before, mut model): (&[Present], Vec<Present>),
        set: &Found,
        hyper: &[f64],
    ) -> Result<Option<Vec<Present>>, ModelError> {
        for at in 0..model.len() {
            let own = &self.problem.candidates[model[at].candidate];
            if let Some(shapes) = own.shapes() {
                let known = before.iter().find(|p| p.candidate == model[at].candidate);
                let known = known.and_then(|p| p.coordinates.get(own.size).copied());
                model[at].coordinates.push(known.unwrap_or(f64::midpoint(shapes[0], shapes[1])));
                if known.is_none() {
                    self.find_shape(about, &mut model, (at, shapes), set, hyper)?;
                }
                continue;
            }
            if own.prior.response != Response::Inverse {
                continue;
            }
            let is_same = |p: &&Present| is_same(&self.problem.candidates[p.candidate].nominal, &own.nominal);
            if let Some(known) = before.iter().find(is_same) {
                model[at].coordinates.clone_from(&known.coordinates);
                continue;
            }
            let (problem, uncertain) = self.problem.where_seen(model[at].candidate, self.problem.of_uncertain(about));
            let search = Search::new(&problem);
            let Some(columns) = search.columns_of(uncertain, set, &model) else { return Ok(Some(model)) };
            let mut best = (f64::NEG_INFINITY, own.probe(0));
            let octave =
                (-SCANNED..=SCANNED).map(|k| own.probe(0) * 2.0_f64.powf(0.5 * f64::from(k) / f64::from(SCANNED)));
            let rigid = self.problem.swings(model[at].candidate).then_some(0.0);
            for coordinate in octave.chain(rigid) {
                model[at].coordinates[0] = coordinate;
                let value = columns.log_evidence_given(&model, at, hyper)?;
                best = if value > best.0 { (value, coordinate) } else { best };
            }
            if best.1 == 0.0 {
                return Ok(None);
            }
            model[at].coordinates[0] = best.1;
        }
        Ok(Some(model))
    }

    /// Gauss-Newton steps: the causes' coordinates at the posterior mean of the linearization about themselves, with the columns that
    /// uncertain values have `about` a model near it.
    pub(super) fn polished(
        &self,
        about: &Linearized,
        mut model: Vec<Present>,
        set: &Found,
        hyper: &[f64],
    ) -> Result<Vec<Present>, ModelError> {
        let uncertain = self.problem.of_uncertain(about);
        let Some(columns) = self.columns_of(uncertain, set, &model) else { return Ok(model) };
        let steps = if model.is_empty() { 0 } else { POLISHED };
        for _ in 0..steps {
            let Some((point, shapes)) = columns.tangent_point(&model, hyper)? else { break };
            let Some(posterior) = point.of_set(&[columns.slabs.as_slice(), &shapes].concat()) else { break };
            let (mut now, mut deviations) = self.presented(set, &posterior);
            for (k, (at, [lower, upper])) in self.problem.shapes_of(&model).into_iter().enumerate() {
                let (place, own) = (columns.slabs.len() + k, &model[at]);
                let Some(i) = now.iter().position(|p| p.candidate == own.candidate) else { continue };
                let before = own.coordinates[own.coordinates.len() - 1];
                now[i].coordinates.push((before + posterior.mean[place]).clamp(lower, upper));
                deviations[i].push(posterior.covariance[(place, place)].sqrt());
            }
            let still = Self::stands_still(&model, &now, &deviations);
            model = now;
            if still {
                break;
            }
        }
        Ok(model)
    }
}

impl Search<'_> {
    /// Logarithm of a set's marginal likelihood and prior, about its own estimate.
    pub(super) fn log_posterior(&self, (about, hyper): (&Linearized, &[f64]), set: &Found) -> f64 {
        let (parameters, position) = self.parameters_with(&set.causes);
        let point = self.point(about, hyper, &parameters, &GramCache::default());
        let slabs = self.slabs(&set.causes, &set.classes, &position);
        let value = point.zip(slabs).and_then(|(point, slabs)| point.log_posterior(&slabs));
        value.map_or(f64::NEG_INFINITY, |value| value + self.prior_of_set(&set.causes))
    }

    /// Notes which candidates act just as a cause of the model does: by what both do at its size, not by their columns, which
    /// differ where actions are not in proportion.
    pub(super) fn note_identical(
        &mut self,
        linearized: &Linearized,
        hyper: &[f64],
        model: &[Present],
    ) -> Result<(), ModelError> {
        for present in model.iter().filter(|p| !self.problem.candidates[p.candidate].is_law) {
            let own = present.candidate;
            let alike = self.problem.acting_alike(linearized, hyper, model, &[own])?;
            self.identical.extend(alike.into_iter().map(|(other, at)| ((own.min(other), own.max(other)), (other, at))));
        }
        Ok(())
    }

    /// Posterior means of the uncertain values with a set, in stated standard deviations.
    pub(super) fn values(&self, points: &[HyperPoint], set: &Found) -> Vec<f64> {
        let slabs = self.slabs(&set.causes, &set.classes, &self.position);
        let found = self.posterior(points, set).zip(slabs);
        let means = found.map(|((posterior, at), slabs)| points[at].posterior.means_given(&slabs, &posterior));
        let first = self.parameters.len() - self.problem.uncertain.len();
        means.map_or_else(|| vec![0.0; self.problem.uncertain.len()], |m| m[first..].to_vec())
    }

    /// The best set at its posterior mean, and the deviations of its coordinates.
    pub(super) fn estimate(&self, points: &[HyperPoint], set: &Found) -> (Vec<Present>, Vec<Vec<f64>>) {
        match self.posterior(points, set) {
            Some((posterior, _)) => self.presented(set, &posterior),
            None => (Vec::new(), Vec::new()),
        }
    }

    /// A set at its posterior mean, within bounds, and the deviations of its coordinates.
    pub(super) fn presented(&self, set: &Found, posterior: &SetPosterior) -> (Vec<Present>, Vec<Vec<f64>>) {
        let (mut model, mut deviations) = (Vec::new(), Vec::new());
        let mut at = 0;
        for candidate in &set.causes {
            let size = self.problem.candidates[*candidate].size;
            let own = |i: usize| posterior.mean[at + i];
            let coordinates = if self.problem.candidates[*candidate].prior.response == Response::Discrete {
                vec![1.0]
            } else {
                let inside = |i: usize| {
                    let [lower, upper] = self.problem.candidates[*candidate].bounds(i);
                    own(i).clamp(lower, upper)
                };
                (0..size).map(inside).collect()
            };
            deviations.push((0..size).map(|i| posterior.covariance[(at + i, at + i)].sqrt()).collect());
            model.push(Present { candidate: *candidate, coordinates });
            at += size;
        }
        (model, deviations)
    }

    pub(super) fn stands_still(before: &[Present], now: &[Present], deviations: &[Vec<f64>]) -> bool {
        let close = |now: &Present, sd: &Vec<f64>| {
            let before = before.iter().find(|p| p.candidate == now.candidate);
            before.is_some_and(|before| {
                let moved = before.coordinates.iter().zip(&now.coordinates).zip(sd);
                moved.into_iter().all(|((a, b), sd)| (a - b).abs() <= (STANDS_STILL * sd).max(1e-3 * b.abs()))
            })
        };
        before.len() == now.len() && now.iter().zip(deviations).all(|(now, sd)| close(now, sd))
    }
}
