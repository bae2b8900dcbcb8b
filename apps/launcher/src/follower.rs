//! A service that is a program of its own, on a clock that nobody waits for: stepped over shared memory.

use crate::programs::drain;
use crate::stack::Stack;
use fss_bus::lockstep::Leader;
use fss_bus::virtual_time::Tick;
use fss_bus::{Bus, BusError, SharedConfig, Time};
use fss_service::{Description, PortDescription, STOP_TIME, SiteArgs};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long the last words of a program that has ended may take.
const LAST_WORDS: Duration = Duration::from_millis(200);

/// Followers of this process so far: each has a prefix in shared memory of its own.
static COUNT: AtomicU32 = AtomicU32::new(0);

/// A program that follows a virtual clock.
pub(crate) struct Follower {
    service: String,
    /// None when it has ended.
    leader: Option<Leader>,
    process: Process,
}

/// The process, its folder and its shared memory; all go with this.
struct Process {
    child: Child,
    /// What it says of errors; none when that was told.
    said: Option<JoinHandle<String>>,
    folder: PathBuf,
    prefix: String,
}

impl Follower {
    /// Starts the program and waits until it is ready for its first step.
    ///
    /// # Errors
    /// Where it cannot be started, or ends, with what it said.
    pub(crate) fn start(
        stack: &Stack,
        (path, description): (&Path, &Description),
        run: &Bus,
        seed: u64,
        starts: u32,
    ) -> Result<Self> {
        let (number, id) = (COUNT.fetch_add(1, Ordering::Relaxed), std::process::id());
        let prefix = format!("fssstep{number}_{id}_");
        let config = SharedConfig { node: format!("leader-{}", description.service), prefix: prefix.clone() };
        let shared = Bus::shared(&config).into_diagnostic()?.for_stack(&stack.launch);
        let topics =
            |ports: &[PortDescription]| ports.iter().map(PortDescription::to_topic).collect::<Result<Vec<_>>>();
        let leader = Leader::open(run, &shared, &topics(&description.inputs)?, &topics(&description.outputs)?);
        let mut leader = leader.into_diagnostic()?;
        let folder = std::env::temp_dir().join(format!("fss-step-{id}-{number}"));
        std::fs::create_dir_all(&folder)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot make {}", folder.display()))?;
        stack.write_to(&folder)?;
        let arguments =
            SiteArgs { run: folder.clone(), bus: prefix.clone(), seed, starts, resume: None, supervised: true };
        let mut child = Command::new(path)
            .args(arguments.to_arguments())
            .arg("--lockstep")
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot start {}", path.display()))?;
        let said = Some(drain(child.stderr.take()));
        let mut process = Process { child, said, folder, prefix };
        let service = description.service.clone();
        leader.wait(|| process.ended()).map_err(|reason| miette!("service '{service}': {reason}"))?;
        Ok(Self { service, leader: Some(leader), process })
    }

    /// One step at `now`, whose outputs count as published at `flush`.
    ///
    /// # Errors
    /// Where it does not answer.
    pub(crate) fn step(&mut self, now: Time, flush: Time) -> Result<(), BusError> {
        let Some(leader) = &mut self.leader else { return Ok(()) };
        let outcome = leader.step(now, flush, || self.process.ended());
        outcome.map_err(|reason| BusError::Lockstep { service: self.service.clone(), reason })
    }
}

impl Follower {
    /// Lets it take what has come, without a step.
    ///
    /// # Errors
    /// Where it does not answer.
    pub(crate) fn refresh(&mut self) -> Result<(), BusError> {
        let Some(leader) = &mut self.leader else { return Ok(()) };
        let outcome = leader.refresh(|| self.process.ended());
        outcome.map_err(|reason| BusError::Lockstep { service: self.service.clone(), reason })
    }
}

impl Tick for Follower {
    fn tick(&mut self, now: Time) -> Result<(), BusError> {
        self.step(now, now)
    }
}

impl Drop for Follower {
    fn drop(&mut self) {
        // Its ports leave shared memory before that is cleared.
        self.leader = None;
    }
}

impl Process {
    /// How it ended and what it said, where it has.
    fn ended(&mut self) -> Option<String> {
        let status = self.child.try_wait().ok().flatten()?;
        // Another process may hold the pipe still: that says nothing of this one.
        let asked = Instant::now();
        while self.said.as_ref().is_some_and(|said| !said.is_finished()) && asked.elapsed() < LAST_WORDS {
            std::thread::sleep(Duration::from_millis(1));
        }
        let said =
            self.said.take().filter(JoinHandle::is_finished).and_then(|said| said.join().ok()).unwrap_or_default();
        Some(format!("it ended ({status}): {}", said.trim()))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        drop(self.child.stdin.take());
        let asked = Instant::now();
        while asked.elapsed() < STOP_TIME && matches!(self.child.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(1));
        }
        // It has ended, or hangs; what it leaves behind is cleared away as far as the system lets us.
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
        let _ = fss_bus::remove_dead_nodes(&self.prefix, true);
    }
}
