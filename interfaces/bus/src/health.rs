//! How a service keeps its rate: counts and histograms since the last report.

use crate::Time;
use crate::launch::Schedule;
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
    deadline_ns: u64,
    report: Health,
}

impl Monitor {
    /// For a service of this name and schedule, started for the `starts`-th time.
    ///
    /// # Errors
    /// Never with the fixed bounds used here; the histogram's own error otherwise.
    pub fn new(service: &str, schedule: &Schedule, starts: u32) -> Result<Self, hdrhistogram::CreationError> {
        let histogram = || Histogram::new_with_bounds(1, LONGEST_NS, 2);
        let (service, rate_hz) = (text(service), *schedule.rate_hz.get_ref());
        let report = Health { service, rate_hz, starts, input_age_ns: [u64::MAX; 8], ..Health::default() };
        Ok(Self { wake_ns: histogram()?, step_ns: histogram()?, deadline_ns: schedule.deadline_ns(), report })
    }

    /// What the process was granted.
    pub fn set_privileges(&mut self, real_time: bool, memory_locked: bool) {
        self.report.real_time = u8::from(real_time);
        self.report.memory_locked = u8::from(memory_locked);
    }

    /// Counts the step of `boundary`, begun when the process had `woken` and ended when it was `done`.
    pub fn count_step(&mut self, boundary: Time, woken: Time, done: Time, dropped: u64) {
        self.wake_ns.saturating_record(woken.age_ns(boundary.ns()));
        self.step_ns.saturating_record(done.age_ns(woken.ns()));
        let r = &mut self.report;
        r.cycles += 1;
        r.dropped += dropped;
        let excess_ns = done.age_ns(boundary.ns()).saturating_sub(self.deadline_ns);
        r.overruns += u64::from(excess_ns > 0);
        if excess_ns > r.overrun_excess_ns {
            r.overrun_boundary_ns = boundary.ns();
            r.overrun_end_ns = done.age_ns(boundary.ns());
            r.overrun_excess_ns = excess_ns;
        }
    }

    /// Counts boundaries that were missed and skipped.
    pub fn count_skipped(&mut self, boundaries: u64) {
        self.report.skipped += boundaries;
    }

    /// Ages of the inputs, to be filled in place.
    pub fn input_ages_mut(&mut self) -> &mut [u64; 8] {
        &mut self.report.input_age_ns
    }

    /// The report at `now`; the histograms and the latest step begin anew, the counts go on.
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
        let report = *r;
        (r.overrun_boundary_ns, r.overrun_end_ns, r.overrun_excess_ns) = (0, 0, 0);
        report
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::error::Error;

    #[test]
    fn a_report_tells_of_the_step_that_ended_latest_since_the_one_before() -> Result<(), Box<dyn Error>> {
        let schedule: Schedule = toml::from_str("name = \"base\"\nrate_hz = 100\ndeadline_us = 3000")?;
        let mut monitor = Monitor::new("base", &schedule, 1)?;
        for (boundary_ms, end_ms) in [(0, 2), (10, 14), (20, 29), (30, 34)] {
            let at = |ms: u64| Time::from_ns(ms * 1_000_000);
            monitor.count_step(at(boundary_ms), at(boundary_ms + 1), at(end_ms), 0);
        }
        let first = monitor.report(Time::from_ns(40_000_000));
        let told = (first.overruns, first.overrun_boundary_ns, first.overrun_end_ns, first.overrun_excess_ns);
        assert_eq!(told, (3, 20_000_000, 9_000_000, 6_000_000));
        let second = monitor.report(Time::from_ns(50_000_000));
        assert_eq!((second.overruns, second.overrun_boundary_ns), (3, 0), "counts go on, the latest step does not");
        Ok(())
    }
}
