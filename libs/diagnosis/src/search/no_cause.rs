//! The runs without causes.

use super::hyper::Reach;
use super::space::{Search, VARIATIONS};
use crate::gram::GramCache;
use crate::problem::{Kept, Linearized, Problem, Slope};
use fss_multibody::ModelError;

/// The runs without any cause.
pub(crate) struct NoCause {
    /// Columns of the uncertain values.
    pub(super) uncertain: Linearized,
    /// Hyper-parameters that suit it best.
    pub(crate) hyper: Vec<f64>,
    /// Posterior means of the uncertain values, in stated standard deviations.
    pub(crate) means: Vec<f64>,
    /// Logarithm of its marginal likelihood and prior.
    pub(crate) log_posterior: f64,
}

/// What is known of the hyper-parameters without causes.
#[derive(Clone, Copy)]
pub(crate) enum Noise<'a> {
    Unknown,
    /// They are near those that suited a problem much like this one.
    Near(&'a [f64]),
    As(&'a [f64]),
}

/// The runs without causes.
pub(crate) fn without_causes(
    problem: &Problem,
    noise: Noise,
    say: &(dyn Fn(&str) + Sync),
) -> Result<NoCause, ModelError> {
    say("inferring the noise without causes");
    let uncertain = problem.linearized(&[], Slope::Secant, &|_, _| false, Kept::Nothing)?;
    Ok(NoCause::with(problem, uncertain, noise))
}

impl NoCause {
    /// The same of the same problem with other knowledge of the hyper-parameters.
    pub(crate) fn again(self, problem: &Problem, noise: Noise) -> Self {
        Self::with(problem, self.uncertain, noise)
    }

    fn with(problem: &Problem, uncertain: Linearized, noise: Noise) -> Self {
        let search = Search::new(problem);
        let from = |start: &[f64], reach: Reach| search.optimized(&uncertain, &[], &[], start, reach, |_, _| true);
        let hyper = match noise {
            Noise::Unknown => from(&medians(problem), Reach::OF_PRIOR),
            Noise::Near(known) => from(known, Reach::NEAR),
            Noise::As(known) => known.to_vec(),
        };
        let point = search.point(&uncertain, &hyper, &search.parameters_with(&[]).0, &GramCache::default());
        let (means, log_posterior) =
            point.and_then(|p| Some((p.posterior.means().to_vec(), p.log_posterior(&[])?))).map_or_else(
                || (vec![0.0; problem.uncertain.len()], f64::NEG_INFINITY),
                |(means, likelihood)| (means, likelihood + search.prior_of_set(&[])),
            );
        Self { uncertain, hyper, means, log_posterior }
    }
}

/// The hyper-parameters' medians, without variation from run to run.
pub(super) fn medians(problem: &Problem) -> Vec<f64> {
    let mut start: Vec<f64> = problem.hyper.iter().map(|h| h.median).collect();
    if let Some(variation) = start.last_mut() {
        *variation = VARIATIONS[0];
    }
    start
}
