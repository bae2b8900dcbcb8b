//! The radio: a UDP socket and the thread that owns it.

use crate::{CommandDatagram, TelemetryDatagram};
use fss_bus::{DeviceThread, Queue, realtime};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How long the thread waits for telemetry before it looks for commands: the longest that a command waits, a hundredth
/// of the time between two.
const WAIT: Duration = Duration::from_millis(2);

/// The thread that speaks with the links; it ends when this is dropped.
#[derive(Debug)]
pub struct Device {
    _thread: DeviceThread,
    local: SocketAddr,
}

impl Device {
    /// Speaks from the address `local` with the links at `links`, joint 1 first. Datagrams from any other address are
    /// dropped; a full telemetry queue loses its oldest. As urgently as a real-time service needs it, or not.
    ///
    /// # Errors
    /// Where the address is taken or the thread cannot be made.
    pub fn start(
        local: SocketAddr,
        links: Vec<SocketAddr>,
        telemetry: Queue<TelemetryDatagram>,
        commands: Queue<CommandDatagram>,
        urgent: bool,
    ) -> io::Result<Self> {
        let socket = UdpSocket::bind(local)?;
        socket.set_read_timeout(Some(WAIT))?;
        let local = socket.local_addr()?;
        let radio = Radio { socket, links, telemetry, commands };
        let thread = DeviceThread::start("links-udp", move |stop| {
            if urgent {
                realtime::enter_device();
            }
            radio.run(stop);
        })?;
        Ok(Self { _thread: thread, local })
    }

    /// The address from which it speaks.
    pub fn local_addr(&self) -> SocketAddr {
        self.local
    }
}

struct Radio {
    socket: UdpSocket,
    links: Vec<SocketAddr>,
    telemetry: Queue<TelemetryDatagram>,
    commands: Queue<CommandDatagram>,
}

impl Radio {
    fn run(&self, stop: &AtomicBool) {
        let mut buffer = [0; 2048];
        while !stop.load(Ordering::Relaxed) {
            // A time-out, or a link's closed port: both are silence, which the service notices by itself.
            if let Ok((len, from)) = self.socket.recv_from(&mut buffer)
                && self.links.contains(&from)
                && let Ok(now) = realtime::now()
            {
                self.telemetry.force_push(TelemetryDatagram::new(now.ns(), &buffer[..len]));
            }
            while let Some(command) = self.commands.pop() {
                if let Some(link) = self.links.get(command.link) {
                    // A datagram that cannot be sent is a lost one.
                    let _ = self.socket.send_to(&command.bytes, link);
                }
            }
        }
    }
}
