//! Distributions of times.

use hdrhistogram::Histogram;
use miette::{IntoDiagnostic, Result};
use serde::Serialize;

/// A histogram of nanoseconds.
pub(crate) struct Distribution(Histogram<u64>);

/// What is told of a distribution.
#[derive(Clone, Copy, Default, Serialize)]
pub(crate) struct Percentiles {
    /// Half are below.
    pub p50: f64,
    /// 90 of 100 are below.
    pub p90: f64,
    /// 99 of 100 are below.
    pub p99: f64,
    /// 999 of 1000 are below.
    pub p99_9: f64,
    /// The largest.
    pub max: f64,
}

impl Distribution {
    /// Of times up to 10 s, to three digits.
    pub(crate) fn new() -> Result<Self> {
        Histogram::new_with_bounds(1, 10_000_000_000, 3).map(Self).into_diagnostic()
    }

    /// Takes one, ns.
    pub(crate) fn record(&mut self, ns: u64) {
        self.0.saturating_record(ns);
    }

    /// Forgets what it took.
    pub(crate) fn clear(&mut self) {
        self.0.reset();
    }

    /// How many were taken.
    pub(crate) fn count(&self) -> u64 {
        self.0.len()
    }

    /// The percentiles in a unit of which one nanosecond is `scale`.
    pub(crate) fn percentiles(&self, scale: f64) -> Percentiles {
        let at = |quantile| self.0.value_at_quantile(quantile) as f64 * scale;
        Percentiles { p50: at(0.5), p90: at(0.9), p99: at(0.99), p99_9: at(0.999), max: self.0.max() as f64 * scale }
    }
}

impl Percentiles {
    /// How many times another's each is.
    pub(crate) fn over(&self, other: &Self) -> Self {
        Self {
            p50: self.p50 / other.p50,
            p90: self.p90 / other.p90,
            p99: self.p99 / other.p99,
            p99_9: self.p99_9 / other.p99_9,
            max: self.max / other.max,
        }
    }

    /// What is usual of several: the median of each percentile, and the largest of all.
    pub(crate) fn median(of: &[Self]) -> Self {
        let median = |get: fn(&Self) -> f64| {
            let mut values: Vec<f64> = of.iter().map(get).collect();
            values.sort_by(f64::total_cmp);
            let (low, high) = (values.len().saturating_sub(1) / 2, values.len() / 2);
            values.get(low).zip(values.get(high)).map_or(0.0, |(low, high)| f64::midpoint(*low, *high))
        };
        let max = of.iter().map(|p| p.max).fold(0.0, f64::max);
        Self { p50: median(|p| p.p50), p90: median(|p| p.p90), p99: median(|p| p.p99), p99_9: median(|p| p.p99_9), max }
    }
}
