//! Distributions of times.

use hdrhistogram::Histogram;
use miette::{IntoDiagnostic, Result};
use serde::Serialize;

/// A histogram of nanoseconds.
pub struct Distribution(Histogram<u64>);

/// What is told of a distribution.
#[derive(Clone, Copy, Serialize)]
pub struct Percentiles {
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
    pub fn new() -> Result<Self> {
        Histogram::new_with_bounds(1, 10_000_000_000, 3).map(Self).into_diagnostic()
    }

    /// Takes one, ns.
    pub fn record(&mut self, ns: u64) {
        self.0.saturating_record(ns);
    }

    /// How many were taken.
    pub fn count(&self) -> u64 {
        self.0.len()
    }

    /// The percentiles in a unit of which one nanosecond is `scale`.
    pub fn percentiles(&self, scale: f64) -> Percentiles {
        let at = |quantile| self.0.value_at_quantile(quantile) as f64 * scale;
        Percentiles { p50: at(0.5), p90: at(0.9), p99: at(0.99), p99_9: at(0.999), max: self.0.max() as f64 * scale }
    }
}
