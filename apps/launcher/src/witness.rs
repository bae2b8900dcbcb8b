//! Watches a flying stack from outside, through its shared memory: how long valves stay open after their command, and how
//! long services are missing.

use fss_bus::{Batch, Bus, InputPort, SharedConfig, realtime};
use fss_lab::TRUTH_PERIOD_NS;
use fss_messages::{Health, MAX_THRUSTERS, MissionState, ThrustersCommand, TruthState, text_of, topic};
use miette::{IntoDiagnostic, Result};
use std::collections::{BTreeMap, VecDeque};

/// What a witness has seen.
#[derive(Clone, Debug, Default)]
pub(crate) struct SafetyRecord {
    /// The longest that a valve was seen open after the last command that opened it, ns.
    pub open_after_ns: u64,
    /// The same, less the time in which the world stood still meanwhile: what its valves did while they could do anything, ns.
    pub open_while_running_ns: u64,
    /// Whether a valve was open when last seen.
    pub open: bool,
    /// The longest that the laboratory told no truth beyond its period: its world stood still, valves and all, ns.
    pub world_stood_still_ns: u64,
    /// The longest time without a sign of life of each service, from its last one or from the last blow upon it, ns.
    pub silent_ns: BTreeMap<String, u64>,
    /// Cycles and overruns of each start of each service.
    pub counts: BTreeMap<(String, u32), (u64, u64)>,
    /// Between which reports steps ended late.
    pub late: Vec<Late>,
}

/// Steps of a service that ended late, between two of its reports.
#[derive(Clone, Debug)]
pub(crate) struct Late {
    /// Whose.
    pub service: String,
    /// The report before, ns.
    pub from_ns: u64,
    /// The report that counts them, ns.
    pub to_ns: u64,
    /// How many.
    pub count: u64,
    /// Of the one that ended latest, its boundary, ns.
    pub boundary_ns: u64,
    /// How long after its boundary that one ended, ns.
    pub end_ns: u64,
    /// How long after its deadline, ns.
    pub excess_ns: u64,
}

/// The last command that opened a valve.
#[derive(Clone, Copy, Default)]
struct Opened {
    /// When, ns.
    at_ns: u64,
    /// How long the world had stood still in all by then, ns.
    stood_still_ns: u64,
}

/// Watches; to be asked to look every few milliseconds.
pub(crate) struct Witness {
    commands: Batch<ThrustersCommand>,
    truth: Batch<TruthState>,
    health: Batch<Health>,
    mission: Batch<MissionState>,
    /// When the mission ended, ns: its stack stops then, and nobody is missed.
    ended_ns: Option<u64>,
    /// When the truth was last told, ns.
    truth_ns: Option<u64>,
    /// Commands that the truth has not come to yet.
    pending: VecDeque<ThrustersCommand>,
    opened: [Opened; MAX_THRUSTERS],
    /// How long the world stood still in all, ns.
    stood_still_ns: u64,
    /// The last sign of life of each service, ns.
    pub alive_ns: BTreeMap<String, u64>,
    /// The last blow upon each service, ns.
    struck_ns: BTreeMap<String, u64>,
    /// What it has seen so far.
    pub seen: SafetyRecord,
}

impl Witness {
    /// Joins a stack.
    ///
    /// # Errors
    /// Where shared memory refuses.
    pub(crate) fn join(prefix: &str, vehicle: &str) -> Result<Self> {
        let config = SharedConfig { node: "witness".to_owned(), prefix: prefix.to_owned() };
        let bus = Bus::shared(&config).into_diagnostic()?.for_vehicle(vehicle);
        Ok(Self {
            commands: Batch::open(&bus, topic::THRUSTERS_COMMAND).into_diagnostic()?,
            truth: Batch::open(&bus, topic::TRUTH_STATE).into_diagnostic()?,
            health: Batch::open(&bus, topic::HEALTH).into_diagnostic()?,
            mission: Batch::open(&bus, topic::MISSION_STATE).into_diagnostic()?,
            ended_ns: None,
            truth_ns: None,
            pending: VecDeque::new(),
            opened: [Opened::default(); MAX_THRUSTERS],
            stood_still_ns: 0,
            alive_ns: BTreeMap::new(),
            struck_ns: BTreeMap::new(),
            seen: SafetyRecord::default(),
        })
    }

    /// Takes what has come since the last look.
    ///
    /// # Errors
    /// Where the clock cannot be read.
    pub(crate) fn look(&mut self) -> Result<()> {
        let now = realtime::now().into_diagnostic()?;
        self.truth.refresh();
        self.commands.refresh();
        self.health.refresh();
        self.mission.refresh();
        let has_ended = |m: &&MissionState| m.state == MissionState::DONE || m.state == MissionState::ABORTED;
        let ended_ns = self.mission.samples().iter().find(has_ended).map(|m| m.stamp_ns);
        self.ended_ns = self.ended_ns.or(ended_ns);
        let until_ns = self.ended_ns.unwrap_or(u64::MAX);
        self.pending.extend(self.commands.samples());
        for truth in self.truth.samples() {
            // The world tells its truth at this time at the latest, or it stands still from then on.
            let due_ns = self.truth_ns.replace(truth.stamp_ns).unwrap_or(truth.stamp_ns) + TRUTH_PERIOD_NS;
            let stood_still_ns = truth.stamp_ns.saturating_sub(due_ns);
            self.stood_still_ns += stood_still_ns;
            self.seen.world_stood_still_ns = self.seen.world_stood_still_ns.max(stood_still_ns);
            // In the order of their times, however late this looks: no later command excuses an open valve.
            while let Some(command) = self.pending.front().filter(|c| c.published_ns <= truth.stamp_ns) {
                let at_ns = command.published_ns;
                let still_to_come_ns = truth.stamp_ns.saturating_sub(at_ns.max(due_ns));
                let opened = Opened { at_ns, stood_still_ns: self.stood_still_ns - still_to_come_ns };
                for (last, &open) in self.opened.iter_mut().zip(&command.valves) {
                    *last = if open == 0 { *last } else { opened };
                }
                self.pending.pop_front();
            }
            let open = truth.valves.iter().zip(&self.opened).filter(|(valve, _)| **valve != 0);
            self.seen.open = false;
            for (_, opened) in open {
                let after_ns = truth.stamp_ns.saturating_sub(opened.at_ns);
                let running_ns = after_ns.saturating_sub(self.stood_still_ns - opened.stood_still_ns);
                self.seen.open = true;
                self.seen.open_after_ns = self.seen.open_after_ns.max(after_ns);
                self.seen.open_while_running_ns = self.seen.open_while_running_ns.max(running_ns);
            }
        }
        self.look_at_health(until_ns);
        for (service, alive_ns) in &self.alive_ns {
            let since = self.struck_ns.get(service).copied().unwrap_or(0).max(*alive_ns);
            if let Some(longest) = self.seen.silent_ns.get_mut(service) {
                *longest = now.ns().min(until_ns).saturating_sub(since).max(*longest);
            }
        }
        Ok(())
    }

    /// What services report of themselves: silences and overruns.
    fn look_at_health(&mut self, until_ns: u64) {
        for health in self.health.samples() {
            let service = text_of(&health.service).to_owned();
            let before = self.alive_ns.insert(service.clone(), health.stamp_ns).unwrap_or(health.stamp_ns);
            let since = before.max(self.struck_ns.get(&service).copied().unwrap_or(0));
            let longest = self.seen.silent_ns.entry(service.clone()).or_default();
            *longest = health.stamp_ns.min(until_ns).saturating_sub(since).max(*longest);
            let counts = (health.cycles, health.overruns);
            let last = self.seen.counts.insert((service.clone(), health.starts), counts).unwrap_or_default();
            let count = health.overruns.saturating_sub(last.1);
            if count > 0 {
                self.seen.late.push(Late {
                    service,
                    from_ns: before,
                    to_ns: health.stamp_ns,
                    count,
                    boundary_ns: health.overrun_boundary_ns,
                    end_ns: health.overrun_end_ns,
                    excess_ns: health.overrun_excess_ns,
                });
            }
        }
    }

    /// The service was killed or frozen now, perhaps while it was coming back from the blow before.
    ///
    /// # Errors
    /// Where the clock cannot be read.
    pub(crate) fn note_blow(&mut self, service: &str) -> Result<u64> {
        let now_ns = realtime::now().into_diagnostic()?.ns();
        self.struck_ns.insert(service.to_owned(), now_ns);
        Ok(now_ns)
    }
}
