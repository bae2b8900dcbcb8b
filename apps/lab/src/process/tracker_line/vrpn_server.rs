//! A VRPN server: clients connect to it, or ask it to call them back; reports go by TCP, or by UDP to those who said where.

use super::super::arrivals::{Arrivals, Line};
use super::super::bind;
use super::{MAX_CLIENTS, MAX_REQUESTS};
use crate::LabError;
use fss_bus::launch::Vrpn;
use fss_wire::mocap::Tracker;
use fss_wire::vrpn::{self, COOKIE_LEN, MAX_MESSAGE_LEN, Message, PING};
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::time::Duration;

/// How long a client may take to be called back; a laboratory's network needs a fraction of it.
const CALL_TIME: Duration = Duration::from_millis(20);

#[derive(Debug)]
pub(in super::super) struct VrpnServer {
    listener: TcpListener,
    /// Where it is asked to call back, and where reports by UDP come from.
    socket: UdpSocket,
    tracker: Tracker,
    clients: Vec<Client>,
}

#[derive(Debug)]
struct Client {
    stream: TcpStream,
    /// Where it wants reports by UDP.
    reports: Option<SocketAddr>,
    /// Whether it has said that it is one.
    is_known: bool,
    /// What it said, as far as it is not read.
    said: Vec<u8>,
    /// The client's own numbers: of its pings, and of our senders.
    ping: Option<i32>,
    senders: Vec<(i32, usize)>,
}

impl VrpnServer {
    pub(super) fn open(vrpn: &Vrpn, tracker: Tracker, arrivals: &Arrivals) -> Result<Self, LabError> {
        let socket = bind(vrpn.server, "motion capture".to_owned())?;
        let listener = TcpListener::bind(vrpn.server).and_then(|l| l.set_nonblocking(true).map(|()| l));
        let listener = listener.map_err(|source| LabError::Udp {
            what: "motion capture (TCP)".to_owned(),
            address: vrpn.server,
            source,
        })?;
        arrivals.watch(&socket, Line::Tracker).map_err(LabError::Watch)?;
        arrivals.watch(&listener, Line::Tracker).map_err(LabError::Watch)?;
        Ok(Self { listener, socket, tracker, clients: Vec::new() })
    }

    pub(super) fn poll(&mut self, arrivals: &Arrivals) {
        if !arrivals.came_on(Line::Tracker) {
            return;
        }
        for _ in 0..MAX_REQUESTS {
            let Ok((stream, _)) = self.listener.accept() else { break };
            self.welcome(stream, arrivals);
        }
        let mut buffer = [0; 256];
        for _ in 0..MAX_REQUESTS {
            let Ok((len, from)) = self.socket.recv_from(&mut buffer) else { break };
            // As VRPN does, it calls the address that asked, whatever host the datagram names.
            if let Some(port) = vrpn::call_back_port(buffer.get(..len).unwrap_or_default())
                && let Ok(stream) = TcpStream::connect_timeout(&SocketAddr::new(from.ip(), port), CALL_TIME)
            {
                self.welcome(stream, arrivals);
            }
        }
        let tracker = &self.tracker;
        self.clients.retain_mut(|client| client.listen(tracker).is_some());
    }

    fn welcome(&mut self, mut stream: TcpStream, arrivals: &Arrivals) {
        let is_ready = stream.set_nonblocking(true).is_ok()
            && stream.set_nodelay(true).is_ok()
            && arrivals.watch(&stream, Line::Tracker).is_ok()
            && stream.write_all(&vrpn::cookie()).is_ok();
        if is_ready && self.clients.len() < MAX_CLIENTS {
            let (said, senders) = (Vec::new(), Vec::new());
            self.clients.push(Client { stream, reports: None, is_known: false, said, ping: None, senders });
        }
    }

    /// A client whose connection takes no more has gone, or does not read.
    pub(super) fn send(&mut self, frame: &[u8]) {
        let socket = &self.socket;
        self.clients.retain_mut(|client| match client.reports {
            _ if !client.is_known => true,
            Some(to) => socket.send_to(frame, to).is_ok(),
            None => client.stream.write_all(frame).is_ok(),
        });
    }
}

impl Client {
    /// Reads what it says; `None` where it has gone, or is none.
    fn listen(&mut self, tracker: &Tracker) -> Option<()> {
        let mut buffer = [0; MAX_MESSAGE_LEN];
        match self.stream.read(&mut buffer) {
            Ok(0) => return None,
            Ok(len) => self.said.extend_from_slice(buffer.get(..len)?),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
            Err(_) => return None,
        }
        let said = std::mem::take(&mut self.said);
        let mut rest = said.as_slice();
        if !self.is_known {
            let Some((cookie, after)) = rest.split_first_chunk::<COOKIE_LEN>() else {
                self.said = said;
                return Some(());
            };
            vrpn::check_cookie(cookie).ok()?;
            self.is_known = true;
            self.stream.write_all(&tracker.introduction()).ok()?;
            rest = after;
        }
        while let Some((message, len)) = Message::decode(rest).ok()? {
            self.take(&message, tracker)?;
            rest = rest.get(len..)?;
        }
        self.said = rest.to_vec();
        Some(())
    }

    fn take(&mut self, message: &Message<'_>, tracker: &Tracker) -> Option<()> {
        if let Some(port) = message.udp_port() {
            self.reports = self.stream.peer_addr().ok().map(|peer| SocketAddr::new(peer.ip(), port));
        }
        match message.described() {
            Some((true, name)) => {
                if let Some(ours) = tracker.names.iter().position(|known| *known == name) {
                    self.senders.push((message.sender, ours));
                }
            }
            Some((false, PING)) => self.ping = Some(message.sender),
            None if Some(message.kind) == self.ping => {
                let Some((_, ours)) = self.senders.iter().find(|(theirs, _)| *theirs == message.sender) else {
                    return Some(());
                };
                let mut buffer = [0; 64];
                let len = vrpn::pong(*ours as i32, &mut buffer).ok()?;
                self.stream.write_all(buffer.get(..len)?).ok()?;
            }
            Some((false, _)) | None => {}
        }
        Some(())
    }
}
