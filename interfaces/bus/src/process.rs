//! A service as a process: an absolute-time loop at the launch file's rate.
//!
//! Boundaries are the multiples of the period on the monotonic clock, plus the phase: since all processes of a host
//! share that clock, phases order the services of a stack without any process waiting for another. A boundary
//! that was missed is skipped and counted, never made up in a burst. A service that follows a device may have two phases
//! to choose from ([`Run::waited_ns`]).

use crate::health::{Monitor, REPORT_PERIOD_NS};
use crate::launch::Schedule;
use crate::phase::Phase;
use crate::realtime::{self, Privileges};
use crate::{Bus, BusError, Output, OutputPort, Run, Time};
use fss_messages::{Event, text, topic};
use std::sync::atomic::{AtomicBool, Ordering};

/// Runs the service until `stop` is set. `starts` counts how often it has been started in this run; `after_step` is the
/// service's own device output where that cannot wait for a thread.
///
/// # Errors
/// Where the clock cannot be read or a port not be opened.
pub fn run(
    runner: &mut impl Run,
    bus: &Bus,
    schedule: &Schedule,
    starts: u32,
    stop: &AtomicBool,
    mut after_step: impl FnMut(),
) -> Result<Privileges, BusError> {
    let mut health = Output::open(bus, topic::HEALTH)?;
    let mut events = Output::open(bus, topic::EVENTS)?;
    let mut monitor = Monitor::new(runner.name(), schedule, starts)?;
    let granted = realtime::enter(schedule);
    monitor.set_privileges(granted.real_time, granted.memory_locked);
    announce(runner.name(), &mut events, &granted, starts, realtime::now()?);

    let period_ns = schedule.period_ns();
    let mut phase = Phase::of(schedule);
    // What waited while the process was starting is stale: each input begins with its newest sample.
    runner.refresh();
    // Before the service's own first word: its events are counted anew from then on, and none seems to be missing.
    events.flush(realtime::now()?);
    let mut boundary = next_boundary(realtime::now()?, period_ns, phase.ns());
    let mut next_report_ns = boundary.ns();
    while !stop.load(Ordering::Relaxed) {
        realtime::sleep_until(boundary);
        let woken = realtime::now()?;
        if woken < boundary {
            continue; // a signal woke us
        }
        runner.step(boundary);
        after_step();
        let dropped = runner.flush(realtime::now()?);
        let done = realtime::now()?;
        monitor.count_step(boundary, woken, done, dropped);
        if done.ns() >= next_report_ns {
            runner.ages_ns(boundary, monitor.input_ages_mut());
            health.publish(monitor.report(done));
            health.flush(done);
            events.flush(done); // says nothing more, but lets go of readers that died
            next_report_ns = done.ns() + REPORT_PERIOD_NS;
        }
        phase.note(runner.waited_ns());
        let following = next_boundary(boundary, period_ns, phase.ns());
        boundary = if done < following { following } else { next_boundary(done, period_ns, phase.ns()) };
        monitor.count_skipped((boundary.ns() - following.ns()) / period_ns);
    }
    if runner.takes_the_last() {
        let now = realtime::now()?;
        runner.step(now);
        runner.flush(now);
    }
    Ok(granted)
}

/// The first boundary after `now`.
fn next_boundary(now: Time, period_ns: u64, phase_ns: u64) -> Time {
    let since_phase = now.ns().saturating_sub(phase_ns);
    Time::from_ns((since_phase / period_ns + 1) * period_ns + phase_ns)
}

fn announce(name: &str, events: &mut Output<Event>, granted: &Privileges, starts: u32, now: Time) {
    let mut say = |severity: u8, message: &str| {
        let (service, text) = (text(name), text(message));
        events.publish(Event { stamp_ns: now.ns(), severity, service, text, ..Event::default() });
    };
    say(Event::INFO, if starts > 1 { "restarted" } else { "started" });
    for missing in &granted.missing {
        say(Event::WARNING, &format!("runs without {missing}"));
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::{Runner, Service};

    crate::inputs! {
        struct Inputs {
            events: crate::Batch<Event> = topic::EVENTS,
        }
    }

    crate::outputs! {
        struct Outputs {
            events: Output<Event> = topic::EVENTS,
        }
    }

    struct Listener(Vec<u64>);

    impl Service for Listener {
        type Inputs = Inputs;
        type Outputs = Outputs;
        const NAME: &'static str = "listener";
        const TAKES_THE_LAST: bool = true;

        fn step(&mut self, _now: Time, inputs: &Inputs, _outputs: &mut Outputs) {
            self.0.extend(inputs.events.samples().iter().map(|event| event.stamp_ns));
        }
    }

    #[test]
    fn what_comes_between_the_last_step_and_the_end_is_taken() {
        let bus = Bus::local();
        let mut runner = Runner::new(Listener(Vec::new()), &bus).unwrap();
        let mut events = Output::open(&bus, topic::EVENTS).unwrap();
        let schedule: Schedule = toml::from_str("name = \"listener\"\nrate_hz = 100.0").unwrap();
        let stop = AtomicBool::new(false);
        let after_step = || {
            events.publish(Event { stamp_ns: 7, ..Event::default() });
            events.flush(Time::from_ns(7));
            stop.store(true, Ordering::Relaxed);
        };
        run(&mut runner, &bus, &schedule, 1, &stop, after_step).unwrap();
        assert_eq!(runner.service.0.last(), Some(&7));
    }

    #[test]
    fn boundaries_are_the_multiples_of_the_period_plus_the_phase() {
        let next = |now| next_boundary(Time::from_ns(now), 1000, 300).ns();
        assert_eq!(next(0), 1300);
        assert_eq!(next(1299), 1300);
        assert_eq!(next(1300), 2300);
        assert_eq!(next(7_000), 7_300);
    }
}
