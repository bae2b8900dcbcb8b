//! Drivers that move the valves.

mod gpio;

pub use gpio::GpioLines;

use crate::{DRIVER_QUEUE, VALVES_QUEUE, ValvesCommand};
use fss_bus::{Bus, BusError, Feed, Queue};
use fss_wire::valves::ValveFrame;
use std::io::{self, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};

/// As long as the service's own ends of the queues.
const QUEUE_LEN: usize = Feed::<ValvesCommand>::CAPACITY;

/// Something that opens and shuts all valves at once.
pub trait Valves {
    /// Sets the lines; bit 0 is thruster 1, set is open.
    ///
    /// # Errors
    /// Where the lines cannot be set.
    fn set(&mut self, mask: u16) -> io::Result<()>;
}

/// Brings the service's masks to the valves and says whether that worked.
pub struct Driver<V> {
    valves: V,
    commands: Queue<ValvesCommand>,
    reports: Queue<bool>,
}

impl<V: Valves> Driver<V> {
    /// A driver at the service's queues.
    ///
    /// # Errors
    /// Where the bus refuses a queue.
    pub fn new(valves: V, bus: &Bus) -> Result<Self, BusError> {
        let (commands, reports) = (bus.queue(VALVES_QUEUE, QUEUE_LEN)?, bus.queue(DRIVER_QUEUE, QUEUE_LEN)?);
        Ok(Self { valves, commands, reports })
    }

    /// Sets the newest mask; called after every step of the service. Nothing stands between step and valve.
    pub fn apply(&mut self) {
        let mut newest = None;
        while let Some(command) = self.commands.pop() {
            newest = Some(command.mask);
        }
        if let Some(mask) = newest {
            self.reports.force_push(self.valves.set(mask).is_ok());
        }
    }

    /// Shuts all valves.
    ///
    /// # Errors
    /// Where the lines cannot be set.
    pub fn shut(&mut self) -> io::Result<()> {
        self.valves.set(0)
    }
}

/// The valve line of the simulated laboratory. It carries every step's mask, so that nothing depends on one frame, and
/// connects anew where the laboratory was restarted.
pub struct LaboratoryLine {
    path: PathBuf,
    stream: Option<UnixStream>,
    counter: u32,
}

impl LaboratoryLine {
    /// The line at a Unix socket's path.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), stream: None, counter: 0 }
    }

    fn connect(&mut self) -> io::Result<&mut UnixStream> {
        if self.stream.is_none() {
            let stream = UnixStream::connect(&self.path)?;
            stream.set_nonblocking(true)?;
            self.stream = Some(stream);
        }
        self.stream.as_mut().ok_or_else(|| io::ErrorKind::NotConnected.into())
    }
}

impl Valves for LaboratoryLine {
    fn set(&mut self, mask: u16) -> io::Result<()> {
        self.counter = self.counter.wrapping_add(1);
        let frame = ValveFrame { mask, counter: self.counter }.encode();
        let sent = self.connect()?.write_all(&frame);
        if sent.is_err() {
            // A closed connection shuts the valves on the other side; the next step connects anew.
            self.stream = None;
        }
        sent
    }
}
