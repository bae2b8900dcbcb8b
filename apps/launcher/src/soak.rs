//! `fss soak`: the real-time stack for as long as one likes, with random faults, deaths and frosts.
//!
//! One flight of a minute follows another until the time is over; each has faults and blows of its own, drawn from the
//! seed. What is reported is what was seen from outside: in shared memory, in `/proc`, in the logs.

mod logs;
mod memory;

use crate::launcher;
use crate::link_key::make_link_key;
use crate::member::Site;
use crate::overruns::{Causes, Disturbances, Unexplained};
use crate::stack::FAULT_EVERY_S;
use crate::stack::Stack;
use crate::witness::{SafetyRecord, Witness};
use clap::Args;
use fss_bus::realtime;
use fss_lab::Faults;
use fss_service::stop_on_signal;
use logs::Sums;
use memory::{Memory, shared_memory_bytes};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Signal, kill_process};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

/// Fly for long, with faults and deaths.
#[derive(Args)]
pub struct SoakArgs {
    /// How long, minutes.
    #[arg(long, default_value_t = 60.0)]
    minutes: f64,
    /// Seed of the laboratory, the faults and the blows.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// File for the figures.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Processes killed or frozen a minute, on average.
    #[arg(long, default_value_t = 10.0)]
    blows_per_minute: f64,
    /// Launch file: rates, priorities, cores, devices.
    #[arg(long, value_name = "FILE")]
    launch: Option<PathBuf>,
    /// Keep the logs of all flights here; where absent they are read and removed.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// What a soak found.
#[derive(Debug, Default, Serialize)]
pub struct Soak {
    format: &'static str,
    minutes: f64,
    seed: u64,
    host: String,
    flights: u32,
    /// Flights that ended before their time, with the reason.
    ended_early: Vec<String>,
    kills: u32,
    freezes: u32,
    faults: usize,
    cycles: u64,
    overruns: u64,
    overruns_by_cause: Causes,
    unexplained: Vec<Unexplained>,
    by_service: BTreeMap<String, Kept>,
    restarts: u32,
    records: u64,
    lost_records: u64,
    valve_open_after_command_loss_ms_max: f64,
    /// The same, less the time in which the host did not run the laboratory, and with it the valves.
    valve_open_while_world_ran_ms_max: f64,
    /// The longest that the host did not run the laboratory.
    world_stood_still_ms_max: f64,
    service_silent_ms_max: BTreeMap<String, f64>,
    rss_growth_bytes: u64,
    shm_leaked_bytes: u64,
    navigation_rms_m: f64,
    unreadable_logs: u32,
}

/// How a service kept its rate.
#[derive(Debug, Default, Serialize)]
struct Kept {
    cycles: u64,
    overruns: u64,
}

/// Who is struck: all but the laboratory, which is the world.
const VICTIMS: [&str; 7] = ["thrusters", "base", "fusion", "links", "arm", "recorder", "mission"];
/// A process's memory is compared with what it had at this age: it has touched everything by then.
const SETTLED: Duration = Duration::from_secs(5);

/// Flies until the time is over, and reports.
pub fn run(args: &SoakArgs) -> Result<()> {
    let stop = stop_on_signal()?;
    let folder =
        args.out.clone().unwrap_or_else(|| std::env::temp_dir().join(format!("fss-soak-{}", std::process::id())));
    std::fs::create_dir_all(&folder).into_diagnostic().wrap_err_with(|| format!("cannot make {}", folder.display()))?;
    let mut soak =
        Soak { format: "fss-soak/1", minutes: args.minutes, seed: args.seed, host: host(), ..Soak::default() };
    let outcome = fly_all(args, &folder, &stop, &mut soak);
    if args.out.is_none() {
        let _best_effort = std::fs::remove_dir_all(&folder);
    }
    outcome?;
    let json = serde_json::to_string_pretty(&soak).into_diagnostic()?;
    if let Some(path) = &args.json {
        std::fs::write(path, &json).into_diagnostic().wrap_err_with(|| format!("cannot write {}", path.display()))?;
    }
    say!("{json}");
    Ok(())
}

fn fly_all(args: &SoakArgs, folder: &Path, stop: &Arc<AtomicBool>, soak: &mut Soak) -> Result<()> {
    let end = Instant::now() + Duration::from_secs_f64(args.minutes * 60.0);
    let mut random = ChaCha8Rng::seed_from_u64(args.seed);
    let mission = folder.join("soak.toml");
    std::fs::write(&mission, mission_text(TURNS)).into_diagnostic()?;
    let mut sums = Sums::default();
    while Instant::now() < end && !stop.load(Ordering::Relaxed) {
        soak.flights += 1;
        let flight = Flight {
            folder: folder.join(format!("flight-{}", soak.flights)),
            seed: random.random(),
            time: end - Instant::now(),
            blows_per_s: args.blows_per_minute / 60.0,
        };
        let mut stack = Stack::load(args.launch.as_deref(), None, &mission.to_string_lossy())?;
        stack.faults = Faults::random(flight.seed, stack.mission.duration_s(), FAULT_EVERY_S, &stack.plant);
        soak.faults += stack.faults.fault.len();
        flight.fly(&stack, stop, soak)?;
        logs::read(&flight.folder, &stack.launch.vehicle, soak, &mut sums)?;
        soak.navigation_rms_m = sums.navigation_rms_m();
        eprintln!(
            "flight {}: {} kills, {} freezes, {} restarts, {} of {} records lost, navigation {:.2} mm RMS so far",
            soak.flights,
            soak.kills,
            soak.freezes,
            soak.restarts,
            soak.lost_records,
            soak.records,
            soak.navigation_rms_m * 1e3
        );
        if args.out.is_none() {
            let _best_effort = std::fs::remove_dir_all(&flight.folder);
        }
    }
    Ok(())
}

/// How many turns of 4 s a flight has.
const TURNS: i32 = 15;

/// Slewing to and fro while the arm holds, 4 s a turn: the thrusters are always at work.
pub fn mission_text(turns: i32) -> String {
    let phase = |k: i32| {
        let theta_deg = if k % 2 == 0 { 15 } else { -15 };
        format!(
            "[[phase]]\nname = \"turn {k}\"\nduration_s = 4\n\
             base = {{ goal = \"goto\", x_m = 0, y_m = 0, theta_deg = {theta_deg} }}\narm = {{ goal = \"hold\" }}\n"
        )
    };
    let head = "name = \"soak\"\ndescription = \"The base turns to and fro.\"\n".to_owned();
    std::iter::once(head).chain((0..turns).map(phase)).collect()
}

fn host() -> String {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default().trim().to_owned();
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let info = read("/proc/cpuinfo");
    let model =
        info.lines().find_map(|line| line.strip_prefix("model name")).unwrap_or("").trim_matches([' ', '\t', ':']);
    format!("{cores} cores, {model}, Linux {}", read("/proc/sys/kernel/osrelease"))
}

/// One flight with its blows.
struct Flight {
    folder: PathBuf,
    seed: u64,
    time: Duration,
    blows_per_s: f64,
}

impl Flight {
    fn fly(&self, stack: &Stack, stop: &Arc<AtomicBool>, soak: &mut Soak) -> Result<()> {
        std::fs::create_dir_all(&self.folder).into_diagnostic()?;
        let folder = self.folder.canonicalize().into_diagnostic()?;
        stack.write_to(&folder)?;
        make_link_key(stack, &folder)?;
        let bus_prefix = format!("fsssoak{}_{}_", soak.flights, std::process::id());
        let site = Site { folder, bus_prefix, seed: self.seed, processes: Arc::default() };
        let flight_over = Arc::new(AtomicBool::new(false));
        let disturbances = Disturbances::default();
        let start_ns = realtime::now().into_diagnostic()?.ns();
        std::thread::scope(|scope| {
            let cores = stack.launch.services.iter().filter_map(|s| s.core).collect::<BTreeSet<_>>();
            for core in cores {
                let (disturbances, over) = (&disturbances, &flight_over);
                scope.spawn(move || disturbances.watch(core, over));
            }
            let (over, site_ref) = (flight_over.clone(), &site);
            let vehicle = stack.launch.vehicle.clone();
            let blows = &disturbances;
            let tormentor = scope.spawn(move || self.torment(site_ref, &vehicle, blows, stop, &over));
            let flown = launcher::fly(stack, &site, &flight_over, |_| ());
            flight_over.store(true, Ordering::Relaxed);
            let found = tormentor.join().map_err(|_| miette!("the soak's witness failed"))??;
            match flown {
                Ok(flown) => soak.restarts += flown.restarts,
                Err(e) => soak.ended_early.push(format!("flight {}: {e:#}", soak.flights)),
            }
            for late in &found.seen.late {
                let schedule = stack.launch.schedule(&late.service);
                let place = schedule.map_or((None, None), |s| (s.core, s.priority));
                soak.unexplained.extend(disturbances.explain(late, place, start_ns, &mut soak.overruns_by_cause));
            }
            soak.take(&found);
            soak.shm_leaked_bytes += shared_memory_bytes(&site.bus_prefix);
            Ok(())
        })
    }

    /// Strikes and watches until the flight is over; ends it when the soak's time is.
    fn torment(
        &self,
        site: &Site,
        vehicle: &str,
        disturbances: &Disturbances,
        stop: &AtomicBool,
        over: &AtomicBool,
    ) -> Result<Found> {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let mut witness = Witness::join(&site.bus_prefix, vehicle)?;
        let mut found = Found::default();
        let mut memory = Memory::default();
        let start = Instant::now();
        let pause = |random: &mut ChaCha8Rng| {
            Duration::from_secs_f64(random.random_range(0.2..1.8) / self.blows_per_s.max(1e-6))
        };
        let mut next_blow = start + SETTLED + pause(&mut random);
        let mut next_weighing = start;
        while !over.load(Ordering::Relaxed) {
            if stop.load(Ordering::Relaxed) || start.elapsed() > self.time {
                over.store(true, Ordering::Relaxed);
            }
            witness.look()?;
            if Instant::now() >= next_blow {
                let victim = VICTIMS[random.random_range(0..VICTIMS.len())];
                let signal = if random.random_bool(0.2) { Signal::STOP } else { Signal::KILL };
                let processes = site.processes.lock().unwrap_or_else(PoisonError::into_inner);
                let struck = processes.get(victim).is_some_and(|id| strike(*id, signal));
                if struck {
                    disturbances.note_blow(witness.note_blow(victim)?);
                    *(if signal == Signal::STOP { &mut found.freezes } else { &mut found.kills }) += 1;
                }
                next_blow = Instant::now() + pause(&mut random);
            }
            if Instant::now() >= next_weighing {
                memory.weigh(site);
                next_weighing += Duration::from_millis(500);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        (found.rss_growth_bytes, found.shm_growth_bytes) = (memory.rss_growth_bytes, memory.shm_growth());
        found.seen = witness.seen;
        Ok(found)
    }
}

/// What was found in one flight.
#[derive(Default)]
struct Found {
    kills: u32,
    freezes: u32,
    rss_growth_bytes: u64,
    shm_growth_bytes: u64,
    seen: SafetyRecord,
}

impl Soak {
    fn take(&mut self, found: &Found) {
        self.kills += found.kills;
        self.freezes += found.freezes;
        self.rss_growth_bytes = self.rss_growth_bytes.max(found.rss_growth_bytes);
        self.shm_leaked_bytes = self.shm_leaked_bytes.max(found.shm_growth_bytes);
        let open_ms = found.seen.open_after_ns as f64 * 1e-6;
        self.valve_open_after_command_loss_ms_max = self.valve_open_after_command_loss_ms_max.max(open_ms);
        let running_ms = found.seen.open_while_running_ns as f64 * 1e-6;
        self.valve_open_while_world_ran_ms_max = self.valve_open_while_world_ran_ms_max.max(running_ms);
        let stood_still_ms = found.seen.world_stood_still_ns as f64 * 1e-6;
        self.world_stood_still_ms_max = self.world_stood_still_ms_max.max(stood_still_ms);
        for (service, silent_ns) in &found.seen.silent_ns {
            let silent = self.service_silent_ms_max.entry(service.clone()).or_default();
            *silent = silent.max(*silent_ns as f64 * 1e-6);
        }
        for ((service, _), (cycles, overruns)) in &found.seen.counts {
            let kept = self.by_service.entry(service.clone()).or_default();
            kept.cycles += cycles;
            kept.overruns += overruns;
            self.cycles += cycles;
            self.overruns += overruns;
        }
    }
}

fn strike(id: u32, signal: Signal) -> bool {
    Pid::from_raw(id as i32).is_some_and(|pid| kill_process(pid, signal).is_ok())
}
