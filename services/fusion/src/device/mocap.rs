//! Threads that listen to motion capture: VICON's datagrams, a NatNet server, or a VRPN server.

mod natnet;
mod vrpn;

use super::POLL;
use crate::MocapPacket;
use fss_bus::launch::{Mocap, Transport};
use fss_bus::{Queue, realtime};
use fss_wire::mocap::{Reader, Sighting};
use std::io;
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Longer than any datagram of a tracker.
const DATAGRAM_LEN: usize = 65_536;

/// A frame, or a piece of one, that arrived at `received_ns`.
pub fn packet(sighting: &Sighting, received_ns: u64) -> MocapPacket {
    MocapPacket { received_ns, frame: sighting.number, poses: sighting.poses }
}

/// What hears a tracker and hands over what it says.
struct Ear {
    reader: Reader,
    queue: Queue<MocapPacket>,
    stop: Arc<AtomicBool>,
}

impl Ear {
    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Takes what has just arrived; gives how many bytes of it were used, `None` where they are nonsense.
    fn hear(&mut self, bytes: &[u8]) -> Option<usize> {
        let received_ns = realtime::now().ok()?.ns();
        let queue = &self.queue;
        let hand_over = |sighting: Sighting| {
            // A full queue loses its oldest frame: the newest counts.
            queue.force_push(packet(&sighting, received_ns));
        };
        self.reader.read(bytes, hand_over).ok()
    }
}

/// Listens to motion capture until `stop` is set; as urgently as a real-time service needs it, or not.
///
/// # Errors
/// Where an address cannot be bound. A server that does not answer is asked again until it does.
pub fn receive_mocap(
    mocap: &Mocap,
    queue: Queue<MocapPacket>,
    stop: Arc<AtomicBool>,
    urgent: bool,
) -> io::Result<JoinHandle<()>> {
    let mut ear = Ear { reader: Reader::new(mocap.tracker()), queue, stop };
    let run: Box<dyn FnOnce() + Send> = match mocap {
        Mocap::Vicon(vicon) => {
            let socket = UdpSocket::bind(vicon.listen)?;
            socket.set_read_timeout(Some(POLL))?;
            Box::new(move || hear_datagrams(&mut ear, &socket))
        }
        Mocap::Natnet(natnet) => {
            let mut client = natnet::Client::open(natnet)?;
            Box::new(move || client.run(&mut ear))
        }
        Mocap::Vrpn(vrpn) => {
            let (server, is_udp) = (vrpn.server, vrpn.transport == Transport::Udp);
            Box::new(move || vrpn::run(&mut ear, server, is_udp))
        }
    };
    std::thread::Builder::new().name("mocap".to_owned()).spawn(move || {
        if urgent {
            realtime::enter_device();
        }
        run();
    })
}

fn hear_datagrams(ear: &mut Ear, socket: &UdpSocket) {
    let mut datagram = vec![0; DATAGRAM_LEN];
    while !ear.is_stopped() {
        if let Ok((len, _)) = socket.recv_from(&mut datagram) {
            ear.hear(datagram.get(..len).unwrap_or_default());
        }
    }
}

/// Waits for something to read on one of these, at most [`POLL`].
fn wait(sources: &[&dyn rustix::fd::AsFd]) {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    let mut polled: Vec<PollFd<'_>> =
        sources.iter().map(|source| PollFd::from_borrowed_fd(source.as_fd(), PollFlags::IN)).collect();
    let most = Timespec { tv_sec: 0, tv_nsec: POLL.subsec_nanos().into() };
    // An interrupted wait is a short one.
    let _ = poll(&mut polled, Some(&most));
}
