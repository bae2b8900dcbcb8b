//! What the whole stack costs at its launch rates, and how old a measurement is when the valves hear of it.

use super::distribution::{Distribution, Percentiles};
use fss_bus::Bus;
use fss_launcher::measured::{Measured, measured_flight};
use fss_launcher::stack::Stack;
use fss_messages::{NavState, Step, ThrustersState, text_of, topic};
use fss_records::log::Log;
use miette::{IntoDiagnostic, Result, miette};
use serde::Serialize;
use std::collections::{BTreeMap, HashMap};
use std::ops::RangeInclusive;
use std::path::Path;

/// Late measurements that a person is told of; JSON has all.
const LATE_SHOWN: usize = 10;

/// What a flight has cost.
#[derive(Serialize)]
pub(crate) struct StackTimes {
    format: &'static str,
    seconds: f64,
    /// Share of one core, percent: of every process, of all, and of all without the simulated laboratory.
    core_percent: BTreeMap<String, f64>,
    core_percent_all: f64,
    core_percent_without_laboratory: f64,
    /// From the receipt of motion capture until the valve command that first uses it has left, ms.
    age_at_valves_ms: Percentiles,
    /// The same from the event itself: with the cameras' own latency.
    age_since_event_ms: Percentiles,
    commands: u64,
    base_period_ms: f64,
    /// Share of the commands whose measurement was received within one base period.
    within_base_period: f64,
    /// Those whose measurement was not.
    late: Vec<Late>,
}

/// A measurement that came late to the valves.
#[derive(Serialize)]
struct Late {
    /// When its command left, since the first valve command, s.
    at_s: f64,
    /// Since its receipt, ms.
    age_ms: f64,
    /// The step on its way that ended the longest after its boundary, and how long, ms.
    held_up_by: String,
    held_up_ms: f64,
}

/// Flies for `seconds`, firing, and measures.
pub(crate) fn measure(launch: Option<&Path>, seconds: f64) -> Result<StackTimes> {
    measured_flight(launch, seconds, |_| Ok(()), times)
}

fn times(stack: &Stack, flight: &Measured) -> Result<StackTimes> {
    let core_percent: BTreeMap<_, _> =
        flight.cpu_ns.iter().map(|(name, ns)| (name.clone(), *ns as f64 * 1e-7 / flight.seconds)).collect();
    let all: f64 = core_percent.values().sum();
    let base = stack.launch.schedule("base").ok_or_else(|| miette!("the launch file has no [[service]] base"))?;
    let ages = Ages::of(&Log::open(&flight.log).into_diagnostic()?, stack, base.period_ns())?;
    Ok(StackTimes {
        format: "fss-bench-stack/1",
        seconds: flight.seconds,
        core_percent_all: all,
        core_percent_without_laboratory: all - core_percent.get("lab").copied().unwrap_or(0.0),
        core_percent,
        age_at_valves_ms: ages.since_receipt.percentiles(1e-6),
        age_since_event_ms: ages.since_event.percentiles(1e-6),
        commands: ages.since_receipt.count(),
        base_period_ms: base.period_ns() as f64 * 1e-6,
        within_base_period: 1.0 - ages.late.len() as f64 / ages.since_receipt.count().max(1) as f64,
        late: ages.late,
    })
}

struct Ages {
    since_receipt: Distribution,
    since_event: Distribution,
    late: Vec<Late>,
}

impl Ages {
    /// A command carries the stamp of the navigation state it was computed from, and that the age of its motion capture.
    fn of(log: &Log, stack: &Stack, base_period_ns: u64) -> Result<Self> {
        let bus = Bus::local().for_vehicle(&stack.launch.vehicle);
        let nav = log.samples::<NavState>(&bus.full_name(topic::NAV_STATE.name)).into_diagnostic()?;
        let valves = log.samples::<ThrustersState>(&bus.full_name(topic::THRUSTERS_STATE.name)).into_diagnostic()?;
        let latency_ns = (stack.plant.sensors.mocap_latency_s * 1e9).round() as u64;
        let seen_ns: HashMap<u64, u64> =
            nav.iter().map(|nav| (nav.stamp_ns, nav.stamp_ns.saturating_sub(nav.mocap_age_ns))).collect();
        let steps = log.samples::<Step>(&bus.full_name(topic::STEPS.name)).into_diagnostic()?;
        let mut ages =
            Self { since_receipt: Distribution::new()?, since_event: Distribution::new()?, late: Vec::new() };
        let first_ns = valves.first().map_or(0, |state| state.published_ns);
        let mut last_ns = 0;
        for state in valves.iter().filter(|state| state.mode == ThrustersState::ACTIVE) {
            // A measurement counts once, with the first command that knows it.
            let Some(&event_ns) = seen_ns.get(&state.command_stamp_ns).filter(|event_ns| **event_ns > last_ns) else {
                continue;
            };
            last_ns = event_ns;
            let since_event_ns = state.published_ns.saturating_sub(event_ns);
            let since_receipt_ns = since_event_ns.saturating_sub(latency_ns);
            ages.since_event.record(since_event_ns);
            ages.since_receipt.record(since_receipt_ns);
            if since_receipt_ns > base_period_ns {
                let at_s = state.published_ns.saturating_sub(first_ns) as f64 * 1e-9;
                let way_ns = state.published_ns - since_receipt_ns..=state.published_ns;
                ages.late.push(Late::of(&steps, way_ns, at_s, since_receipt_ns as f64 * 1e-6));
            }
        }
        Ok(ages)
    }
}

impl Late {
    /// Which of the steps that ended on its way held a measurement up.
    fn of(steps: &[Step], way_ns: RangeInclusive<u64>, at_s: f64, age_ms: f64) -> Self {
        const ON_ITS_WAY: [&str; 3] = ["fusion", "base", "thrusters"];
        let ended = steps.iter().filter(|step| way_ns.contains(&step.published_ns));
        let on_its_way = ended.filter(|step| ON_ITS_WAY.contains(&text_of(&step.service)));
        let behind_ns = |step: &&Step| step.published_ns.saturating_sub(step.stamp_ns);
        let worst = on_its_way.max_by_key(behind_ns);
        let held_up_by = worst.map_or_else(String::new, |step| text_of(&step.service).to_owned());
        Self { at_s, age_ms, held_up_by, held_up_ms: worst.map_or(0.0, |step| behind_ns(&step) as f64 * 1e-6) }
    }
}

impl StackTimes {
    /// The table for a person.
    pub(crate) fn print(&self) {
        for (name, percent) in &self.core_percent {
            say!("{name:<16} {percent:>8.2} % of one core");
        }
        say!("{:<16} {:>8.2} %", "all", self.core_percent_all);
        say!("{:<16} {:>8.2} %", "without lab", self.core_percent_without_laboratory);
        for (what, age) in [("receipt", &self.age_at_valves_ms), ("event", &self.age_since_event_ms)] {
            say!(
                "a measurement's age at the valves since its {what:<8} {:.2} ms at the median, {:.2} at the 99th percentile, \
                 {:.2} at most",
                age.p50,
                age.p99,
                age.max
            );
        }
        say!("{:.1} % within the base's period of {} ms", self.within_base_period * 100.0, self.base_period_ms);
        for Late { at_s, age_ms, held_up_by, held_up_ms } in self.late.iter().take(LATE_SHOWN) {
            say!(
                "  at {at_s:.2} s: {age_ms:.1} ms; on its way {held_up_by} was done {held_up_ms:.1} ms after its boundary"
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fss_messages::text;

    #[test]
    fn a_late_measurement_is_told_with_the_step_that_held_it_up() {
        let step = |service: &str, boundary_ms: u64, done_ms: u64| Step {
            service: text(service),
            stamp_ns: boundary_ms * 1_000_000,
            published_ns: done_ms * 1_000_000,
            ..Step::default()
        };
        let steps = [
            step("fusion", 0, 90), // before the measurement came
            step("fusion", 105, 106),
            step("base", 107, 119),
            step("recorder", 100, 119), // nothing waits for it
            step("thrusters", 118, 120),
        ];
        let late = Late::of(&steps, 100_000_000..=120_000_000, 3.5, 20.0);
        assert_eq!((late.held_up_by.as_str(), late.held_up_ms), ("base", 12.0));
        let alone = Late::of(&[], 100_000_000..=120_000_000, 3.5, 20.0);
        assert_eq!((alone.held_up_by.as_str(), alone.held_up_ms), ("", 0.0));
    }
}
