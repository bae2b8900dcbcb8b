//! The runs without causes.

use super::hyper::Reach;
use super::space::{Search, VARIATIONS};
use crate::gram::GramCache;
use crate::problem::{Linearized, Problem, Slope};
use crate::tuning::Tuning;
use fss_multibody::ModelError;
use nalgebra::DMatrix;

/// Hyper-parameters that suit a model best, and how its likelihood bends about them.
#[derive(Clone)]
pub(crate) struct Noise {
    pub(crate) hyper: Vec<f64>,
    pub(super) curvature: Option<DMatrix<f64>>,
}

/// The runs without any cause.
pub(crate) struct NoCause {
    /// Columns of the uncertain values.
    pub(crate) uncertain: Linearized,
    pub(crate) noise: Noise,
    /// Posterior means of the uncertain values, in stated standard deviations.
    means: Vec<f64>,
    /// Logarithm of its marginal likelihood and prior.
    pub(crate) log_posterior: f64,
}

/// The runs without causes. Their hyper-parameters are sought from the priors' medians, or from some that suited a problem much like this
/// one; of this, columns of uncertain values may be known.
pub(crate) fn without_causes(
    problem: &Problem,
    (near, known): (Option<&Noise>, Linearized),
    say: &(dyn Fn(&str) + Sync),
) -> Result<NoCause, ModelError> {
    say("inferring the noise without causes");
    let hyper = near.map_or_else(|| medians(problem), |near| near.hyper.clone());
    let uncertain = uncertain(problem, &hyper, known)?;
    let search = Search::new(problem);
    let reach = if near.is_some() { Reach::NEAR } else { Reach::OF_PRIOR };
    let hyper = search.optimized(&uncertain, &[], &[], &hyper, reach, |_, _| true);
    let noise = Noise { hyper, curvature: search.curvature() };
    Ok(NoCause::new(&search, uncertain, noise))
}

/// The same with hyper-parameters that suited a problem much like this one.
pub(crate) fn without_causes_at(problem: &Problem, noise: &Noise, known: Linearized) -> Result<NoCause, ModelError> {
    Ok(NoCause::new(&Search::new(problem), uncertain(problem, &noise.hyper, known)?, noise.clone()))
}

/// Columns of the uncertain values.
fn uncertain(problem: &Problem, hyper: &[f64], known: Linearized) -> Result<Linearized, ModelError> {
    problem.linearized((&[], hyper), Slope::Secant, &|_, _| false, known)
}

impl NoCause {
    fn new(search: &Search, uncertain: Linearized, noise: Noise) -> Self {
        let point = search.point(&uncertain, &noise.hyper, &search.parameters_with(&[]).0, &GramCache::default());
        let (means, log_posterior) =
            point.and_then(|p| Some((p.posterior.means().to_vec(), p.log_posterior(&[])?))).map_or_else(
                || (vec![0.0; search.problem.uncertain.len()], f64::NEG_INFINITY),
                |(means, likelihood)| (means, likelihood + search.prior_of_set(&[])),
            );
        Self { uncertain, noise, means, log_posterior }
    }

    /// What the answers of the problem's servos hang on, without causes.
    pub(crate) fn tuning(&self, problem: &Problem) -> Result<Tuning, ModelError> {
        let in_joints = Search::new(problem).values_in_joints((&self.uncertain, &self.noise.hyper), &[])?;
        Ok(Tuning::of(&problem.uncertain, &self.means, &in_joints))
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
