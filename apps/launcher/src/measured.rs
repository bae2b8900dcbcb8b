//! A flight whose processes' time is taken.

use crate::follower::Follower;
use crate::launcher;
use crate::link_key::make_link_key;
use crate::member::Site;
use crate::soak;
use crate::stack::LOG_FILE;
use crate::stack::Stack;
use fss_bus::{Bus, Time};
use fss_messages::MissionState;
use fss_service::stop_on_signal;
use miette::{IntoDiagnostic, Result, miette};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

/// What a flight has cost.
pub struct Measured {
    /// Time over which processes were measured, s.
    pub seconds: f64,
    /// Processor time of each process in that time, ns; the launcher's under its own name.
    pub cpu_ns: BTreeMap<String, u64>,
    /// The vehicle's name in its launch file.
    pub vehicle: String,
    /// The flight's log.
    pub log: PathBuf,
}

/// How long a stack flies before it is measured: by then all is mapped and the mission runs.
const SETTLED: Duration = Duration::from_secs(4);

/// Flies to and fro for `seconds`, takes the processes' time, and gives what `read` makes of it and of the log, which is removed
/// then. Calls `in_flight` once with the stack's prefix in shared memory, when the mission runs and nothing is measured yet.
///
/// # Errors
/// Where the stack does not fly, or `in_flight` or `read` fails.
pub fn measured_flight<T>(
    launch: Option<&Path>,
    seconds: f64,
    in_flight: impl FnOnce(&str) -> Result<()>,
    read: impl FnOnce(&Stack, &Measured) -> Result<T>,
) -> Result<T> {
    let folder = std::env::temp_dir().join(format!("fss-bench-{}", std::process::id()));
    let flown = fly(&folder, launch, seconds, in_flight);
    let outcome = flown.and_then(|(stack, flight)| read(&stack, &flight));
    let _best_effort = std::fs::remove_dir_all(&folder);
    outcome
}

fn fly(
    folder: &Path,
    launch: Option<&Path>,
    seconds: f64,
    in_flight: impl FnOnce(&str) -> Result<()>,
) -> Result<(Stack, Measured)> {
    std::fs::create_dir_all(folder).into_diagnostic()?;
    let folder = folder.canonicalize().into_diagnostic()?;
    let mission = folder.join("measured.toml");
    std::fs::write(&mission, soak::mission_text((seconds / 4.0).ceil() as i32 + 2)).into_diagnostic()?;
    let stack = Stack::load(launch, None, &mission.to_string_lossy())?;
    stack.write_to(&folder)?;
    make_link_key(&stack, &folder)?;
    let bus_prefix = format!("fssbench_{}_", std::process::id());
    let site = Site { folder: folder.clone(), bus_prefix, seed: 1, processes: Arc::default() };
    let (interrupted, over) = (stop_on_signal()?, AtomicBool::new(false));
    let mut begun: Option<(Instant, BTreeMap<String, u64>)> = None;
    let mut measured = None;
    let mut running_since = None;
    let (mut in_flight, mut joined) = (Some(in_flight), Ok(()));
    launcher::fly(&stack, &site, &over, |mission| {
        let running = mission.state == MissionState::RUNNING;
        if running && let Some(join) = in_flight.take() {
            joined = join(&site.bus_prefix);
        }
        let since: Instant = *running_since.get_or_insert_with(Instant::now);
        if running && begun.is_none() && since.elapsed() > SETTLED {
            begun = Some((Instant::now(), processor_time_ns(&site)));
        }
        if let Some((start, before)) = &begun
            && measured.is_none()
            && start.elapsed().as_secs_f64() >= seconds
        {
            let spent = |(name, now): (String, u64)| {
                let ns = now.saturating_sub(before.get(&name).copied().unwrap_or(0));
                (name, ns)
            };
            let cpu_ns = processor_time_ns(&site).into_iter().map(spent).collect();
            let vehicle = stack.launch.vehicle.clone();
            measured =
                Some(Measured { seconds: start.elapsed().as_secs_f64(), cpu_ns, vehicle, log: folder.join(LOG_FILE) });
            over.store(true, Ordering::Relaxed);
        }
        if interrupted.load(Ordering::Relaxed) {
            over.store(true, Ordering::Relaxed);
        }
    })?;
    joined?;
    let measured = measured.ok_or_else(|| miette!("the flight ended before its {seconds} s were over"))?;
    Ok((stack, measured))
}

fn processor_time_ns(site: &Site) -> BTreeMap<String, u64> {
    let processes = site.processes.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let own = [("launcher".to_owned(), std::process::id())];
    processes.into_iter().chain(own).map(|(name, id)| (name, time_of_process_ns(id))).collect()
}

/// Of all its threads.
pub fn time_of_process_ns(id: u32) -> u64 {
    let tasks = std::fs::read_dir(format!("/proc/{id}/task")).into_iter().flatten().flatten();
    tasks
        .filter_map(|task| std::fs::read_to_string(task.path().join("schedstat")).ok())
        .filter_map(|text| text.split_whitespace().next()?.parse::<u64>().ok())
        .sum()
}

/// Steps each program of a stack in lockstep, and gives how long each step took, ns: from the word to step until what it published is
/// here. The inputs are empty.
///
/// # Errors
/// Where a program cannot be started, or does not answer.
pub fn lockstep_ns(stack: &Stack, steps: u64) -> Result<BTreeMap<String, Vec<u64>>> {
    let mut times = BTreeMap::new();
    for program in &stack.programs {
        let service = &program.description.service;
        let Some(program) = stack.program(service) else { continue };
        let mut follower = Follower::start(stack, program, &Bus::local().for_stack(&stack.launch), 1, 1)?;
        let period_ns = stack.schedule(service)?.period_ns();
        let mut step = |k: u64| -> Result<u64> {
            let (now, asked) = (Time::from_ns(k * period_ns), Instant::now());
            follower.step(now, now).into_diagnostic()?;
            Ok(asked.elapsed().as_nanos() as u64)
        };
        times.insert(service.clone(), (1..=steps).map(&mut step).collect::<Result<_>>()?);
    }
    Ok(times)
}
