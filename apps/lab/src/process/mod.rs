//! The laboratory in real time: a clock, sockets, a pseudo-terminal.
//!
//! [`Process`] steps the [`Laboratory`] to the monotonic clock once a millisecond, speaks as the tracker, writes the gyro's
//! terminal, serves each link at an address of its own, and follows the valve line. Nothing in it blocks: what a reader
//! does not take is lost, as on a real line. Sockets and links in the file system vanish with it.

mod arrivals;
mod table_line;
mod terminal;
mod tracker_line;
mod valve_line;

use crate::laboratory::{DeviceOutputs, Laboratory, STEP_NS};
use crate::{LabConfig, LabError, TRUTH_PERIOD_NS};
use arrivals::{Arrivals, Line};
use fss_bus::launch::Mocap;
use fss_bus::{Time, realtime};
use fss_messages::TruthState;
use fss_plant::Plant;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use table_line::TableLine;
use terminal::Terminal;
use tracker_line::TrackerLine;
use valve_line::ValveLine;

/// Longest datagram that is read; what is longer is none of ours.
const MAX_COMMAND_LEN: usize = 256;

/// Most datagrams read from one link's socket in one step: a flood does not stop the laboratory.
const MAX_COMMANDS_PER_STEP: usize = 16;

/// Where the devices are for the rest of the world.
#[derive(Debug, Clone, PartialEq)]
pub struct Addresses {
    /// Where motion capture is heard, or asked for.
    pub mocap: Mocap,
    /// Where a symbolic link to the gyro's terminal is put.
    pub gyro: PathBuf,
    /// Where the valve line's Unix socket is put.
    pub valves: PathBuf,
    /// Where each link listens, link 1 first; with port 0 the system chooses one.
    pub links: Vec<SocketAddr>,
    /// Where this laboratory listens to that of another vehicle on the same table, and where the other one listens.
    pub shared_table: Option<[SocketAddr; 2]>,
}

/// How one step of the loop kept its time.
#[derive(Debug, Clone, Copy)]
pub struct Stepped {
    /// When it should have begun.
    pub boundary: Time,
    /// When it began.
    pub woken: Time,
    /// When it ended.
    pub done: Time,
    /// Boundaries that passed meanwhile; the next step makes up for their physics.
    pub skipped: u64,
}

/// A laboratory with its devices open.
#[derive(Debug)]
pub struct Process {
    laboratory: Laboratory,
    arrivals: Arrivals,
    ports: Ports,
    valve_line: ValveLine,
    table_line: Option<TableLine>,
    next_truth_ns: u64,
}

/// What bytes leave by.
#[derive(Debug)]
struct Ports {
    tracker: TrackerLine,
    gyro: Terminal,
    links: Vec<UdpSocket>,
    warned: bool,
}

impl Process {
    /// Opens all devices and sets up the laboratory at the present time.
    pub fn open(plant: &Plant, config: LabConfig, addresses: &Addresses) -> Result<Self, LabError> {
        if addresses.links.len() != plant.link_count() {
            let (given, needed) = (addresses.links.len(), plant.link_count());
            return Err(LabError::Config { what: format!("{given} link addresses for a plant with {needed} links") });
        }
        let arrivals = Arrivals::new()?;
        let links = addresses.links.iter().zip(1..).map(|(address, link)| bind(*address, format!("link {link}")));
        let ports = Ports {
            links: links.collect::<Result<_, _>>()?,
            tracker: TrackerLine::open(&addresses.mocap, &arrivals)?,
            gyro: Terminal::open(&addresses.gyro)?,
            warned: false,
        };
        let valve_line = ValveLine::open(&addresses.valves, &arrivals)?;
        let table_line = addresses.shared_table.map(|[here, there]| TableLine::open(here, there)).transpose()?;
        arrivals.watch(ports.gyro.line(), Line::Gyro).map_err(LabError::Watch)?;
        for (link, socket) in ports.links.iter().enumerate() {
            arrivals.watch(socket, Line::Link(link)).map_err(LabError::Watch)?;
        }
        if let Some(line) = &table_line {
            arrivals.watch(line.socket(), Line::SharedTable).map_err(LabError::Watch)?;
        }
        let start_ns = realtime::now()?.ns();
        let config = LabConfig { tracker: addresses.mocap.tracker(), ..config };
        let laboratory = Laboratory::new(plant, config, start_ns)?;
        Ok(Self { laboratory, arrivals, ports, valve_line, table_line, next_truth_ns: start_ns })
    }

    /// The laboratory inside.
    pub fn laboratory(&self) -> &Laboratory {
        &self.laboratory
    }

    /// Where each link listens.
    pub fn links(&self) -> impl Iterator<Item = SocketAddr> + '_ {
        self.ports.links.iter().filter_map(|socket| socket.local_addr().ok())
    }

    /// Takes what came in, and lets the laboratory go on to `now`.
    pub fn step(&mut self, now: Time) {
        let (arrivals, laboratory) = (&mut self.arrivals, &mut self.laboratory);
        arrivals.look();
        if let Some(mask) = self.valve_line.poll(now, arrivals) {
            laboratory.set_valves(mask, now.ns());
        }
        self.ports.gyro.poll(arrivals.came_on(Line::Gyro), |byte| laboratory.request_gyro(byte));
        self.ports.tracker.poll(arrivals);
        let mut buffer = [0; MAX_COMMAND_LEN];
        let links = self.ports.links.iter().enumerate();
        for (link, socket) in links.filter(|(link, _)| arrivals.came_on(Line::Link(*link))) {
            for _ in 0..MAX_COMMANDS_PER_STEP {
                let Ok((len, from)) = socket.recv_from(&mut buffer) else { break };
                laboratory.command_link(link, from, buffer.get(..len).unwrap_or_default());
            }
        }
        if arrivals.came_on(Line::SharedTable)
            && let Some(other) = self.table_line.as_ref().and_then(TableLine::hear)
        {
            laboratory.hear(&other);
        }
        laboratory.step_to(now.ns(), &mut self.ports);
        if let Some(line) = &self.table_line {
            line.tell(&laboratory.tell());
        }
    }

    /// Runs until `stop` is set, once a millisecond, and tells the truth 100 times a second; after each step it says how
    /// the loop keeps its time.
    ///
    /// # Errors
    /// Where the system has no monotonic clock.
    pub fn run(
        &mut self,
        stop: &AtomicBool,
        mut truth: impl FnMut(&TruthState),
        mut stepped: impl FnMut(&Stepped),
    ) -> Result<(), LabError> {
        let mut boundary = realtime::now()?;
        while !stop.load(Ordering::Relaxed) {
            boundary = boundary.plus_ns(STEP_NS);
            realtime::sleep_until(boundary);
            let now = realtime::now()?;
            self.step(now);
            if now.ns() >= self.next_truth_ns {
                self.next_truth_ns = now.ns() - now.ns() % TRUTH_PERIOD_NS + TRUTH_PERIOD_NS;
                truth(&self.laboratory.truth());
            }
            let done = realtime::now()?;
            let skipped = done.age_ns(boundary.ns()) / STEP_NS;
            stepped(&Stepped { boundary, woken: now, done, skipped });
            // The physics has caught up with a late wake-up; the loop does not hurry after it.
            boundary = boundary.max(Time::from_ns(now.ns().saturating_sub(STEP_NS)));
        }
        Ok(())
    }
}

impl DeviceOutputs for Ports {
    fn mocap(&mut self, _time_ns: u64, bytes: &[u8]) {
        if let Err((to, error)) = self.tracker.send(bytes) {
            self.warn_once("motion capture", to, Err(error));
        }
    }

    fn gyro(&mut self, _time_ns: u64, bytes: &[u8]) {
        self.gyro.write(bytes);
    }

    fn link(&mut self, _time_ns: u64, link: usize, to: SocketAddr, datagram: &[u8]) {
        if let Some(socket) = self.links.get(link) {
            let sent = socket.send_to(datagram, to);
            self.warn_once("link telemetry", to, sent);
        }
    }
}

impl Ports {
    /// A network that takes nothing is worth a word, not one for every datagram.
    fn warn_once(&mut self, what: &str, to: SocketAddr, sent: std::io::Result<usize>) {
        if let Err(error) = sent
            && !self.warned
        {
            self.warned = true;
            eprintln!("{what} could not be sent to {to}: {error}");
        }
    }
}

fn bind(address: SocketAddr, what: String) -> Result<UdpSocket, LabError> {
    let bound = UdpSocket::bind(address).and_then(|socket| socket.set_nonblocking(true).map(|()| socket));
    bound.map_err(|source| LabError::Udp { what, address, source })
}

/// Where to send from: a laboratory that speaks to its own host alone stays on it.
fn local_ip(to: IpAddr) -> IpAddr {
    match to {
        ip if ip.is_loopback() => ip,
        IpAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        IpAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    }
}
