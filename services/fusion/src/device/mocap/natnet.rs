//! A client of Motive: it asks which version is spoken, and by unicast it says every second that it is still there.

use super::{DATAGRAM_LEN, Ear, wait};
use fss_bus::launch::Natnet;
use fss_wire::natnet::{Request, ServerInfo};
use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, ipproto, socket_with, sockopt};
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::time::{Duration, Instant};

const ASK_EVERY: Duration = Duration::from_secs(1);

pub(super) struct Client {
    server: SocketAddr,
    command: UdpSocket,
    frames: Option<UdpSocket>,
    asked: Option<Instant>,
    /// Whether a frame has come since it asked last.
    hears: bool,
}

impl Client {
    pub(super) fn open(natnet: &Natnet) -> io::Result<Self> {
        let command = UdpSocket::bind(SocketAddr::new(natnet.local, 0))?;
        command.set_nonblocking(true)?;
        let frames = natnet.multicast.map(|group| join(group, natnet.local)).transpose()?;
        Ok(Self { server: natnet.server, command, frames, asked: None, hears: false })
    }

    pub(super) fn run(&mut self, ear: &mut Ear) {
        let mut datagram = vec![0; DATAGRAM_LEN];
        while !ear.is_stopped() {
            self.ask();
            match &self.frames {
                Some(frames) => wait(&[&self.command, frames]),
                None => wait(&[&self.command]),
            }
            for socket in std::iter::once(&self.command).chain(&self.frames) {
                while let Ok((len, from)) = socket.recv_from(&mut datagram) {
                    let bytes = datagram.get(..len).unwrap_or_default();
                    if from.ip() != self.server.ip() {
                        continue;
                    }
                    if let Ok(Some(info)) = ServerInfo::decode(bytes) {
                        ear.reader.set_natnet_version(info.version);
                    } else {
                        self.hears |= ear.hear(bytes).is_some();
                    }
                    if ear.is_stopped() {
                        return;
                    }
                }
            }
        }
        let _ = self.command.send_to(&Request::Disconnect.encode(), self.server);
    }

    /// A server that was started again has forgotten its clients, and may speak another version.
    fn ask(&mut self) {
        if self.asked.is_some_and(|asked| asked.elapsed() < ASK_EVERY) {
            return;
        }
        let request = if self.hears { Request::KeepAlive } else { Request::Connect };
        // One that is lost is sent again.
        let _ = self.command.send_to(&request.encode(), self.server);
        (self.asked, self.hears) = (Some(Instant::now()), false);
    }
}

/// A socket that hears a group; others on this computer may hear it too.
fn join(group: SocketAddrV4, local: IpAddr) -> io::Result<UdpSocket> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = socket_with(AddressFamily::INET, SocketType::DGRAM, flags, Some(ipproto::UDP))?;
    sockopt::set_socket_reuseaddr(&socket, true)?;
    bind(&socket, &group)?;
    let interface = if let IpAddr::V4(local) = local { local } else { Ipv4Addr::UNSPECIFIED };
    sockopt::set_ip_add_membership(&socket, group.ip(), &interface)?;
    Ok(socket.into())
}
