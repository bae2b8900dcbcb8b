//! What the whole stack costs at its launch rates, and how old a measurement is when the valves hear of it.

use super::distribution::{Distribution, Percentiles};
use crate::run::stack::Stack;
use crate::run::{Measured, measured_flight};
use fss_bus::Bus;
use fss_messages::{NavState, ThrustersState, topic};
use fss_records::log::Log;
use miette::{IntoDiagnostic, Result, miette};
use serde::Serialize;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// What a flight has cost.
#[derive(Serialize)]
pub struct StackTimes {
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
}

/// Flies for `seconds`, firing, and measures.
pub fn measure(launch: Option<&Path>, seconds: f64) -> Result<StackTimes> {
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
        within_base_period: ages.within as f64 / ages.since_receipt.count().max(1) as f64,
    })
}

struct Ages {
    since_receipt: Distribution,
    since_event: Distribution,
    within: u64,
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
        let mut ages = Self { since_receipt: Distribution::new()?, since_event: Distribution::new()?, within: 0 };
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
            ages.within += u64::from(since_receipt_ns <= base_period_ns);
        }
        Ok(ages)
    }
}

impl StackTimes {
    /// The table for a person.
    pub fn print(&self) {
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
    }
}
