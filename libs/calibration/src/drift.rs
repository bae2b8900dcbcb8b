//! Nuisance drift: where a free body is after white noise has pushed it for a while.
//!
//! Room air, a sloping table and the momentum at the start move the whole system in ways that no parameter of the arm
//! explains. Place of the centre of mass and angle of the base integrate momenta, the momenta make random walks, and all
//! start anywhere. The Kalman filter of this drift turns a series into innovations that are white where the series is drift
//! and white noise (Kalman, 1960; the likelihood of the innovations: Schweppe, 1965). Its gains do not depend on the
//! data, so that residuals pass through it as linearly as through a weight.

use nalgebra::{Matrix3, Matrix6, Matrix6x3, Vector3, Vector6};

/// From one instant of a series to the next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Interval {
    /// Time, s.
    pub(super) duration_s: f64,
    /// Turn of the base per angular momentum, 1/(N m).
    pub(super) turn_per_momentum: f64,
}

impl Interval {
    /// Change of x, y and angle per momentum; linear momentum in units of the whole mass.
    fn gains(&self) -> [f64; 3] {
        [self.duration_s, self.duration_s, self.turn_per_momentum]
    }
}

/// A filter for the series of one stretch.
#[derive(Clone, Debug)]
pub(super) struct Whitener {
    steps: Vec<Step>,
}

#[derive(Clone, Debug)]
struct Step {
    gains: [f64; 3],
    update: Matrix6x3<f64>,
    /// Inverse of the Cholesky factor of the innovation's covariance.
    whiten: Matrix3<f64>,
    log_variance: f64,
}

/// The first innovations only find out where the drift starts.
pub(super) const START: usize = 2;
/// Variance of the start over that of the noise.
const ANYWHERE: f64 = 1e7;

impl Whitener {
    /// `noise` is the covariance of each sample: x, y, angle. `walks` are the variances by which linear and angular momentum
    /// grow in a second, over the mean variances of place and angle.
    pub(super) fn new(noise: &[Matrix3<f64>], intervals: &[Interval], walks: [f64; 2]) -> Self {
        let mean: Matrix3<f64> = noise.iter().sum::<Matrix3<f64>>() / noise.len().max(1) as f64;
        let unit = [0, 1, 2].map(|c| mean[(c, c)]);
        let walk = [0, 1, 2].map(|c| unit[c] * walks[usize::from(c == 2)]);
        let mut p = Matrix6::zeros();
        for c in 0..3 {
            // Momentum that moves the value ten times as far as it may be off at the start.
            let span: f64 = intervals.iter().map(|i| i.gains()[c]).sum::<f64>().max(1e-9);
            p[(c, c)] = ANYWHERE * unit[c];
            p[(3 + c, 3 + c)] = 100.0 * ANYWHERE * unit[c] / (span * span);
        }
        let mut steps = Vec::with_capacity(noise.len());
        for (k, r) in noise.iter().enumerate() {
            let interval = k.checked_sub(1).and_then(|before| intervals.get(before));
            let gains = interval.map_or([0.0; 3], Interval::gains);
            if let Some(interval) = interval {
                let mut f = Matrix6::identity();
                (0..3).for_each(|c| f[(c, 3 + c)] = gains[c]);
                p = f * p * f.transpose();
                for c in 0..3 {
                    let (g, q) = (gains[c], walk[c] * interval.duration_s);
                    p[(c, c)] += q * g * g / 3.0;
                    p[(c, 3 + c)] += q * g / 2.0;
                    p[(3 + c, c)] += q * g / 2.0;
                    p[(3 + c, 3 + c)] += q;
                }
            }
            let seen: Matrix6x3<f64> = p.fixed_columns::<3>(0).into_owned();
            let s: Matrix3<f64> = seen.fixed_rows::<3>(0) + r;
            let (inverse, whiten, log_variance) = match s.cholesky() {
                Some(c) => (c.inverse(), c.l().try_inverse().unwrap_or_default(), c.determinant().ln()),
                None => (Matrix3::zeros(), Matrix3::zeros(), 0.0),
            };
            let update = seen * inverse;
            p -= update * seen.transpose();
            p = 0.5 * (p + p.transpose());
            steps.push(Step { gains, update, whiten, log_variance });
        }
        Self { steps }
    }

    /// Innovations of variance one without correlation. The first [`START`] are zero.
    pub(super) fn apply(&self, series: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        // Counted from the first sample, far less is lost to rounding.
        let origin = series.first().copied().unwrap_or_default();
        let mut state = Vector6::zeros();
        let step = |(k, (step, sample)): (usize, (&Step, &Vector3<f64>))| {
            for c in 0..3 {
                state[c] += step.gains[c] * state[3 + c];
            }
            let innovation = sample - origin - state.fixed_rows::<3>(0);
            state += step.update * innovation;
            if k < START { Vector3::zeros() } else { step.whiten * innovation }
        };
        self.steps.iter().zip(series).enumerate().map(step).collect()
    }

    /// Sum of the logarithms of the determinants of the innovations' covariances.
    fn log_variance(&self) -> f64 {
        self.steps.iter().skip(START).map(|step| step.log_variance).sum()
    }
}

/// The series of one stretch with all that its filter needs.
pub(super) struct Drifting<'a> {
    pub(super) series: &'a [Vector3<f64>],
    pub(super) noise: &'a [Matrix3<f64>],
    pub(super) intervals: &'a [Interval],
}

/// The walks that explain the series best, each out of a grid.
pub(super) fn likeliest_walks(all: &[Drifting]) -> [f64; 2] {
    let cost = |walks: [f64; 2]| {
        let (mut squares, mut logs, mut count) = (0.0, 0.0, 0);
        for one in all {
            let whitener = Whitener::new(one.noise, one.intervals, walks);
            squares += whitener.apply(one.series).iter().map(Vector3::norm_squared).sum::<f64>();
            logs += whitener.log_variance();
            count += 3 * one.series.len().saturating_sub(START);
        }
        logs + count as f64 * (squares.max(1e-300) / count.max(1) as f64).ln()
    };
    let mut best = ([0.0; 2], cost([0.0; 2]));
    // One after the other: place and angle drift apart from each other.
    for which in [0, 1, 0] {
        for k in -14..=8 {
            let mut walks = best.0;
            walks[which] = 10_f64.powf(0.5 * f64::from(k));
            let c = cost(walks);
            if c < best.1 {
                best = (walks, c);
            }
        }
    }
    best.0
}
