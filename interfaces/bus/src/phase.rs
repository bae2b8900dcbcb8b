//! Which of the launch file's two phases a service steps at: a camera runs free, and at one of the two its measurements
//! wait less.

use crate::launch::Schedule;

/// Steps over which long waits are counted together.
const JUDGED_STEPS: u32 = 100;
/// Measurements that may wait long meanwhile: a network holds one up now and then.
const FEW: u32 = 2;

/// The phase of a service.
pub(crate) struct Phase {
    /// The phase that is stepped at, and the other one; the same where there is none, ns.
    phases_ns: [u64; 2],
    /// What waits longer than this might wait less for the other phase, ns. Three quarters of the period: where two phases lie half
    /// a period apart, one at least stays below it, and what is at the edge does not come and go.
    long_ns: u64,
    steps: u32,
    long_waits: u32,
    /// So many of them are let pass: none at first, when nothing speaks for the phase at which a service happens to begin.
    few: u32,
}

impl Phase {
    /// Begins with the schedule's first.
    pub(crate) fn of(schedule: &Schedule) -> Self {
        let first_ns = schedule.phase_ns();
        let phases_ns = [first_ns, schedule.other_phase_ns().unwrap_or(first_ns)];
        Self { phases_ns, long_ns: schedule.period_ns() / 4 * 3, steps: 0, long_waits: 0, few: 0 }
    }

    /// The phase that is stepped at, ns.
    pub(crate) fn ns(&self) -> u64 {
        self.phases_ns[0]
    }

    /// Takes note of how long the measurement that came with a step had waited for it, ns; changes over where too many waited
    /// long, as soon as they have.
    pub(crate) fn note(&mut self, waited_ns: Option<u64>) {
        self.steps += 1;
        self.long_waits += u32::from(waited_ns.is_some_and(|waited_ns| waited_ns > self.long_ns));
        let too_many = self.long_waits > self.few;
        if too_many {
            self.phases_ns.reverse();
        }
        if too_many || self.steps == JUDGED_STEPS {
            (self.steps, self.long_waits, self.few) = (0, 0, FEW);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::launch::Launch;

    const PERIOD_NS: u64 = 10_000_000;

    fn schedule(other: &str) -> Option<Schedule> {
        let text = format!(
            "[devices]\nvicon = '127.0.0.1:1'\ngyro = '-'\nvalves = '-'\nlinks_local = '127.0.0.1:1'\nlinks = []\n\
             [[service]]\nname = 'base'\nrate_hz = 100\nphase_us = 1500\n{other}"
        );
        Launch::parse(&text, &["base"]).ok()?.schedule("base").cloned()
    }

    /// How long a measurement waits that is received so late in each period and read every 5 ms, from 0.5 ms on, by what
    /// the service reads at its phase.
    fn waited_ns(received_ns: u64, phase_ns: u64) -> u64 {
        let read_ns = (received_ns.saturating_sub(500_000)).div_ceil(5_000_000) * 5_000_000 + 500_000;
        (phase_ns + 2 * PERIOD_NS - read_ns) % PERIOD_NS + read_ns - received_ns
    }

    #[test]
    fn whenever_a_camera_looks_its_measurements_wait_less_than_a_period() {
        for received_ns in (0..PERIOD_NS).step_by(100_000) {
            let mut phase = Phase::of(&schedule("other_phase_us = 6500").unwrap());
            phase.note(Some(waited_ns(received_ns, phase.ns())));
            let settled_ns = phase.ns();
            for _ in 0..10 * JUDGED_STEPS {
                assert!(waited_ns(received_ns, phase.ns()) <= PERIOD_NS / 4 * 3, "received at {received_ns} ns");
                phase.note(Some(waited_ns(received_ns, phase.ns())));
                assert_eq!(phase.ns(), settled_ns, "a phase that serves is kept");
            }
        }
    }

    #[test]
    fn a_few_that_a_network_held_up_change_nothing_and_more_do() {
        let mut phase = Phase::of(&schedule("other_phase_us = 6500").unwrap());
        for _ in 0..JUDGED_STEPS {
            phase.note(Some(4_000_000));
        }
        for held_up in 1..=FEW {
            phase.note(Some(9_000_000));
            assert_eq!(phase.ns(), 1_500_000, "after {held_up}");
        }
        phase.note(Some(9_000_000));
        assert_eq!(phase.ns(), 6_500_000);
    }

    #[test]
    fn without_another_phase_or_without_measurements_the_first_is_kept() {
        for (other, waited) in [("", Some(9_000_000)), ("other_phase_us = 6500", None)] {
            let mut phase = Phase::of(&schedule(other).unwrap());
            for _ in 0..10 * JUDGED_STEPS {
                phase.note(waited);
                assert_eq!(phase.ns(), 1_500_000);
            }
        }
    }
}
