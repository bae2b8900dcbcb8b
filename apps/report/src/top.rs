//! `fss top`: a running stack, live: rates, jitter, ages, health, batteries, valves.

use crate::values;
use clap::Args;
use fss_bus::{Batch, Bus, InputPorts, Latest, RawBatch, RawTopic, SharedConfig, Time, inputs, realtime};
use fss_launcher::stack::Stack;
use fss_messages::{Event, Header, Health, LinksState, MissionState, NavState, ThrustersState, text_of, topic};
use fss_service::{read_programs, topics_of};
use miette::{IntoDiagnostic, Result, miette};
use std::collections::{BTreeMap, VecDeque};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::time::Duration;

/// Which stack, and how.
#[derive(Args)]
pub struct TopArgs {
    /// Prefix of the stack in shared memory; that of the vehicle, or of the only stack that runs, where absent.
    #[arg(long)]
    bus: Option<String>,
    /// The vehicle's name in its launch file; as the stack says where absent.
    #[arg(long)]
    vehicle: Option<String>,
    /// Show it once, after two seconds.
    #[arg(long)]
    once: bool,
}

/// Between two pictures.
const PERIOD: Duration = Duration::from_millis(500);
/// A service without a sign of life for so long is shown as silent, ns.
const SILENT_NS: u64 = 650_000_000;
/// How many events are shown.
const EVENTS: usize = 8;

/// Shows the stack until it is interrupted.
pub fn run(args: &TopArgs) -> Result<()> {
    let prefix = match (&args.bus, &args.vehicle) {
        (Some(prefix), _) => prefix.clone(),
        (None, Some(vehicle)) => stack_of(vehicle)?,
        (None, None) => only_stack()?,
    };
    let vehicle = args.vehicle.clone().or_else(|| vehicle_of(&prefix)).unwrap_or_default();
    let guests = guests(&prefix)?;
    let bus = Bus::shared(&SharedConfig { node: "top".to_owned(), prefix }).into_diagnostic()?.for_vehicle(&vehicle);
    let bus = bus.with_program_topics(guests);
    let mut view = View::open(&bus)?;
    for round in 1.. {
        std::thread::sleep(PERIOD);
        let text = view.text(realtime::now().into_diagnostic()?);
        if args.once {
            if round == 4 {
                say_part!("{text}");
                return Ok(());
            }
            continue;
        }
        let mut out = std::io::stdout().lock();
        // Back to the upper left, each line wiped to its end, and what is left below.
        let text = text.replace('\n', "\x1b[K\n");
        if write!(out, "\x1b[H{text}\x1b[J").and_then(|()| out.flush()).is_err() {
            return Ok(()); // nobody looks any more
        }
    }
    Ok(())
}

/// The prefix of the stack that runs.
pub fn only_stack() -> Result<String> {
    let stacks = stacks()?;
    match stacks.as_slice() {
        [only] => Ok(only.clone()),
        [] => Err(miette!(help = "start one with `fss run`, or name it with --bus", "no stack runs")),
        several => Err(miette!(help = "name one with --bus", "several stacks run: {}", list(several))),
    }
}

/// The prefix of the stack of a vehicle.
fn stack_of(vehicle: &str) -> Result<String> {
    let stacks = stacks()?;
    let of_vehicle = |prefix: &&String| vehicle_of(prefix).is_some_and(|name| name == vehicle);
    let found: Vec<&String> = stacks.iter().filter(of_vehicle).collect();
    match found[..] {
        [only] => Ok(only.clone()),
        _ => Err(miette!(
            help = "vehicle = \"...\" in its launch file names it; --bus names a stack by its prefix",
            "{} stacks of a vehicle '{vehicle}' run, of all these: {}",
            found.len(),
            list(&stacks)
        )),
    }
}

/// Each stack with its vehicle's name.
fn list(stacks: &[String]) -> String {
    let named = |prefix: &String| match vehicle_of(prefix).filter(|name| !name.is_empty()) {
        Some(vehicle) => format!("{prefix} ({vehicle})"),
        None => prefix.clone(),
    };
    stacks.iter().map(named).collect::<Vec<_>>().join(", ")
}

/// The prefixes of all stacks that run, from the launchers' process numbers that they carry.
fn stacks() -> Result<Vec<String>> {
    let names = std::fs::read_dir("/dev/shm")
        .into_diagnostic()?
        .flatten()
        .map(|e| e.file_name().to_string_lossy().into_owned());
    let prefix = |name: String| {
        let id = name.strip_prefix("fss_")?.split('_').next()?.to_owned();
        std::path::Path::new("/proc").join(&id).exists().then(|| format!("fss_{id}_"))
    };
    let mut stacks: Vec<String> = names.filter_map(prefix).collect();
    stacks.sort();
    stacks.dedup();
    Ok(stacks)
}

/// The vehicle of a stack, as the launch file in the folder of its run says.
fn vehicle_of(prefix: &str) -> Option<String> {
    Stack::in_folder(&folder_of(prefix)?).ok().map(|stack| stack.launch.vehicle)
}

/// The folder that the stack's processes were started in, from their command lines.
pub fn folder_of(prefix: &str) -> Option<PathBuf> {
    let processes = std::fs::read_dir("/proc").ok()?.flatten();
    processes.filter_map(|entry| std::fs::read(entry.path().join("cmdline")).ok()).find_map(|line| {
        let words: Vec<String> = line.split(|b| *b == 0).map(|w| String::from_utf8_lossy(w).into_owned()).collect();
        let after = |name: &str| words.iter().position(|word| word == name).and_then(|i| words.get(i + 1));
        (after("--bus").is_some_and(|bus| bus == prefix)).then(|| after("--run").map(PathBuf::from))?
    })
}

/// Topics of the stack's services from elsewhere.
///
/// # Errors
/// Where the run's folder does not say what they are.
pub fn guests(prefix: &str) -> Result<Vec<RawTopic>> {
    folder_of(prefix).map_or_else(|| Ok(Vec::new()), |folder| topics_of(&read_programs(&folder)?))
}

/// A topic of a service from elsewhere: its newest sample, by its own definition.
struct GuestTopic {
    topic: RawTopic,
    batch: RawBatch,
    newest: Vec<u8>,
    /// When the samples of the last second were published, ns.
    published_ns: VecDeque<u64>,
}

impl GuestTopic {
    fn open(bus: &Bus, topic: &RawTopic) -> Result<Self> {
        let batch = RawBatch::open(bus, topic, Batch::<Event>::CAPACITY).into_diagnostic()?;
        Ok(Self { topic: topic.clone(), batch, newest: Vec::new(), published_ns: VecDeque::new() })
    }

    fn refresh(&mut self, now: Time) {
        self.batch.refresh();
        let headers = self.batch.samples().filter_map(Header::of_sample);
        self.published_ns.extend(headers.map(|header| header.published_ns));
        while self.published_ns.front().is_some_and(|ns| now.age_ns(*ns) > 1_000_000_000) {
            self.published_ns.pop_front();
        }
        if let Some(newest) = self.batch.samples().last() {
            newest.clone_into(&mut self.newest);
        }
    }

    fn line(&self, now: Time, out: &mut String) -> std::fmt::Result {
        let name = &self.topic.name;
        let Some(header) = Header::of_sample(&self.newest) else { return writeln!(out, "{name}: nothing yet") };
        let age_ms = now.age_ns(header.stamp_ns) as f64 * 1e-6;
        let values = values::line(&self.topic.definition, &self.newest);
        writeln!(out, "{name} {} Hz, {age_ms:.0} ms old: {values}", self.published_ns.len())
    }
}

inputs! {
    struct Ports {
        health: Batch<Health> = topic::HEALTH,
        events: Batch<Event> = topic::EVENTS,
        mission: Latest<MissionState> = topic::MISSION_STATE,
        nav: Latest<NavState> = topic::NAV_STATE,
        links: Latest<LinksState> = topic::LINKS_STATE,
        thrusters: Latest<ThrustersState> = topic::THRUSTERS_STATE,
    }
}

/// What is shown.
struct View {
    ports: Ports,
    guests: Vec<GuestTopic>,
    services: BTreeMap<String, Health>,
    said: VecDeque<Event>,
}

impl View {
    fn open(bus: &Bus) -> Result<Self> {
        Ok(Self {
            ports: Ports::open(bus).into_diagnostic()?,
            guests: bus.program_topics().iter().map(|topic| GuestTopic::open(bus, topic)).collect::<Result<_>>()?,
            services: BTreeMap::new(),
            said: VecDeque::new(),
        })
    }

    fn text(&mut self, now: Time) -> String {
        self.ports.refresh();
        self.guests.iter_mut().for_each(|guest| guest.refresh(now));
        for health in self.ports.health.samples() {
            self.services.insert(text_of(&health.service).to_owned(), *health);
        }
        self.said.extend(self.ports.events.samples());
        self.said.drain(..self.said.len().saturating_sub(EVENTS));
        let mut text = String::new();
        // Writing into a string does not fail.
        let _ = self.services_table(now, &mut text).and_then(|()| self.vehicle(now, &mut text));
        text
    }

    fn services_table(&self, now: Time, out: &mut String) -> std::fmt::Result {
        writeln!(
            out,
            "{:<10} {:>6} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8} {:>7}  ",
            "service", "Hz", "cycles", "overruns", "skipped", "wake p99", "step p99", "step max", "starts"
        )?;
        for (name, h) in &self.services {
            let us = |ns: u64| ns as f64 * 1e-3;
            let silent = if now.age_ns(h.stamp_ns) > SILENT_NS { "SILENT" } else { "" };
            let lacks = if h.real_time == 1 { "" } else { "normal scheduling" };
            writeln!(
                out,
                "{name:<10} {:>6.0} {:>9} {:>8} {:>8} {:>8.0} {:>8.0} {:>8.0} {:>7}  {silent}{lacks}",
                h.rate_hz,
                h.cycles,
                h.overruns,
                h.skipped,
                us(h.wake_p99_ns),
                us(h.step_p99_ns),
                us(h.step_max_ns),
                h.starts
            )?;
        }
        writeln!(out, "wake-up and step times in us")
    }

    fn vehicle(&self, now: Time, out: &mut String) -> std::fmt::Result {
        let age_ms = |stamp_ns: u64| now.age_ns(stamp_ns) as f64 * 1e-6;
        writeln!(out)?;
        if let Some(m) = self.ports.mission.get() {
            writeln!(out, "mission    phase {} of {}, state {}", m.phase + 1, m.phase_count, m.state)?;
        }
        if let Some(n) = self.ports.nav.get() {
            let mode =
                ["initialising", "tracking", "COASTING", "LOST", "NO GYRO"].get(usize::from(n.mode)).unwrap_or(&"?");
            let (x, y, theta_deg) = (n.x_m, n.y_m, n.theta_rad.to_degrees());
            writeln!(out, "navigation {x:.3} m {y:.3} m {theta_deg:.2} deg, {mode}, {:.0} ms old", age_ms(n.stamp_ns))?;
        }
        if let Some(l) = self.ports.links.get() {
            for i in 0..(l.link_count as usize).min(l.q_rad.len()) {
                let (q_deg, battery_v) = (l.q_rad[i].to_degrees(), l.battery_v[i]);
                let age_ms = l.age_ns[i] as f64 * 1e-6;
                let fault = if l.fault[i] == 0 { String::new() } else { format!(", FAULT {:#04x}", l.fault[i]) };
                writeln!(
                    out,
                    "link {}     {q_deg:>7.2} deg, {battery_v:.2} V, {age_ms:.0} ms old, {} lost{fault}",
                    i + 1,
                    l.lost[i]
                )?;
            }
        }
        if let Some(t) = self.ports.thrusters.get() {
            let valves = &t.valves[..(t.valve_count as usize).min(t.valves.len())];
            let open: String = valves.iter().map(|open| if *open == 0 { '.' } else { '#' }).collect();
            let firing_s = t.open_time_ns.iter().sum::<u64>() as f64 * 1e-9;
            writeln!(
                out,
                "valves     {open}, {firing_s:.2} s of firing in all, command {:.0} ms old",
                t.command_age_ns as f64 * 1e-6
            )?;
        }
        self.guests.iter().try_for_each(|guest| guest.line(now, out))?;
        for event in &self.said {
            let severity =
                ["debug", "info", "warning", "ERROR", "CRITICAL"].get(usize::from(event.severity)).unwrap_or(&"?");
            writeln!(out, "{severity:<8} {:<10} {}", text_of(&event.service), text_of(&event.text))?;
        }
        Ok(())
    }
}
