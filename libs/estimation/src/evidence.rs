//! Marginal likelihoods of sets of parameters of a linear Gaussian model, from its Gram matrix.
//!
//! The model is `e = J theta + noise` with white noise of unit variance. Every parameter has a narrow normal prior about 0, its
//! spike; a hypothesis replaces the spikes of a few by wider priors about their own means, the slabs. With `A = J'J`,
//! `b = J'e`, `c = e'e`, spikes D and slabs V about u, all other parameters integrated out:
//!
//! ```text
//! C = (A + D^-1)^-1,  m = C b,   ln Z_0 = -(ln det R + c - b'm) / 2 - ln |I + D^1/2 A D^1/2| / 2
//! L = C_SS^-1 - D_S^-1,  j = C_SS^-1 m_S                       likelihood of theta_S, the rest integrated out
//! S = (L + V^-1)^-1,  t = S (j + V^-1 u)                       posterior of theta_S
//! ln Z_S = ln Z_0 - m_S'j / 2 + ln |D_S^1/2 C_SS^-1 D_S^1/2| / 2
//!          + t'(j + V^-1 u) / 2 - u'V^-1 u / 2 - ln |V^1/2 S^-1 V^1/2| / 2
//! ```
//!
//! (MacKay, *Information Theory, Inference, and Learning Algorithms*, 2003, chapter 28: Occam's factor is the last
//! determinant.) A set costs the cube of its size, whatever the number of all parameters.

use crate::statistics::normal_cdf;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Sums of products of whitened columns, the first of which holds the data.
#[derive(Clone, Debug)]
pub struct Gram {
    /// `[e J]'[e J]`.
    pub products: DMatrix<f64>,
    /// Logarithm of the determinant of the noise's covariance.
    pub log_det: f64,
}

/// The posterior with every parameter in its spike, from which that of any set follows.
#[derive(Clone, Debug)]
pub struct SpikePosterior {
    covariance: DMatrix<f64>,
    mean: DVector<f64>,
    spikes: Vec<f64>,
    /// Logarithm of the marginal likelihood of no parameter beyond its spike, but for a constant of the data.
    pub log_evidence: f64,
}

/// A parameter beyond its spike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slab {
    /// Which parameter, from 0.
    pub parameter: usize,
    /// Mean of its prior.
    pub mean: f64,
    /// Standard deviation of its prior.
    pub sd: f64,
    /// Bounds of the parameter.
    pub bounds: [f64; 2],
}

/// What the data say of a set of parameters.
#[derive(Clone, Debug)]
pub struct SetPosterior {
    /// Logarithm of the marginal likelihood of the set.
    pub log_evidence: f64,
    /// Posterior mean of the set's parameters.
    pub mean: Vec<f64>,
    /// Posterior covariance.
    pub covariance: DMatrix<f64>,
}

impl SetPosterior {
    /// The same under several priors, each as probable as any other before the data: with this mean, and the covariance about it of the
    /// mixture, each weighed by its marginal likelihood.
    #[must_use]
    pub fn among(mut self, others: &[Self]) -> Self {
        let all = || std::iter::once(&self).chain(others);
        let top = all().map(|own| own.log_evidence).fold(f64::NEG_INFINITY, f64::max);
        let k = self.mean.len();
        let (mut covariance, mut sum) = (DMatrix::zeros(k, k), 0.0);
        for own in all() {
            let weight = (own.log_evidence - top).exp();
            let apart = DVector::from_fn(k, |i, _| own.mean[i] - self.mean[i]);
            covariance += weight * (&own.covariance + &apart * apart.transpose());
            sum += weight;
        }
        self.covariance = covariance / sum;
        self
    }
}

impl SpikePosterior {
    /// From a Gram matrix and the standard deviations of the spikes, one a parameter. `None` where the matrix is not finite.
    pub fn new(gram: &Gram, spikes: &[f64]) -> Option<Self> {
        let n = spikes.len();
        let scaled = DMatrix::from_fn(n, n, |i, j| spikes[i] * gram.products[(i + 1, j + 1)] * spikes[j]);
        let cholesky = Cholesky::new(scaled + DMatrix::identity(n, n))?;
        let log_det: f64 = (0..n).map(|i| cholesky.l_dirty()[(i, i)].ln()).sum();
        let inverse = cholesky.inverse();
        let covariance = DMatrix::from_fn(n, n, |i, j| spikes[i] * inverse[(i, j)] * spikes[j]);
        let b = gram.products.view((1, 0), (n, 1)).into_owned();
        let mean = DVector::from_column_slice((&covariance * &b).as_slice());
        let explained = b.column(0).dot(&mean);
        let log_evidence = -0.5 * (gram.log_det + gram.products[(0, 0)] - explained) - log_det;
        log_evidence.is_finite().then(|| Self { covariance, mean, spikes: spikes.to_vec(), log_evidence })
    }

    /// Posterior mean of every parameter in its spike.
    pub fn means(&self) -> &[f64] {
        self.mean.as_slice()
    }

    /// Posterior mean of every parameter where the parameters of a set are those of its posterior.
    pub fn means_given(&self, set: &[Slab], posterior: &SetPosterior) -> Vec<f64> {
        let Some(inverse) = self.precision(set) else { return self.mean.as_slice().to_vec() };
        let shift = DVector::from_fn(set.len(), |i, _| posterior.mean[i] - self.mean[set[i].parameter]);
        let pull = inverse * shift;
        let moved =
            |k: usize| set.iter().zip(pull.iter()).map(|(s, p)| self.covariance[(k, s.parameter)] * p).sum::<f64>();
        (0..self.mean.len()).map(|k| self.mean[k] + moved(k)).collect()
    }

    /// `C_SS^-1`, by way of correlations.
    fn precision(&self, set: &[Slab]) -> Option<DMatrix<f64>> {
        let k = set.len();
        let sd: Vec<f64> = set.iter().map(|s| self.covariance[(s.parameter, s.parameter)].sqrt()).collect();
        let correlation =
            DMatrix::from_fn(k, k, |i, j| self.covariance[(set[i].parameter, set[j].parameter)] / (sd[i] * sd[j]));
        let inverse = Cholesky::new(correlation)?.inverse();
        Some(DMatrix::from_fn(k, k, |i, j| inverse[(i, j)] / (sd[i] * sd[j])))
    }

    /// The set's marginal likelihood and posterior; `None` where its parameters are one and the same to rounding.
    pub fn of_set(&self, set: &[Slab]) -> Option<SetPosterior> {
        let k = set.len();
        if k == 0 {
            let covariance = DMatrix::zeros(0, 0);
            return Some(SetPosterior { log_evidence: self.log_evidence, mean: Vec::new(), covariance });
        }
        let precision = self.precision(set)?;
        let mean = DVector::from_fn(k, |i, _| self.mean[set[i].parameter]);
        let j = &precision * &mean;
        let spike = |i: usize| self.spikes[set[i].parameter];
        let without = Cholesky::new(DMatrix::from_fn(k, k, |a, b| spike(a) * precision[(a, b)] * spike(b)))?;
        let mut information = precision.clone();
        let mut pull = j.clone();
        for (i, slab) in set.iter().enumerate() {
            information[(i, i)] += 1.0 / (slab.sd * slab.sd) - 1.0 / (spike(i) * spike(i));
            pull[i] += slab.mean / (slab.sd * slab.sd);
        }
        let scaled = DMatrix::from_fn(k, k, |a, b| set[a].sd * information[(a, b)] * set[b].sd);
        let with = Cholesky::new(scaled)?;
        let inverse = with.inverse();
        let covariance = DMatrix::from_fn(k, k, |a, b| set[a].sd * inverse[(a, b)] * set[b].sd);
        let posterior = &covariance * &pull;
        let half_log_det = |c: &Cholesky<f64, nalgebra::Dyn>| (0..k).map(|i| c.l_dirty()[(i, i)].ln()).sum::<f64>();
        let prior: f64 = set.iter().map(|s| (s.mean / s.sd).powi(2)).sum();
        let mut log_evidence =
            self.log_evidence - 0.5 * mean.dot(&j) + half_log_det(&without) + 0.5 * posterior.dot(&pull)
                - 0.5 * prior
                - half_log_det(&with);
        for (i, slab) in set.iter().enumerate() {
            log_evidence += log_mass(posterior[i], covariance[(i, i)].sqrt(), slab.bounds)
                - log_mass(slab.mean, slab.sd, slab.bounds);
        }
        Some(SetPosterior { log_evidence, mean: posterior.as_slice().to_vec(), covariance })
    }
}

/// Logarithm of a normal distribution's mass between bounds.
fn log_mass(mean: f64, sd: f64, [lower, upper]: [f64; 2]) -> f64 {
    let (a, b) = ((lower - mean) / sd, (upper - mean) / sd);
    if a <= -8.0 && b >= 8.0 {
        return 0.0;
    }
    // Of the two tails, the one in which the interval lies keeps its digits.
    if a > 0.0 {
        log_upper_tail(a)
    } else if b < 0.0 {
        log_upper_tail(-b)
    } else {
        (normal_cdf(b) - normal_cdf(a)).abs().max(0.0).max(f64::MIN_POSITIVE).ln()
    }
}

fn log_upper_tail(x: f64) -> f64 {
    // Beyond this, erfc underflows before its logarithm matters: the first terms of the asymptotic series.
    if x < 30.0 {
        normal_cdf(-x).ln()
    } else {
        -0.5 * x * x - (x * (std::f64::consts::TAU).sqrt()).ln() - 1.0 / (x * x)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

    fn problem(seed: u64, n: usize, rows: usize) -> (DMatrix<f64>, DVector<f64>) {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut any = || random.random_range(-1.7..1.7);
        (DMatrix::from_fn(rows, n, |_, _| any()), DVector::from_fn(rows, |_, _| 2.0 * any()))
    }

    fn gram(j: &DMatrix<f64>, e: &DVector<f64>) -> Gram {
        let mut all = DMatrix::zeros(e.len(), j.ncols() + 1);
        all.column_mut(0).copy_from(e);
        all.columns_mut(1, j.ncols()).copy_from(j);
        Gram { products: all.transpose() * &all, log_det: 0.0 }
    }

    /// ln N(e; J u, I + J V J') + rows/2 ln 2 pi, from the definition.
    fn dense(j: &DMatrix<f64>, e: &DVector<f64>, means: &[f64], sds: &[f64]) -> f64 {
        let v = DMatrix::from_diagonal(&DVector::from_fn(sds.len(), |i, _| sds[i] * sds[i]));
        let covariance = DMatrix::identity(e.len(), e.len()) + j * v * j.transpose();
        let residual = e - j * DVector::from_column_slice(means);
        let cholesky = Cholesky::new(covariance).unwrap();
        let log_det = 2.0 * cholesky.l().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        -0.5 * (log_det + residual.dot(&cholesky.solve(&residual)))
    }

    #[test]
    fn under_several_priors_a_value_is_as_unsure_as_their_mixture() {
        let normal = |log_evidence: f64, mean: f64, variance: f64| SetPosterior {
            log_evidence,
            mean: vec![mean],
            covariance: DMatrix::from_element(1, 1, variance),
        };
        let (three, one) = (normal(3.0_f64.ln(), 2.0, 0.5), normal(0.0, 0.0, 0.1));
        // 3/4 (0.5) + 1/4 (0.1 + 2^2).
        let mixed = three.clone().among(&[one]);
        assert!((mixed.covariance[(0, 0)] - 1.4).abs() < 1e-12 && mixed.mean == [2.0]);
        let alone = three.clone().among(&[normal(-1e3, 9.0, 1.0)]);
        assert!((alone.covariance[(0, 0)] - 0.5).abs() < 1e-12);
    }

    #[test]
    fn the_evidence_of_a_set_is_the_density_of_the_data_under_its_prior() {
        let seed = 3;
        println!("seed {seed}");
        let (j, e) = problem(seed, 5, 30);
        let spikes = [0.01, 0.02, 0.5, 1.0, 0.03];
        let spike = SpikePosterior::new(&gram(&j, &e), &spikes).unwrap();
        assert!((spike.log_evidence - dense(&j, &e, &[0.0; 5], &spikes)).abs() < 1e-9);
        let set = [
            Slab { parameter: 3, mean: 0.7, sd: 2.0, bounds: FREE },
            Slab { parameter: 1, mean: 0.0, sd: 0.4, bounds: FREE },
        ];
        let expected = dense(&j, &e, &[0.0, 0.0, 0.0, 0.7, 0.0], &[0.01, 0.4, 0.5, 2.0, 0.03]);
        let found = spike.of_set(&set).unwrap();
        assert!((found.log_evidence - expected).abs() < 1e-8, "{} {expected}", found.log_evidence);
        let reversed = spike.of_set(&[set[1], set[0]]).unwrap();
        assert!((found.log_evidence - reversed.log_evidence).abs() < 1e-10, "the order of causes plays no part");
    }

    #[test]
    fn units_play_no_part() {
        let (j, e) = problem(4, 3, 20);
        let mut scaled = j.clone();
        scaled.column_mut(1).scale_mut(1e6);
        let plain = SpikePosterior::new(&gram(&j, &e), &[0.1; 3]).unwrap();
        let other = SpikePosterior::new(&gram(&scaled, &e), &[0.1, 1e-7, 0.1]).unwrap();
        let slab =
            |sd: f64, scale: f64| [Slab { parameter: 1, mean: 0.0, sd: sd * scale, bounds: [0.0, f64::INFINITY] }];
        let (a, b) = (plain.of_set(&slab(2.0, 1.0)).unwrap(), other.of_set(&slab(2.0, 1e-6)).unwrap());
        assert!((a.log_evidence - b.log_evidence).abs() < 1e-6);
        assert!((a.mean[0] - 1e6 * b.mean[0]).abs() < 1e-6);
    }

    #[test]
    fn a_wider_prior_costs_the_logarithm_of_its_width() {
        let (j, e) = problem(5, 1, 200);
        let spike = SpikePosterior::new(&gram(&j, &e), &[1e-4]).unwrap();
        let evidence =
            |sd: f64| spike.of_set(&[Slab { parameter: 0, mean: 0.0, sd, bounds: FREE }]).unwrap().log_evidence;
        assert!((evidence(100.0) - evidence(1000.0) - 10.0_f64.ln()).abs() < 1e-4);
    }

    #[test]
    fn a_bound_that_the_estimate_violates_excludes_the_cause() {
        let j = DMatrix::from_element(100, 1, 1.0);
        let e = DVector::from_element(100, -1.0);
        let spike = SpikePosterior::new(&gram(&j, &e), &[1e-3]).unwrap();
        let with = |bounds| spike.of_set(&[Slab { parameter: 0, mean: 0.0, sd: 1.0, bounds }]).unwrap().log_evidence;
        assert!(with(FREE) > spike.log_evidence + 30.0);
        assert!(with([0.0, f64::INFINITY]) < spike.log_evidence);
        assert!((log_mass(0.0, 1.0, [0.0, f64::INFINITY]) - 0.5_f64.ln()).abs() < 1e-12);
    }
}
