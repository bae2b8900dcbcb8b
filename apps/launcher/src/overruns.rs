//! Why a step ended late: the host, a blow, a start, or nothing that is known.

use crate::witness::Late;
use fss_bus::realtime;
use serde::Serialize;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// The watch wakes so often, ns: what makes the fastest loop (1 kHz) late lies across two of its wakes at least.
const WATCH_PERIOD_NS: u64 = 250_000;
/// A watch that wakes so much later was held up by the host: nothing on the core has a higher priority. The host may hold
/// a core up in many bits: each counts, and their sum tells.
const HELD_UP_NS: u64 = 100_000;
/// Above all services.
const WATCH_PRIORITY: u8 = 98;
/// How long a process that died, starts or joins may disturb the others: it maps memory, they map its.
const DISTURBED_NS: u64 = 1_500_000_000;

/// How many overruns each cause explains.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Causes {
    /// Between the step's boundary and its end the host held its core up, seen by a bare loop of the highest priority,
    /// for as long as the step ended after its deadline, but for what the loop cannot see.
    pub host_stalled: u64,
    /// The same for half as long at least: of bits that are shorter than its period the loop sees only some, and what the
    /// host delays delays others.
    pub host_stalled_in_part: u64,
    /// A process had just been killed or frozen, or came back.
    pub blow: u64,
    /// The stack had just been started.
    pub start: u64,
    /// The service runs under normal scheduling, beside whatever else the host does.
    pub normal_scheduling: u64,
    /// None of these.
    pub unexplained: u64,
}

/// Steps that ended late for no reason that is known, between two reports of their service.
#[derive(Debug, Serialize)]
pub(crate) struct Unexplained {
    service: String,
    count: u64,
    /// When the report that counts them came, from the start of the stack, s.
    at_s: f64,
    /// Of the one that ended latest: how long after its boundary, ms.
    ended_ms: f64,
    /// How long after its deadline, ms.
    excess_ms: f64,
    /// How long the host had held its core up between the two, ms.
    held_up_ms: f64,
}

/// What is known of a flight's disturbances.
#[derive(Default)]
pub(crate) struct Disturbances {
    /// When the host held a core up: core, from, to, ns.
    held_up: Mutex<Vec<(usize, u64, u64)>>,
    /// When processes were struck, ns.
    blows_ns: Mutex<Vec<u64>>,
}

impl Disturbances {
    /// Notes when the host does not run a loop of the highest priority on `core`, until `stop`.
    pub(crate) fn watch(&self, core: usize, stop: &AtomicBool) {
        let _unpinned_where_refused = realtime::pin_to_core(core);
        let _late_itself_where_refused = realtime::set_fifo_priority(WATCH_PRIORITY);
        let Ok(mut next) = realtime::now() else { return };
        while !stop.load(Ordering::Relaxed) {
            next = next.plus_ns(WATCH_PERIOD_NS);
            realtime::sleep_until(next);
            let Ok(woken) = realtime::now() else { return };
            if woken.age_ns(next.ns()) > HELD_UP_NS {
                self.held_up.lock().unwrap_or_else(PoisonError::into_inner).push((core, next.ns(), woken.ns()));
            }
            if woken.age_ns(next.ns()) > WATCH_PERIOD_NS {
                next = woken; // not in a burst
            }
        }
    }

    /// How long the host held up the core, any where absent, between two times, ns.
    fn held_up_ns(&self, core: Option<usize>, (from_ns, to_ns): (u64, u64)) -> u64 {
        let held_up = self.held_up.lock().unwrap_or_else(PoisonError::into_inner);
        let here = held_up.iter().filter(|(on, ..)| core.is_none_or(|core| core == *on));
        here.map(|(_, from, to)| to.min(&to_ns).saturating_sub(*from.max(&from_ns))).sum()
    }

    /// A process was struck at this time, ns.
    pub(crate) fn note_blow(&self, at_ns: u64) {
        self.blows_ns.lock().unwrap_or_else(PoisonError::into_inner).push(at_ns);
    }

    /// Finds the cause of late steps of a service of this core and priority; `start_ns` is when the stack was started.
    /// Returns them where there is none.
    pub(crate) fn explain(
        &self,
        late: &Late,
        (core, priority): (Option<usize>, Option<u8>),
        start_ns: u64,
        causes: &mut Causes,
    ) -> Option<Unexplained> {
        let held_up_ns = self.held_up_ns(core, (late.boundary_ns, late.boundary_ns + late.end_ns));
        let blows_ns = self.blows_ns.lock().unwrap_or_else(PoisonError::into_inner);
        let struck = blows_ns.iter().any(|at| *at <= late.to_ns && at + DISTURBED_NS >= late.from_ns);
        // What is held up begins up to a period of the watch before the watch can be late.
        let unseen_ns = held_up_ns.min(WATCH_PERIOD_NS);
        let cause = if held_up_ns + unseen_ns >= late.excess_ns {
            &mut causes.host_stalled
        } else if 2 * held_up_ns >= late.excess_ns {
            &mut causes.host_stalled_in_part
        } else if late.from_ns < start_ns + DISTURBED_NS {
            &mut causes.start
        } else if struck {
            &mut causes.blow
        } else if priority.is_none() {
            &mut causes.normal_scheduling
        } else {
            causes.unexplained += late.count;
            return Some(Unexplained {
                service: late.service.clone(),
                count: late.count,
                at_s: late.to_ns.saturating_sub(start_ns) as f64 * 1e-9,
                ended_ms: late.end_ns as f64 * 1e-6,
                excess_ms: late.excess_ns as f64 * 1e-6,
                held_up_ms: held_up_ns as f64 * 1e-6,
            });
        };
        *cause += late.count;
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of the base that ended 5 ms after its boundary, 2 ms after its deadline.
    fn late(boundary_ns: u64) -> Late {
        let (from_ns, to_ns) = (boundary_ns - 100_000_000, boundary_ns + 100_000_000);
        Late {
            service: "base".to_owned(),
            from_ns,
            to_ns,
            count: 1,
            boundary_ns,
            end_ns: 5_000_000,
            excess_ns: 2_000_000,
        }
    }

    const PLACE: (Option<usize>, Option<u8>) = (Some(0), Some(80));

    #[test]
    fn an_overrun_is_unexplained_only_where_nothing_happened() {
        let disturbances = Disturbances::default();
        disturbances.held_up.lock().unwrap_or_else(PoisonError::into_inner).push((0, 20_001_000_000, 20_003_000_000));
        disturbances.note_blow(30_000_000_000);
        let mut causes = Causes::default();
        let mut unexplained = Vec::new();
        for at_s in [1, 10, 20, 31, 40] {
            unexplained.extend(disturbances.explain(&late(at_s * 1_000_000_000), PLACE, 0, &mut causes));
        }
        let counts = (causes.start, causes.host_stalled, causes.blow, causes.unexplained, causes.normal_scheduling);
        assert_eq!(counts, (1, 1, 1, 2, 0));
        let told: Vec<_> = unexplained.iter().map(|u| (format!("{:.1} s", u.at_s), u.ended_ms, u.held_up_ms)).collect();
        assert_eq!(told, [("10.1 s".to_owned(), 5.0, 0.0), ("40.1 s".to_owned(), 5.0, 0.0)]);
    }

    #[test]
    fn the_host_explains_what_it_took_from_the_step_itself_and_no_more() {
        // How much it explains (nothing, a part, all) where it held cores up while the step of 5 s was on its way, us after its boundary.
        let explained = |held_up: &[(usize, i64, i64)]| {
            let disturbances = Disturbances::default();
            let at = |us: i64| (5_000_000 + us) as u64 * 1000;
            let held_up = held_up.iter().map(|(core, from, to)| (*core, at(*from), at(*to)));
            disturbances.held_up.lock().unwrap_or_else(PoisonError::into_inner).extend(held_up);
            let mut causes = Causes::default();
            disturbances.explain(&late(5_000_000_000), PLACE, 0, &mut causes);
            2 * causes.host_stalled + causes.host_stalled_in_part
        };
        let (nothing, part, all) = (0, 1, 2);
        assert_eq!(explained(&[(0, 1000, 3000)]), all, "as long as it was late");
        assert_eq!(explained(&[(0, 1000, 2760)]), all, "that long, and it began before the watch could see it");
        assert_eq!(explained(&[(0, 100, 800), (0, 1000, 1700), (0, 2000, 2600)]), all, "in bits");
        assert_eq!(explained(&[(0, -500, 2000)]), all, "from before");
        assert_eq!(explained(&[(0, 1000, 2100)]), part, "half as long");
        assert_eq!(explained(&[(0, 1000, 1900)]), nothing, "too short");
        assert_eq!(explained(&[(0, -2000, 800)]), nothing, "mostly before");
        assert_eq!(explained(&[(0, 4700, 9000)]), nothing, "mostly when it had ended");
        assert_eq!(explained(&[(1, 1000, 3000)]), nothing, "on the other core");
    }
}
