//! Where the joints are between their reports.
//!
//! A report is some tenths of a second old and its rate is noisy, so to extrapolate it by that rate would make things
//! worse. But the joints follow a reference that is known exactly: where they are is the reference now plus how far they
//! were from it when they were measured, which changes slowly and can be smoothed.

use fss_bus::Time;
use fss_messages::LinksState;
use fss_multibody::{JointVector, MAX_LINKS};

/// Steps of the reference that are remembered; reports older than these are compared with the oldest.
const REMEMBERED: usize = 64;
/// Share of a new report in the smoothed lag.
const BLEND: f64 = 0.5;

/// Remembers the reference, and how far each joint is from it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tracker {
    /// Times ns and reference angles, the next to be overwritten at `next`.
    past: [(u64, JointVector); REMEMBERED],
    next: usize,
    lag_rad: JointVector,
    /// When each joint's last report was measured, ns; zero before the first.
    measured_ns: [u64; MAX_LINKS],
}

impl Default for Tracker {
    fn default() -> Self {
        let past = [(0, JointVector::zeros()); REMEMBERED];
        Self { past, next: 0, lag_rad: JointVector::zeros(), measured_ns: [0; MAX_LINKS] }
    }
}

impl Tracker {
    /// Remembers the reference of this step.
    pub(crate) fn remember(&mut self, now: Time, q_ref_rad: &JointVector) {
        self.past[self.next] = (now.ns(), *q_ref_rad);
        self.next = (self.next + 1) % REMEMBERED;
    }

    /// The reference of joint `i` was put to `q_rad`: as far as it matters, it was always there.
    pub(crate) fn restart(&mut self, i: usize, q_rad: f64) {
        for (_, past) in &mut self.past {
            past[i] = q_rad;
        }
        self.lag_rad[i] = 0.0;
        self.measured_ns[i] = 0;
    }

    /// Joint angles now, where the reference is `q_ref_rad`.
    pub(crate) fn angles(&mut self, links: &LinksState, q_ref_rad: &JointVector) -> JointVector {
        for i in 0..(links.link_count as usize).min(MAX_LINKS) {
            let measured_ns = links.measured_ns[i];
            if measured_ns == self.measured_ns[i] {
                continue;
            }
            let lag = links.measured_q_rad[i] - self.reference_at(measured_ns, i);
            let blend = if self.measured_ns[i] == 0 { 1.0 } else { BLEND };
            self.lag_rad[i] += (lag - self.lag_rad[i]) * blend;
            self.measured_ns[i] = measured_ns;
        }
        q_ref_rad + self.lag_rad
    }

    /// The remembered reference of joint `i` at `time_ns`, between two steps on the line that joins them.
    fn reference_at(&self, time_ns: u64, i: usize) -> f64 {
        let newest_first = (1..=REMEMBERED).map(|back| &self.past[(self.next + REMEMBERED - back) % REMEMBERED]);
        let mut after: Option<&(u64, JointVector)> = None;
        for entry in newest_first {
            if entry.0 <= time_ns {
                return after.map_or(entry.1[i], |after| {
                    let share = (time_ns - entry.0) as f64 / (after.0 - entry.0).max(1) as f64;
                    entry.1[i] + (after.1[i] - entry.1[i]) * share
                });
            }
            after = Some(entry);
        }
        after.map_or(0.0, |oldest| oldest.1[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_NS: u64 = 20_000_000;

    /// A joint that follows its reference `slow` behind and is reported now and then.
    fn report(q_rad: f64, measured_ns: u64) -> LinksState {
        let mut links = LinksState { link_count: 1, ..LinksState::default() };
        (links.measured_q_rad[0], links.measured_ns[0]) = (q_rad, measured_ns);
        links
    }

    #[test]
    fn an_old_report_and_the_reference_tell_where_a_joint_is() {
        let mut tracker = Tracker::default();
        let reference = |time_ns: u64| JointVector::repeat(0.3 + 0.05 * time_ns as f64 * 1e-9);
        let offset = 0.002;
        for step in 1..200 {
            let now_ns = step * STEP_NS;
            tracker.remember(Time::from_ns(now_ns), &reference(now_ns));
            if step < 10 {
                continue;
            }
            // Reported each 200 ms, 130 ms old.
            let measured_ns = (step / 10 * 10) * STEP_NS - 130_000_000;
            let links = report(reference(measured_ns)[0] + offset, measured_ns);
            let angle = tracker.angles(&links, &reference(now_ns))[0];
            assert!((angle - reference(now_ns)[0] - offset).abs() < 1e-12, "step {step}");
        }
    }

    #[test]
    fn noise_of_reports_is_smoothed_and_a_new_reference_starts_afresh() {
        let mut tracker = Tracker::default();
        let still = JointVector::zeros();
        let mut angles = (1..50).map(|n: u64| {
            tracker.remember(Time::from_ns(n * STEP_NS), &still);
            tracker.angles(&report(if n.is_multiple_of(2) { 1e-3 } else { -1e-3 }, n * STEP_NS), &still)[0]
        });
        assert!(angles.by_ref().skip(10).all(|angle| angle.abs() < 0.4e-3));
        drop(angles);
        tracker.restart(0, 0.7);
        let moved = JointVector::repeat(0.7);
        assert!((tracker.angles(&report(0.701, 60 * STEP_NS), &moved)[0] - 0.701).abs() < 1e-12);
    }
}
