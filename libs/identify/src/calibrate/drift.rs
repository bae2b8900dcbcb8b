//! Nuisance drift: where a free body is after white noise has pushed it for a while.
//!
//! Room air, a sloping table and the momentum at the start move the whole system in ways that no parameter of the arm
//! explains. The drift is a process with state `(value, momentum)`: the momentum makes a random walk, the value integrates it,
//! and both start anywhere. Its Kalman filter turns a series into innovations that are white where the series is that drift
//! and white noise (Kalman, 1960; the likelihood of the innovations: Schweppe, 1965). The filter's gains do not depend on
//! the data, so that residuals pass through it as linearly as through a weight.

/// From one instant of a series to the next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Interval {
    /// Time, s.
    pub(super) duration_s: f64,
    /// Change of the value per momentum.
    pub(super) gain: f64,
}

/// A filter for one series.
#[derive(Clone, Debug)]
pub(super) struct Whitener {
    steps: Vec<Step>,
}

#[derive(Clone, Copy, Debug)]
struct Step {
    gain: f64,
    update: [f64; 2],
    /// Standard deviation of the innovation over that of the white noise of one sample.
    deviation: f64,
}

/// The first innovations only find out where the drift starts.
pub(super) const START: usize = 2;
/// Variance of the start over that of the noise, in units of the value.
const ANYWHERE: f64 = 1e7;

impl Whitener {
    /// `variance` of each sample's noise over that of the series, the intervals between them, and the variance by which the
    /// momentum grows in a second, over that of the noise.
    pub(super) fn new(variance: &[f64], intervals: &[Interval], walk: f64) -> Self {
        // In units of time the momentum may be anything that moves the value by as much as it may be off at the start.
        let span: f64 = intervals.iter().map(|i| i.gain).sum::<f64>().max(1e-9);
        let (mut p, mut steps) = ([ANYWHERE, 0.0, 100.0 * ANYWHERE / (span * span)], Vec::with_capacity(variance.len()));
        for (k, noise) in variance.iter().enumerate() {
            let (mut g, mut q) = (0.0, 0.0);
            if let Some(interval) = k.checked_sub(1).and_then(|before| intervals.get(before)) {
                (g, q) = (interval.gain, walk * interval.duration_s);
            }
            let [a, b, c] = p;
            let (a, b, c) = (a + 2.0 * g * b + g * g * c + q * g * g / 3.0, b + g * c + q * g / 2.0, c + q);
            let s = a + noise;
            let update = [a / s, b / s];
            steps.push(Step { gain: g, update, deviation: s.sqrt() });
            p = [a * noise / s, b * noise / s, c - b * b / s];
        }
        Self { steps }
    }

    /// Innovations, each over its standard deviation: white with the noise's variance. The first [`START`] are zero.
    pub(super) fn apply(&self, series: &[f64]) -> Vec<f64> {
        // Counted from the first sample, far less is lost to rounding.
        let origin = series.first().copied().unwrap_or(0.0);
        let (mut value, mut momentum) = (0.0, 0.0);
        let mut out = Vec::with_capacity(series.len());
        for (k, (step, sample)) in self.steps.iter().zip(series).enumerate() {
            value += step.gain * momentum;
            let innovation = sample - origin - value;
            value += step.update[0] * innovation;
            momentum += step.update[1] * innovation;
            out.push(if k < START { 0.0 } else { innovation / step.deviation });
        }
        out
    }

    /// Sum of the logarithms of the innovations' variances.
    pub(super) fn log_variance(&self) -> f64 {
        self.steps.iter().skip(START).map(|step| 2.0 * step.deviation.ln()).sum()
    }
}

/// The walk that explains several series best, out of a grid: variance of momentum per second over that of the noise.
pub(super) fn likeliest_walk(series: &[(Vec<f64>, &[f64], &[Interval])]) -> f64 {
    let cost = |walk: f64| {
        let (mut squares, mut logs, mut count) = (0.0, 0.0, 0);
        for (values, variance, intervals) in series {
            let whitener = Whitener::new(variance, intervals, walk);
            squares += whitener.apply(values).iter().map(|v| v * v).sum::<f64>();
            logs += whitener.log_variance();
            count += values.len().saturating_sub(START);
        }
        logs + count as f64 * (squares.max(1e-300) / count.max(1) as f64).ln()
    };
    let grid = (-16..=12).map(|k| 10_f64.powf(0.5 * f64::from(k)));
    let mut best = (0.0, cost(0.0));
    for walk in grid {
        let c = cost(walk);
        if c < best.1 {
            best = (walk, c);
        }
    }
    best.0
}
