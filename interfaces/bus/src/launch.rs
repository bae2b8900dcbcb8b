//! The launch file: which services run, at what rates, with what priority, on which core. Nothing else decides that.

mod bridge;
mod devices;
mod mocap;
mod ros2;

pub use bridge::{Bridge, ForeignTopic};
pub use devices::Devices;
pub use mocap::{Mocap, Natnet, Transport, Vicon, Vrpn};
pub use ros2::{NODES, Ros2, Ros2Receive, Ros2Type};

use crate::shared::READERS;
use serde::Deserialize;
use std::net::SocketAddr;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// A stack as its launch file describes it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Launch {
    /// Name in front of every topic; empty for a stack alone on its host.
    #[serde(default)]
    pub vehicle: String,
    /// The vehicle that is this one's target, and tells where it is while it can be heard.
    #[serde(default)]
    pub target_vehicle: Option<String>,
    /// Where the devices are.
    pub devices: Devices,
    /// How long a log may get.
    #[serde(default)]
    pub recording: Recording,
    /// Where yellow and red begin.
    #[serde(default)]
    pub limits: Limits,
    /// How much room a topic has.
    #[serde(default)]
    pub shared_memory: SharedMemory,
    /// Where `ground` serves the live view; absent: nowhere, and it is not started.
    #[serde(default)]
    pub ground: Option<Ground>,
    /// Where the simulated laboratories of two vehicles on one table hear each other; absent: alone on the table.
    #[serde(default, rename = "granite")]
    pub shared_table: Option<SharedTable>,
    /// What passes between this vehicle and others.
    #[serde(default)]
    pub bridge: Option<Bridge>,
    /// What nodes of ROS 2 see; absent: nothing.
    #[serde(default)]
    pub ros2: Option<Ros2>,
    /// The services in the order of their start; they stop in the opposite order.
    #[serde(rename = "service")]
    pub services: Vec<Schedule>,
}

/// Where a log ends and another begins.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recording {
    /// After this much of samples, before compression, a new log is begun, MB; one log a run where absent.
    #[serde(default)]
    pub rotate_mb: Option<u64>,
    /// Room that recording leaves on the disk, MB: with less it pauses.
    #[serde(default)]
    pub keep_free_mb: u64,
}

/// Where yellow and red begin. (How late a step may end is its service's deadline: yellow beyond half of it.)
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Battery of a link, V.
    pub battery_yellow_v: f64,
    /// Battery of a link, V.
    pub battery_red_v: f64,
}

impl Default for Limits {
    /// Of a pack of four lithium cells.
    fn default() -> Self {
        Self { battery_yellow_v: 13.6, battery_red_v: 12.8 }
    }
}

/// How much room a topic has.
#[derive(Clone, Debug, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SharedMemory {
    /// The most readers of a topic: services, the recorder, the launcher, and who watches. Each costs every topic some room.
    pub readers: usize,
}

impl Default for SharedMemory {
    fn default() -> Self {
        Self { readers: READERS }
    }
}

/// Where `ground` serves the live view.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ground {
    /// TCP address at which it listens.
    pub listen: SocketAddr,
    /// Whether viewers may tune parameters and abort the mission; only where `listen` is on the loopback.
    #[serde(default)]
    pub commands: bool,
    /// Origins whose pages a browser may show it to, such as `https://app.foxglove.dev`, beside pages of the viewer's own
    /// computer.
    #[serde(default)]
    pub origins: Vec<String>,
}

/// Where the simulated laboratories of two vehicles on one table hear each other.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SharedTable {
    /// UDP address at which this vehicle's laboratory listens.
    pub here: SocketAddr,
    /// UDP address at which the other one's does, on the same computer.
    pub there: SocketAddr,
}

/// When and how one service runs.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// The service.
    pub name: Spanned<String>,
    /// The program of a service that was written elsewhere; a path that is not absolute is taken from the launch file's folder.
    #[serde(default)]
    pub program: Option<Spanned<PathBuf>>,
    /// What a service that does not come with fss is told; it says which keys it knows.
    #[serde(default)]
    pub config: Option<Spanned<toml::Table>>,
    /// Steps a second.
    pub rate_hz: Spanned<f64>,
    /// When in its period a step begins, so that data flows through the stack within one period.
    #[serde(default)]
    pub phase_us: u64,
    /// Another phase, for a service that follows a device which runs free: it steps at the one of the two at which a
    /// measurement has waited less.
    #[serde(default)]
    pub other_phase_us: Option<u64>,
    /// A step that ends later than this after its boundary is an overrun; the period where absent.
    #[serde(default)]
    pub deadline_us: Option<u64>,
    /// `SCHED_FIFO` priority, 1 to 99; normal scheduling where absent.
    #[serde(default)]
    pub priority: Option<u8>,
    /// The core to which it is pinned; any where absent.
    #[serde(default)]
    pub core: Option<usize>,
    /// Without a sign of life for so long it counts as frozen, and is killed.
    #[serde(default = "default_frozen_ms")]
    pub frozen_ms: u64,
    /// Whether it runs only in missions that ask for it.
    #[serde(default)]
    pub on_demand: bool,
    /// Whether the launcher restarts it when it dies.
    #[serde(default = "yes")]
    pub restart: bool,
}

const fn default_frozen_ms() -> u64 {
    650
}

const fn yes() -> bool {
    true
}

const fn default_max_age_ms() -> u64 {
    300
}

impl Schedule {
    /// Time from one boundary to the next, ns.
    pub fn period_ns(&self) -> u64 {
        (1e9 / self.rate_hz.get_ref()).round() as u64
    }

    /// When in its period a step begins, ns.
    pub fn phase_ns(&self) -> u64 {
        self.phase_us.saturating_mul(1000)
    }

    /// The other phase that it may step at, ns.
    pub fn other_phase_ns(&self) -> Option<u64> {
        self.other_phase_us.map(|us| us.saturating_mul(1000))
    }

    /// Time after its boundary at which a step must have ended, ns.
    pub fn deadline_ns(&self) -> u64 {
        self.deadline_us.map_or_else(|| self.period_ns(), |us| us.saturating_mul(1000))
    }
}

/// The most that a launch file may ask for.
const MOST_READERS: usize = 64;
/// The longest name of a service, which its samples carry, bytes.
const LONGEST_NAME: usize = 15;

impl Schedule {
    /// Whether it is one of the `known` services, or a program with a name of its own.
    fn check_name(&self, known: &[&str]) -> Result<(), LaunchError> {
        let refuse = |message: String, help: String| Err(LaunchError { message, help, span: Some(self.name.span()) });
        let name = self.name.get_ref().as_str();
        if self.program.is_none() && !known.contains(&name) {
            let known = known.join(", ");
            let help = format!("the services of fss are {known}; one of your own has program = \"PATH\"");
            return refuse(format!("there is no service '{name}'"), help);
        }
        let is_word = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_';
        let is_plain = name.len() <= LONGEST_NAME && name.starts_with(|c: char| c.is_ascii_lowercase());
        if !is_plain || !name.bytes().all(is_word) {
            let help = format!("up to {LONGEST_NAME} lower-case letters, digits and underscores, the first a letter");
            return refuse(format!("'{name}' is no name of a service"), help);
        }
        Ok(())
    }

    /// What its program is told, as TOML.
    pub fn config_text(&self) -> String {
        self.config.as_ref().map_or_else(String::new, |config| config.get_ref().to_string())
    }
}

/// The service that shows the stack to viewers.
pub const GROUND: &str = "ground";
/// The service that speaks with other vehicles.
pub const BRIDGE: &str = "bridge";
/// Services that are programs of their own, `fss-NAME`: what they depend on is heavy.
pub const PROGRAMS: &[&str] = &[GROUND, BRIDGE];

/// Why a launch file is refused.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct LaunchError {
    /// What is wrong.
    pub message: String,
    /// What to do.
    pub help: String,
    /// Where in the text, bytes.
    pub span: Option<Range<usize>>,
}

impl Launch {
    /// Reads a launch file's text; `known` are the names of the services that there are.
    ///
    /// # Errors
    /// Says where the text is malformed or contradicts itself.
    pub fn parse(text: &str, known: &[&str]) -> Result<Self, LaunchError> {
        let launch = Self::of_run(text)?;
        launch.services.iter().try_for_each(|service| service.check_name(known))?;
        Ok(launch)
    }

    /// Reads the launch file of a run's folder or of a log, whose launcher knew its services.
    ///
    /// # Errors
    /// Says where the text is malformed or contradicts itself.
    pub fn of_run(text: &str) -> Result<Self, LaunchError> {
        let launch: Self = toml::from_str(text).map_err(|e| LaunchError {
            message: e.message().to_owned(),
            help: "the launch files that come with fss show every key".to_owned(),
            span: e.span(),
        })?;
        launch.check()?;
        Ok(launch)
    }

    fn check(&self) -> Result<(), LaunchError> {
        let refuse =
            |message: String, help: String, span: Range<usize>| Err(LaunchError { message, help, span: Some(span) });
        for (i, service) in self.services.iter().enumerate() {
            let name = service.name.get_ref();
            if self.services[..i].iter().any(|other| other.name.get_ref() == name) {
                let help = "each service runs once; remove one of the two tables".to_owned();
                return refuse(format!("'{name}' is launched twice"), help, service.name.span());
            }
            let rate_hz = *service.rate_hz.get_ref();
            if !(0.1..=10_000.0).contains(&rate_hz) {
                let help = "a rate lies between 0.1 and 10000 Hz".to_owned();
                return refuse(format!("'{name}' cannot run at {rate_hz} Hz"), help, service.rate_hz.span());
            }
            if service.phase_ns().max(service.other_phase_ns().unwrap_or(0)) >= service.period_ns() {
                let help = format!("the period is {} us; a phase lies within it", service.period_ns() / 1000);
                return refuse(format!("the phase of '{name}' is beyond its period"), help, service.name.span());
            }
            if service.priority.is_some_and(|p| !(1..=99).contains(&p)) {
                let help = "SCHED_FIFO priorities go from 1 to 99".to_owned();
                return refuse(format!("the priority of '{name}' is out of range"), help, service.name.span());
            }
        }
        let readers = self.shared_memory.readers;
        if !(READERS..=MOST_READERS).contains(&readers) {
            let help = format!("a topic has room for {READERS} to {MOST_READERS} readers");
            return Err(LaunchError { message: format!("[shared_memory] readers = {readers}"), help, span: None });
        }
        self.check_origins()?;
        self.check_shared_table()?;
        self.check_ros2()?;
        self.check_neighbours()
    }

    /// Whether browsers could say these origins.
    fn check_origins(&self) -> Result<(), LaunchError> {
        let is_origin = |origin: &&String| origin.split_once("://").is_some_and(|(_, host)| !host.contains(['/', '*']));
        match self.ground.iter().flat_map(|ground| &ground.origins).find(|origin| !is_origin(origin)) {
            Some(origin) => Err(LaunchError {
                message: format!("[ground] origins: '{origin}' is no origin"),
                help: "an origin is a scheme, a host and a port where it has one, such as https://app.foxglove.dev"
                    .to_owned(),
                span: None,
            }),
            None => Ok(()),
        }
    }

    /// Whether the two laboratories of a table can hear each other.
    fn check_shared_table(&self) -> Result<(), LaunchError> {
        let refuse = |message: &str, help: &str| {
            Err(LaunchError { message: message.to_owned(), help: help.to_owned(), span: None })
        };
        match &self.shared_table {
            Some(_) if self.schedule("lab").is_none() => {
                refuse("[granite] joins simulated laboratories, and there is none", "remove it: the real table is one")
            }
            Some(g) if g.here == g.there => {
                refuse("[granite] here and there are the same", "`there` is what the other launch file calls `here`")
            }
            Some(g) if !(g.here.ip().is_loopback() && g.there.ip().is_loopback()) => refuse(
                "[granite] is for two laboratories on one computer, which has one clock",
                "take addresses on the loopback, such as 127.0.0.1:53300",
            ),
            _ => Ok(()),
        }
    }

    /// The schedule of a service, if the launch file has it.
    pub fn schedule(&self, name: &str) -> Option<&Schedule> {
        self.services.iter().find(|service| service.name.get_ref() == name)
    }

    /// The same with all relative paths taken from `folder`.
    pub fn in_folder(mut self, folder: &Path) -> Self {
        self.devices.gyro = folder.join(&self.devices.gyro);
        self.devices.valves = folder.join(&self.devices.valves);
        self.devices.link_key = self.devices.link_key.map(|key| folder.join(key));
        self
    }
}
