//! Contacts, such as a link in play that strikes its flanks.
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
use crate::problem::{Kept, Linearized, Present, Problem, Slope};
use fss_multibody::ModelError;

/// Sizes that a contact is tried with, over the typical one.
const SIZES: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];

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
    let problem = searched.search.problem;
    let mut best: Option<(f64, Contact)> = None;
    for candidate in (0..problem.candidates.len()).filter(|c| problem.candidates[*c].prior.is_contact) {
        let (gain, contact) = gained(searched, candidate)?;
        if gain > best.as_ref().map_or(0.0, |(most, _)| *most) {
            best = Some((gain, contact));
        }
    }
    Ok(best.map(|(_, contact)| contact))
}

/// What a contact at its likeliest size is more probable than the best set of causes, nats, in the runs that tell most of it.
fn gained(searched: &Searched, candidate: usize) -> Result<(f64, Contact), ModelError> {
    let of_all = searched.search.problem;
    let (problem, uncertain) = of_all.where_seen(candidate, of_all.of_uncertain(&searched.linearized));
    let search = Search::new(&problem);
    let starts = [medians(&problem), searched.hyper.clone()];
    let mut likeliest = (f64::NEG_INFINITY, present_at(&problem, candidate, SIZES[0]), 0, &starts[0]);
    for by in SIZES {
        let present = present_at(&problem, candidate, by);
        let about = search.with_columns_of(std::slice::from_ref(&present), problem.of_uncertain(&uncertain))?;
        for start in &starts {
            let (value, class) = search.likeliest_class((&about, start), candidate);
            if value > likeliest.0 {
                likeliest = (value, present.clone(), class, start);
            }
        }
    }
    let (_, present, class, start) = likeliest;
    let contact = Contact { present, class };
    let about = |model: &[Present]| search.with_columns_of(model, problem.of_uncertain(&uncertain));
    let (_, own) = search.optimum(&about(std::slice::from_ref(&contact.present))?, &contact.alone(), start);
    let (_, other) = search.optimum(&about(&searched.model)?, &searched.sets[0].0, &searched.hyper);
    Ok((own - other, contact))
}

fn present_at(problem: &Problem, candidate: usize, by: f64) -> Present {
    let own = &problem.candidates[candidate];
    Present { candidate, coordinates: own.prior.typical[..own.size].iter().map(|typical| by * typical).collect() }
}

fn alone(candidate: usize, class: usize) -> Found {
    Found { causes: vec![candidate], classes: vec![class], log_likelihood: 0.0, log_posterior: 0.0 }
}

impl Search<'_> {
    fn with_columns_of(&self, model: &[Present], kept: Linearized) -> Result<Linearized, ModelError> {
        let is_present = |c: usize, _: &_| model.iter().any(|p| p.candidate == c);
        self.problem.linearized(model, Slope::Secant, &is_present, Kept::All(kept))
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
