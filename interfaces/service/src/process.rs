//! One process of a stack: its run's folder, its schedule, shared memory, the word to stop.

use crate::description::{read, read_programs, topics_of};
use crate::site::Site;
use clap::Args;
use fss_bus::launch::{Launch, Schedule};
use fss_bus::{Bus, Feed, Queue, Runner, Service, SharedConfig, process};
use miette::{IntoDiagnostic, Result, miette};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::ffi::OsString;
use std::io::{self, Read};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The launch file's name in a run's folder.
pub const LAUNCH_FILE: &str = "launch.toml";
/// The plant file's.
pub const PLANT_FILE: &str = "plant.toml";
/// The mission file's.
pub const MISSION_FILE: &str = "mission.toml";
/// How long a process may take to stop before it is killed.
pub const STOP_TIME: Duration = Duration::from_secs(3);

/// Where a single process finds its stack.
#[derive(Args, Clone, Debug)]
pub struct SiteArgs {
    /// Folder of the run: holds launch.toml, plant.toml and mission.toml, and receives what the process writes.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub run: PathBuf,
    /// Prefix of the stack in shared memory.
    #[arg(long, default_value = "fss_")]
    pub bus: String,
    /// Seed of everything random in the simulated laboratory; the recorder notes it.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// How often this process has been started in this run.
    #[arg(long, default_value_t = 1, hide = true)]
    pub starts: u32,
    /// What the process before it published last, in hexadecimal digits: the mission goes on from there.
    #[arg(long, hide = true)]
    pub resume: Option<String>,
    /// Stop when standard input ends, as the launcher wants it.
    #[arg(long, hide = true)]
    pub supervised: bool,
}

impl SiteArgs {
    /// The command line that says the same.
    pub fn to_arguments(&self) -> Vec<OsString> {
        let mut all: Vec<OsString> =
            vec!["--run".into(), self.run.clone().into(), "--bus".into(), self.bus.clone().into()];
        all.extend(["--seed".into(), self.seed.to_string().into(), "--starts".into(), self.starts.to_string().into()]);
        if let Some(last) = &self.resume {
            all.extend(["--resume".into(), last.into()]);
        }
        all.extend(self.supervised.then(|| "--supervised".into()));
        all
    }
}

/// What every process of a stack has.
pub struct Process {
    /// The run's folder.
    pub folder: PathBuf,
    /// The launch file; its devices' paths lie in the run's folder.
    pub launch: Launch,
    /// Shared memory.
    pub bus: Bus,
    /// Set when the process is to stop.
    pub stop: Arc<AtomicBool>,
    /// How often this process has been started in this run.
    pub starts: u32,
    /// The last to go: until then shared memory is being left.
    _supervision: Option<Supervision>,
}

impl Process {
    /// Joins the stack of a run's folder as the service `name`.
    ///
    /// # Errors
    /// Where the folder has no sound launch file, or shared memory cannot be opened.
    pub fn open(name: &str, args: &SiteArgs) -> Result<Self> {
        let path = args.run.join(LAUNCH_FILE);
        let launch = Launch::of_run(&read(&path)?);
        Self::of(name, args, launch.map_err(|e| miette!(help = e.help, "{}: {}", path.display(), e.message))?)
    }

    /// The same with a launch file that has been read.
    ///
    /// # Errors
    /// Where shared memory cannot be opened.
    pub fn of(name: &str, args: &SiteArgs, launch: Launch) -> Result<Self> {
        let stop = stop_on_signal()?;
        let supervision = args.supervised.then(|| Supervision::begin(stop.clone())).transpose().into_diagnostic()?;
        let node = format!("{name}-{}", std::process::id());
        let bus = Bus::shared(&SharedConfig { node, prefix: args.bus.clone() }).into_diagnostic()?;
        let bus = bus.for_stack(&launch).with_program_topics(topics_of(&read_programs(&args.run)?)?);
        let launch = launch.in_folder(&args.run);
        Ok(Self { folder: args.run.clone(), launch, bus, stop, starts: args.starts, _supervision: supervision })
    }

    /// What a service may know of where it flies.
    ///
    /// # Errors
    /// Where the launch file does not have it, or a file of the run's folder cannot be read.
    pub fn site(&self, name: &str) -> Result<Site> {
        Ok(Site {
            rate_hz: *self.schedule(name)?.rate_hz.get_ref(),
            starts: self.starts,
            vehicle: self.launch.vehicle.clone(),
            plant_text: self.read(PLANT_FILE)?,
            mission_text: self.read(MISSION_FILE)?,
        })
    }

    /// The text of a file in the run's folder.
    ///
    /// # Errors
    /// Where it cannot be read.
    pub fn read(&self, file: &str) -> Result<String> {
        read(&self.folder.join(file))
    }

    /// When a service runs.
    ///
    /// # Errors
    /// Where the launch file does not have it.
    pub fn schedule(&self, name: &str) -> Result<Schedule> {
        let schedule = self.launch.schedule(name).cloned();
        schedule.ok_or_else(|| miette!("the launch file has no [[service]] named '{name}'; add one with its rate_hz"))
    }

    /// Whether a service has a real-time priority: then what serves its devices is as urgent.
    ///
    /// # Errors
    /// Where the launch file does not have it.
    pub fn is_real_time(&self, name: &str) -> Result<bool> {
        Ok(self.schedule(name)?.priority.is_some())
    }

    /// Runs a service until it is told to stop; gives it back.
    ///
    /// # Errors
    /// Where a topic cannot be opened, or the loop fails.
    pub fn fly<S: Service>(&self, service: S, after_step: impl FnMut()) -> Result<S> {
        let schedule = self.schedule(S::NAME)?;
        let mut runner = Runner::new(service, &self.bus).into_diagnostic()?;
        process::run(&mut runner, &self.bus, &schedule, self.starts, &self.stop, after_step).into_diagnostic()?;
        Ok(runner.service)
    }

    /// A queue between the service and a thread of its device.
    ///
    /// # Errors
    /// Where another has the name.
    pub fn queue<T: Send + 'static>(&self, name: &'static str) -> Result<Queue<T>> {
        self.bus.queue(name, Feed::<T>::CAPACITY).into_diagnostic()
    }
}

/// A flag that Ctrl-C and termination set.
///
/// # Errors
/// Where the signals cannot be caught.
pub fn stop_on_signal() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, stop.clone()).into_diagnostic()?;
    }
    Ok(stop)
}

/// Sets `stop` when standard input ends: the launcher's word, or its death. A process that cannot leave is killed by its
/// launcher, or, where that is dead, leaves from here: iceoryx2 waits without end for shared memory whose maker was killed
/// while making it. The thread that watches ends with this, so that nothing of it is left at the process's exit.
struct Supervision {
    work: Option<UnixStream>,
    watch: Option<JoinHandle<()>>,
}

impl Supervision {
    fn begin(stop: Arc<AtomicBool>) -> io::Result<Self> {
        let (work, end_of_work) = UnixStream::pair()?;
        let watch = std::thread::Builder::new().spawn(move || watch(&end_of_work, &stop))?;
        Ok(Self { work: Some(work), watch: Some(watch) })
    }
}

impl Drop for Supervision {
    fn drop(&mut self) {
        drop(self.work.take());
        let _ended = self.watch.take().map(JoinHandle::join);
    }
}

fn watch(end_of_work: &UnixStream, stop: &AtomicBool) {
    let mut input = io::stdin();
    loop {
        let mut ready = [PollFd::new(end_of_work, PollFlags::IN), PollFd::new(&input, PollFlags::IN)];
        let [work, words] = match poll(&mut ready, None) {
            Ok(_) => ready.map(|ready| !ready.revents().is_empty()),
            Err(_interrupted) => continue,
        };
        if work {
            return;
        }
        if words && matches!(input.read(&mut [0; 64]), Ok(0) | Err(_)) {
            break;
        }
    }
    stop.store(true, Ordering::Relaxed);
    let told = Instant::now();
    while let Some(left) = (2 * STOP_TIME).checked_sub(told.elapsed()) {
        let left = Timespec { tv_sec: left.as_secs() as i64, tv_nsec: i64::from(left.subsec_nanos()) };
        if poll(&mut [PollFd::new(end_of_work, PollFlags::IN)], Some(&left)).is_ok_and(|ready| ready > 0) {
            return;
        }
    }
    eprintln!("this process could not leave in time: what it shares is left to the next start");
    std::process::exit(1);
}
