//! A supervised process: how it is started, and how it is stopped.

use crate::files::this_program;
use crate::notify;
use fss_bus::launch::Schedule;
use fss_messages::MissionState;
use fss_service::{STOP_TIME, SiteArgs};
use miette::{IntoDiagnostic, Result, WrapErr};
use std::collections::BTreeMap;
use std::io::Read;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use zerocopy::IntoBytes;

/// First pause before a restart; it doubles with each restart of the same service.
pub(crate) const FIRST_PAUSE: Duration = Duration::from_millis(10);

/// How long a service may take to give its first sign of life.
pub(crate) const BIRTH_TIME: Duration = Duration::from_secs(5);

/// Where and as what the children run.
pub struct Site {
    /// The run's folder, with plant.toml, launch.toml and mission.toml.
    pub folder: PathBuf,
    /// Prefix of the stack in shared memory.
    pub bus_prefix: String,
    /// Seed of the simulated laboratory.
    pub seed: u64,
    /// The processes that live, by their services' names.
    pub processes: Arc<Mutex<BTreeMap<String, u32>>>,
}

/// One supervised process.
pub(crate) struct Member {
    pub(crate) schedule: Schedule,
    /// Its program, where it was written elsewhere.
    pub(crate) program: Option<PathBuf>,
    /// Whether it moves the vehicle.
    pub(crate) moves: bool,
    pub(crate) child: Option<Child>,
    pub(crate) said: Arc<Mutex<String>>,
    pub(crate) started: Instant,
    pub(crate) starts: u32,
    pub(crate) restart_at: Option<Instant>,
    pub(crate) pause: Duration,
    /// Its last sign of life since its last start.
    pub(crate) heard: Option<Instant>,
    /// Whether it ever gave one.
    pub(crate) has_lived: bool,
    /// Starts in a row that did not work.
    pub(crate) stillborn: u32,
}

impl Member {
    pub(crate) fn new(schedule: Schedule, program: Option<PathBuf>, moves: bool) -> Self {
        Self {
            schedule,
            program,
            moves,
            child: None,
            said: Arc::default(),
            started: Instant::now(),
            starts: 0,
            restart_at: None,
            pause: FIRST_PAUSE,
            heard: None,
            has_lived: false,
            stillborn: 0,
        }
    }

    /// Starts its process; a mission goes on from `last`, what was published of it last.
    pub(crate) fn start(&mut self, site: &Site, last: Option<&MissionState>) -> Result<()> {
        let name = self.schedule.name.get_ref();
        self.starts += 1;
        self.started = Instant::now();
        self.restart_at = None;
        self.heard = None;
        let mut command = self.program.as_ref().map_or_else(this_program, Command::new);
        if name == "lab" {
            command.arg("lab");
        } else if self.program.is_none() {
            command.arg("service").arg(name);
        }
        let arguments = SiteArgs {
            run: site.folder.clone(),
            bus: site.bus_prefix.clone(),
            seed: site.seed,
            starts: self.starts,
            resume: last.map(|last| hex::encode(last.as_bytes())),
            supervised: true,
        };
        command
            .args(arguments.to_arguments())
            .env_remove(notify::SOCKET_VARIABLE)
            // A child hears of its launcher's death by the end of its standard input, and of Ctrl-C only through it.
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .process_group(0);
        let mut child = command.spawn().into_diagnostic().wrap_err_with(|| format!("cannot start service '{name}'"))?;
        if let Some(mut stderr) = child.stderr.take() {
            let said = self.said.clone();
            std::thread::spawn(move || {
                let mut buffer = [0; 4096];
                while let Ok(n @ 1..) = stderr.read(&mut buffer) {
                    let mut said = said.lock().unwrap_or_else(PoisonError::into_inner);
                    said.push_str(&String::from_utf8_lossy(&buffer[..n]));
                }
            });
        }
        site.processes.lock().unwrap_or_else(PoisonError::into_inner).insert(name.clone(), child.id());
        self.child = Some(child);
        Ok(())
    }

    /// Its exit status, once, if it has ended.
    pub(crate) fn ended(&mut self) -> std::io::Result<Option<ExitStatus>> {
        let Some(child) = &mut self.child else { return Ok(None) };
        let status = child.try_wait()?;
        if status.is_some() {
            self.child = None;
            std::thread::sleep(Duration::from_millis(20)); // let its last words arrive
        }
        Ok(status)
    }

    pub(crate) fn ask_to_stop(&mut self) {
        self.restart_at = None;
        if let Some(child) = &mut self.child {
            drop(child.stdin.take());
        }
    }

    pub(crate) fn stop(&mut self) {
        self.ask_to_stop();
        let Some(mut child) = self.child.take() else { return };
        let asked = Instant::now();
        while asked.elapsed() < STOP_TIME {
            if matches!(child.try_wait(), Ok(Some(_)) | Err(_)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        // It hangs: nothing is lost by killing it that waiting would save.
        let _ = child.kill();
        let _ = child.wait();
    }
}
