//! Why a step ended late: the host, a blow, a start, or nothing that is known.

use super::witness::Late;
use fss_bus::realtime;
use serde::Serialize;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// The watch wakes so often, ns: what makes the fastest loop (1 kHz) late lies across two of its wakes at least.
const WATCH_PERIOD_NS: u64 = 250_000;
/// A watch that wakes so much later was held up by the host: nothing on it has a higher priority.
const STALL_NS: u64 = 300_000;
/// Above all services.
const WATCH_PRIORITY: u8 = 98;
/// How long a process that died, starts or joins may disturb the others: it maps memory, they map its.
const DISTURBED_NS: u64 = 1_500_000_000;

/// How many overruns each cause explains.
#[derive(Debug, Default, Serialize)]
pub struct Causes {
    /// A bare loop of the highest priority on the same core was late too: the host did not run it.
    pub host_stalled: u64,
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
pub struct Unexplained {
    service: String,
    count: u64,
    /// When the report that counts them came, from the start of the stack, s.
    at_s: f64,
    /// The latest that a step of the report began, ms.
    late_ms_max: f64,
    /// The longest that one took, ms.
    step_ms_max: f64,
}

/// What is known of a flight's disturbances.
#[derive(Default)]
pub struct Disturbances {
    /// When the host stalled: core, from, to, ns.
    stalls: Mutex<Vec<(usize, u64, u64)>>,
    /// When processes were struck, ns.
    blows_ns: Mutex<Vec<u64>>,
}

impl Disturbances {
    /// Notes when the host does not run a loop of the highest priority on `core`, until `stop`.
    pub fn watch(&self, core: usize, stop: &AtomicBool) {
        let _unpinned_where_refused = realtime::pin_to_core(core);
        let _late_itself_where_refused = realtime::set_fifo_priority(WATCH_PRIORITY);
        let Ok(mut next) = realtime::now() else { return };
        while !stop.load(Ordering::Relaxed) {
            next = next.plus_ns(WATCH_PERIOD_NS);
            realtime::sleep_until(next);
            let Ok(woken) = realtime::now() else { return };
            if woken.age_ns(next.ns()) > STALL_NS {
                self.stalls.lock().unwrap_or_else(PoisonError::into_inner).push((core, next.ns(), woken.ns()));
                next = woken;
            }
        }
    }

    /// A process was struck at this time, ns.
    pub fn note_blow(&self, at_ns: u64) {
        self.blows_ns.lock().unwrap_or_else(PoisonError::into_inner).push(at_ns);
    }

    /// Finds the cause of late steps of a service of this core and priority; `start_ns` is when the stack was started.
    /// Returns them where there is none.
    pub fn explain(
        &self,
        late: &Late,
        (core, priority): (Option<usize>, Option<u8>),
        start_ns: u64,
        causes: &mut Causes,
    ) -> Option<Unexplained> {
        let stalls = self.stalls.lock().unwrap_or_else(PoisonError::into_inner);
        let stalled = stalls.iter().any(|(on, from_ns, to_ns)| {
            core.is_none_or(|core| core == *on) && *from_ns <= late.to_ns && *to_ns >= late.from_ns
        });
        let blows_ns = self.blows_ns.lock().unwrap_or_else(PoisonError::into_inner);
        let struck = blows_ns.iter().any(|at| *at <= late.to_ns && at + DISTURBED_NS >= late.from_ns);
        let cause = if stalled {
            &mut causes.host_stalled
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
                late_ms_max: late.wake_max_ns as f64 * 1e-6,
                step_ms_max: late.step_max_ns as f64 * 1e-6,
            });
        };
        *cause += late.count;
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_overrun_is_unexplained_only_where_nothing_happened() {
        let disturbances = Disturbances::default();
        disturbances.stalls.lock().unwrap_or_else(PoisonError::into_inner).push((0, 20_000_000_000, 20_001_000_000));
        disturbances.note_blow(30_000_000_000);
        let mut causes = Causes::default();
        let mut unexplained = Vec::new();
        for from_s in [0, 10, 20, 30, 40] {
            let from_ns = from_s * 1_000_000_000;
            let (service, to_ns) = ("base".to_owned(), from_ns + 200_000_000);
            let late = Late { service, from_ns, to_ns, count: 1, wake_max_ns: 3_000_000, step_max_ns: 0 };
            unexplained.extend(disturbances.explain(&late, (Some(0), Some(80)), 0, &mut causes));
        }
        let counts = (causes.start, causes.host_stalled, causes.blow, causes.unexplained, causes.normal_scheduling);
        assert_eq!(counts, (1, 1, 1, 2, 0));
        let told: Vec<_> = unexplained.iter().map(|u| (format!("{:.1} s", u.at_s), u.late_ms_max)).collect();
        assert_eq!(told, [("10.2 s".to_owned(), 3.0), ("40.2 s".to_owned(), 3.0)]);
    }
}
