//! Watches a flying stack from outside, through its shared memory: how long valves stay open after their command.

use fss_bus::{Batch, Bus, InputPort, SharedConfig};
use fss_messages::{Health, MAX_THRUSTERS, ThrustersCommand, TruthState, text_of, topic};
use miette::{IntoDiagnostic, Result};
use std::collections::BTreeMap;

/// What a witness has seen.
#[derive(Clone, Debug, Default)]
pub struct Testimony {
    /// The longest that a valve was seen open after the last command that opened it, ns.
    pub open_after_ns: u64,
    /// The longest time between two signs of life of each service, ns.
    pub silent_ns: BTreeMap<String, u64>,
    /// Cycles and overruns of each start of each service.
    pub counts: BTreeMap<(String, u32), (u64, u64)>,
}

/// Watches; to be asked to look every few milliseconds.
pub struct Witness {
    commands: Batch<ThrustersCommand>,
    truth: Batch<TruthState>,
    health: Batch<Health>,
    commanded_ns: [u64; MAX_THRUSTERS],
    alive_ns: BTreeMap<String, u64>,
    /// What it has seen so far.
    pub seen: Testimony,
}

impl Witness {
    /// Joins a stack.
    ///
    /// # Errors
    /// Where shared memory refuses.
    pub fn join(prefix: &str, vehicle: &str) -> Result<Self> {
        let config = SharedConfig { node: "witness".to_owned(), prefix: prefix.to_owned() };
        let bus = Bus::shared(&config).into_diagnostic()?.for_vehicle(vehicle);
        Ok(Self {
            commands: Batch::open(&bus, topic::THRUSTERS_COMMAND).into_diagnostic()?,
            truth: Batch::open(&bus, topic::TRUTH_STATE).into_diagnostic()?,
            health: Batch::open(&bus, topic::HEALTH).into_diagnostic()?,
            commanded_ns: [0; MAX_THRUSTERS],
            alive_ns: BTreeMap::new(),
            seen: Testimony::default(),
        })
    }

    /// Takes what has come since the last look.
    pub fn look(&mut self) {
        self.truth.refresh();
        self.commands.refresh();
        self.health.refresh();
        for command in self.commands.samples() {
            for (at, &open) in self.commanded_ns.iter_mut().zip(&command.valves) {
                *at = if open == 0 { *at } else { command.published_ns };
            }
        }
        for truth in self.truth.samples() {
            let open = truth.valves.iter().zip(&self.commanded_ns).filter(|(valve, _)| **valve != 0);
            let after = open.map(|(_, at)| truth.stamp_ns.saturating_sub(*at)).max();
            self.seen.open_after_ns = self.seen.open_after_ns.max(after.unwrap_or(0));
        }
        for health in self.health.samples() {
            let service = text_of(&health.service).to_owned();
            let before = self.alive_ns.insert(service.clone(), health.stamp_ns).unwrap_or(health.stamp_ns);
            let silent = self.seen.silent_ns.entry(service.clone()).or_default();
            *silent = (*silent).max(health.stamp_ns.saturating_sub(before));
            self.seen.counts.insert((service, health.starts), (health.cycles, health.overruns));
        }
    }
}
