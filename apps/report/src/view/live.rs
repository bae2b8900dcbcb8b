//! The running stack: samples from the bus, 30 times a second, to whoever looks.

use super::frame::{EventRow, HealthRow, OTHER_PERIOD_NS, OtherRow, Samples, Stage};
use super::server::Stream;
use crate::top::{folder_of, only_stack};
use clap::Args;
use fss_bus::{Batch, Bus, InputPorts, Latest, RawBatch, RawTopic, SharedConfig, Time, inputs, realtime};
use fss_launcher::stack::Stack;
use fss_messages::{
    ArmCommand, Event, Header, Health, LinksState, MissionState, MocapPose, NavState, ThrustersState, TruthState, topic,
};
use fss_plant::scene::mask;
use fss_service::topics_of;
use miette::{IntoDiagnostic, Result, miette};
use serde::Serialize;
use std::path::PathBuf;

/// Which stack.
#[derive(Args)]
pub(super) struct StackArgs {
    /// Prefix of the stack in shared memory; that of the only stack that runs where absent.
    #[arg(long, conflicts_with = "log")]
    bus: Option<String>,
    /// Folder of the run, for the shape of the vehicle; that of the stack's processes where absent.
    #[arg(long, value_name = "DIR", conflicts_with = "log")]
    run: Option<PathBuf>,
}

/// Between two pictures, ns.
const PERIOD_NS: u64 = 33_333_333;

inputs! {
    struct Ports {
        truth: Latest<TruthState> = topic::TRUTH_STATE,
        nav: Latest<NavState> = topic::NAV_STATE,
        arm: Latest<ArmCommand> = topic::ARM_COMMAND,
        links: Latest<LinksState> = topic::LINKS_STATE,
        mission: Latest<MissionState> = topic::MISSION_STATE,
        target: Batch<MocapPose> = topic::MOCAP_TARGET,
        valves: Batch<ThrustersState> = topic::THRUSTERS_STATE,
    }
}

inputs! {
    struct Reports {
        health: Batch<Health> = topic::HEALTH,
        events: Batch<Event> = topic::EVENTS,
    }
}

/// A topic of a service from elsewhere.
struct Other {
    topic: RawTopic,
    batch: RawBatch,
    /// When its last row was of, ns.
    told_ns: u64,
}

impl Other {
    fn open(bus: &Bus, topic: &RawTopic) -> Result<Self> {
        let batch = RawBatch::open(bus, topic, Batch::<Event>::CAPACITY).into_diagnostic()?;
        Ok(Self { topic: topic.clone(), batch, told_ns: 0 })
    }

    /// Its newest sample, now and then.
    fn row(&mut self, seconds: impl Fn(u64) -> f64) -> Option<OtherRow> {
        let sample = self.batch.samples().last()?;
        let stamp_ns = Header::of_sample(sample)?.stamp_ns;
        (stamp_ns.abs_diff(self.told_ns) >= OTHER_PERIOD_NS).then(|| {
            self.told_ns = stamp_ns;
            OtherRow::of(seconds(stamp_ns), &self.topic.name, &self.topic.definition, sample)
        })
    }
}

/// A reader beside a flying stack.
pub(super) struct Watch {
    stage: Stage,
    ports: Ports,
    reports: Reports,
    others: Vec<Other>,
    /// The target as it was last seen.
    seen: Option<MocapPose>,
    /// Lives as long as its ports.
    _bus: Bus,
}

impl Watch {
    /// Joins a stack as a reader.
    ///
    /// # Errors
    /// Where no stack runs, or which is not clear, or shared memory refuses.
    pub(super) fn join(args: &StackArgs) -> Result<Self> {
        let prefix = args.bus.clone().map_or_else(only_stack, Ok)?;
        let folder = args.run.clone().or_else(|| folder_of(&prefix)).ok_or_else(|| {
            miette!(help = "name it with --run", "no process of the stack '{prefix}' tells the folder of its run")
        })?;
        let stack = Stack::in_folder(&folder)?;
        let config = SharedConfig { node: "view".to_owned(), prefix };
        let bus = Bus::shared(&config).into_diagnostic()?.for_vehicle(&stack.launch.vehicle);
        let bus = bus.with_program_topics(topics_of(&stack.programs)?);
        let (ports, reports) = (Ports::open(&bus).into_diagnostic()?, Reports::open(&bus).into_diagnostic()?);
        let others = bus.program_topics().iter().map(|topic| Other::open(&bus, topic)).collect::<Result<_>>()?;
        Ok(Self { stage: Stage::of(stack)?, ports, reports, others, seen: None, _bus: bus })
    }

    /// What does not change, as the page wants it.
    ///
    /// # Errors
    /// As [`Stage::json`].
    pub(super) fn scene_json(&self) -> Result<String> {
        self.stage.json(true)
    }

    /// Reads and tells, for ever.
    ///
    /// # Errors
    /// Where the clock cannot be read.
    pub(super) fn run(mut self, stream: &Stream) -> Result<()> {
        let zero_ns = realtime::now().into_diagnostic()?.ns();
        let mut next = Time::from_ns(zero_ns);
        loop {
            next = next.plus_ns(PERIOD_NS);
            realtime::sleep_until(next);
            let now = realtime::now().into_diagnostic()?;
            if now.age_ns(next.ns()) > PERIOD_NS {
                next = now; // this computer was busy: no burst makes up for it
            }
            self.ports.refresh();
            self.reports.refresh();
            self.others.iter_mut().for_each(|other| other.batch.refresh());
            self.tell(stream, |ns| (i128::from(ns) - i128::from(zero_ns)) as f64 * 1e-9)?;
        }
    }

    fn tell(&mut self, stream: &Stream, seconds: impl Fn(u64) -> f64) -> Result<()> {
        let ports = &self.ports;
        let seen = ports.target.samples().iter().rfind(|pose| pose.quality == MocapPose::VALID).copied();
        self.seen = seen.or(self.seen);
        let fresh = ports.truth.fresh().map(|t| t.stamp_ns).or(ports.nav.fresh().map(|n| n.stamp_ns));
        if let Some(stamp_ns) = fresh {
            let samples = Samples {
                truth: ports.truth.get(),
                nav: ports.nav.get(),
                arm: ports.arm.get(),
                links: ports.links.get(),
                mission: ports.mission.get(),
                target: self.seen.as_ref(),
                pushing: ports.valves.samples().iter().fold(0, |all, state| all | mask(&state.valves)),
            };
            if let Some(frame) = self.stage.frame(seconds(stamp_ns), &samples) {
                say(stream, "frame", &frame)?;
            }
        }
        for health in self.reports.health.samples() {
            say(stream, "health", &HealthRow::of(seconds(health.stamp_ns), health))?;
        }
        for event in self.reports.events.samples().iter().filter(|event| event.severity >= Event::INFO) {
            say(stream, "event", &EventRow::of(seconds(event.stamp_ns), event))?;
        }
        let mut others = self.others.iter_mut().filter_map(|other| other.row(&seconds));
        others.try_for_each(|row| say(stream, "other", &row))
    }
}

fn say(stream: &Stream, name: &str, what: &impl Serialize) -> Result<()> {
    stream.say(name, &serde_json::to_string(what).into_diagnostic()?);
    Ok(())
}
