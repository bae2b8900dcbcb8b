//! Contacts, such as a link in play that strikes its flanks, or a base that friction holds.
//!
//! A contact does nothing like its column about the model without it, and what it does cannot be foretold to the sensors' noise. So where
//! a discrepancy remains, each is compared about itself with the best set of causes: marginal likelihoods of the same data, each with
//! the noise that its own model has. Where a contact is more probable, the search begins anew with it, and with nothing beside it:
//! other causes would take what of it cannot be foretold.

use super::hyper::Reach;
use super::no_cause::medians;
use super::searched::Searched;
use super::space::{Found, Search};
use crate::gram::GramCache;
use crate::problem::{Linearized, Present, Problem, Slope};
use fss_multibody::ModelError;

/// Sizes that a contact is tried with at least, over the typical one: the smallest, and the widest slab's.
const SIZES: [f64; 2] = [0.25, 4.0];

/// A contact at a size, in the class of its prior that suits it.
#[derive(Clone)]
pub(crate) struct Contact {
    pub(super) present: Present,
    class: usize,
}

impl Contact {
    /// Which candidate it is.
    pub(crate) fn candidate(&self) -> usize {
        self.present.candidate
    }

    /// The set that it is alone in.
    pub(super) fn alone(&self) -> Found {
        alone(self.present.candidate, self.class)
    }
}

/// The contact about which the runs are more probable than about the best set of causes; `None` where there is none.
pub(crate) fn contact(searched: &Searched) -> Result<Option<Contact>, ModelError> {
    let candidates = &searched.search.problem.candidates;
    let contacts: Vec<usize> = (0..candidates.len()).filter(|c| candidates[*c].prior.is_contact).collect();
    // One after the other: a block is linearized about one model at a time.
    let tried: Vec<Tried> =
        contacts.into_iter().map(|candidate| Tried::new(searched, candidate)).collect::<Result<_, _>>()?;
    let Some(best) = tried.into_iter().max_by(|a, b| a.gain.total_cmp(&b.gain)) else { return Ok(None) };
    Ok((best.gain_with_own_noise(searched)? > 0.0).then_some(best.contact))
}

/// A contact at its likeliest size.
struct Tried {
    contact: Contact,
    /// Hyper-parameters at which it is likeliest, of those of the best set of causes and the priors' medians.
    hyper: Vec<f64>,
    /// By which it is more probable than the best set of causes, each at the likelier of these hyper-parameters, nats, in the run that
    /// tells most of it.
    gain: f64,
}

impl Tried {
    fn new(searched: &Searched, candidate: usize) -> Result<Self, ModelError> {
        let of_all = searched.search.problem;
        let (problem, uncertain) = of_all.where_seen(candidate, of_all.of_uncertain(&searched.linearized));
        let search = Search::new(&problem);
        let starts = [medians(&problem), searched.hyper.clone()];
        let mut likeliest = (f64::NEG_INFINITY, present_at(&problem, candidate, SIZES[0]), 0, &starts[0]);
        try_sizes(|by| {
            let present = present_at(&problem, candidate, by);
            let own = &problem.candidates[candidate];
            if present.coordinates.iter().enumerate().any(|(i, value)| *value > own.bounds(i)[1]) {
                return Ok(None);
            }
            let about = search
                .with_columns_of((std::slice::from_ref(&present), &searched.hyper), problem.of_uncertain(&uncertain))?;
            let mut is_likeliest = false;
            for start in &starts {
                let (value, class) = search.likeliest_class((&about, start), candidate);
                if value > likeliest.0 {
                    (likeliest, is_likeliest) = ((value, present.clone(), class, start), true);
                }
            }
            Ok::<_, ModelError>(Some(is_likeliest))
        })?;
        let (value, present, class, hyper) = likeliest;
        let about = search.with_columns_of((&searched.model, &searched.hyper), uncertain)?;
        let other = starts.iter().map(|start| search.log_posterior((&about, start), &searched.sets[0].0));
        let gain = value - other.fold(f64::NEG_INFINITY, f64::max);
        Ok(Self { contact: Contact { present, class }, hyper: hyper.clone(), gain })
    }

    /// The same, each at the hyper-parameters that suit it best.
    fn gain_with_own_noise(&self, searched: &Searched) -> Result<f64, ModelError> {
        let of_all = searched.search.problem;
        let (problem, uncertain) =
            of_all.where_seen(self.contact.candidate(), of_all.of_uncertain(&searched.linearized));
        let search = Search::new(&problem);
        let about =
            |model: &[Present], hyper: &[f64]| search.with_columns_of((model, hyper), problem.of_uncertain(&uncertain));
        let own = about(std::slice::from_ref(&self.contact.present), &self.hyper)?;
        let (_, own) = search.optimum(&own, &self.contact.alone(), &self.hyper);
        let (_, other) =
            search.optimum(&about(&searched.model, &searched.hyper)?, &searched.sets[0].0, &searched.hyper);
        Ok(own - other)
    }
}

/// Tries sizes: the smallest, its doubles up to the widest slab's, and on as long as the last is the likeliest so far, which
/// `is_likeliest` tells of each; it tells `None` of a size that bounds exclude.
fn try_sizes<E>(mut is_likeliest: impl FnMut(f64) -> Result<Option<bool>, E>) -> Result<(), E> {
    let [mut by, widest] = SIZES;
    while let Some(is_likeliest) = is_likeliest(by)? {
        if by >= widest && !is_likeliest {
            break;
        }
        by *= 2.0;
    }
    Ok(())
}

fn present_at(problem: &Problem, candidate: usize, by: f64) -> Present {
    let own = &problem.candidates[candidate];
    Present { candidate, coordinates: own.prior.typical[..own.size].iter().map(|typical| by * typical).collect() }
}

fn alone(candidate: usize, class: usize) -> Found {
    Found { causes: vec![candidate], classes: vec![class], log_likelihood: 0.0, log_posterior: 0.0 }
}

impl Search<'_> {
    fn with_columns_of(
        &self,
        (model, hyper): (&[Present], &[f64]),
        known: Linearized,
    ) -> Result<Linearized, ModelError> {
        let is_present = |c: usize, _: &_| model.iter().any(|p| p.candidate == c);
        self.problem.linearized((model, hyper), Slope::Secant, &is_present, known)
    }

    /// The class of its prior in which a cause alone is likeliest, and the logarithm of its marginal likelihood there.
    fn likeliest_class(&self, (about, hyper): (&Linearized, &[f64]), candidate: usize) -> (f64, usize) {
        let (parameters, position) = self.parameters_with(&[candidate]);
        let point = self.point(about, hyper, &parameters, &GramCache::default());
        let value = |class: usize| {
            let slabs = self.slabs(&[candidate], &[class], &position)?;
            point.as_ref()?.log_posterior(&slabs)
        };
        let all = (0..self.classes(candidate)).map(|class| (value(class).unwrap_or(f64::NEG_INFINITY), class));
        all.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::NEG_INFINITY, 0))
    }

    /// Hyper-parameters that suit a set best about its own estimate, and the logarithm of its marginal likelihood and prior there.
    pub(super) fn optimum(&self, about: &Linearized, set: &Found, start: &[f64]) -> (Vec<f64>, f64) {
        let hyper = self.optimized(about, &set.causes, &set.classes, start, Reach::OF_MODEL, |_, _| true);
        let log_posterior = self.log_posterior((about, &hyper), set);
        (hyper, log_posterior)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tried(likeliest: f64, most: f64) -> Vec<f64> {
        let (mut tried, mut best) = (Vec::new(), f64::NEG_INFINITY);
        let tries = try_sizes(|by: f64| {
            if by > most {
                return Ok::<_, ()>(None);
            }
            tried.push(by);
            let value = -(by / likeliest).ln().abs();
            let is_likeliest = value > best;
            best = best.max(value);
            Ok(Some(is_likeliest))
        });
        assert_eq!(tries, Ok(()));
        tried
    }

    #[test]
    fn a_contact_of_any_size_is_between_sizes_that_are_tried() {
        assert_eq!(tried(1.0, 100.0), [0.25, 0.5, 1.0, 2.0, 4.0]);
        assert_eq!(tried(15.0, 100.0), [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0]);
        assert_eq!(tried(15.0, 10.0), [0.25, 0.5, 1.0, 2.0, 4.0, 8.0], "bounds");
    }
}
