//! How a service keeps its rate: counts and histograms since the last report.

use crate::Time;
use fss_messages::{Health, text};
use hdrhistogram::Histogram;

/// How often a service reports its health, ns: the sign of life by which its supervisor knows that it has not frozen.
pub const REPORT_PERIOD_NS: u64 = 200_000_000;
/// Largest latency that the histograms tell apart, ns; longer ones count as this.
const LONGEST_NS: u64 = 10_000_000_000;

/// Collects what [`Health`] reports.
pub struct Monitor {
    wake_ns: Histogram<u64>,
    step_ns: Histogram<u64>,
    report: Health,
}

impl Monitor {
    /// For a service of this name and rate, started for the `starts`-th time.
    ///
    /// # Errors
    /// Never with the fixed bounds used here; the histogram's own error otherwise.
    pub fn new(service: &str, rate_hz: f64, starts: u32) -> Result<Self, hdrhistogram::CreationError> {
        let histogram = || Histogram::new_with_bounds(1, LONGEST_NS, 2);
        let report =
            Health { service: text(service), rate_hz, starts, input_age_ns: [u64::MAX; 8], ..Health::default() };
        Ok(Self { wake_ns: histogram()?, step_ns: histogram()?, report })
    }

    /// What the process was granted.
    pub fn set_privileges(&mut self, real_time: bool, memory_locked: bool) {
        self.report.real_time = u8::from(real_time);
        self.report.memory_locked = u8::from(memory_locked);
    }

    /// Counts one step.
    pub fn count_step(&mut self, wake_ns: u64, step_ns: u64, overrun: bool, dropped: u64) {
        self.wake_ns.saturating_record(wake_ns);
        self.step_ns.saturating_record(step_ns);
        self.report.cycles += 1;
        self.report.overruns += u64::from(overrun);
        self.report.dropped += dropped;
    }

    /// Counts boundaries that were missed and skipped.
    pub fn count_skipped(&mut self, boundaries: u64) {
        self.report.skipped += boundaries;
    }

    /// Ages of the inputs, to be filled in place.
    pub fn input_ages_mut(&mut self) -> &mut [u64; 8] {
        &mut self.report.input_age_ns
    }

    /// The report at `now`; the histograms begin anew, the counts go on.
    pub fn report(&mut self, now: Time) -> Health {
        let r = &mut self.report;
        r.stamp_ns = now.ns();
        r.wake_p50_ns = self.wake_ns.value_at_quantile(0.5);
        r.wake_p99_ns = self.wake_ns.value_at_quantile(0.99);
        r.wake_max_ns = self.wake_ns.max();
        r.step_p50_ns = self.step_ns.value_at_quantile(0.5);
        r.step_p99_ns = self.step_ns.value_at_quantile(0.99);
        r.step_max_ns = self.step_ns.max();
        self.wake_ns.reset();
        self.step_ns.reset();
        *r
    }
}
