//! A NatNet server, as Motive is one: it answers requests, and sends frames by multicast or to each client.

use super::super::arrivals::{Arrivals, Line};
use super::super::bind;
use super::{MAX_CLIENTS, MAX_REQUESTS};
use crate::LabError;
use fss_bus::launch::Natnet;
use fss_wire::mocap::NAMES;
use fss_wire::natnet::{self, Request, ServerInfo};
use std::io;
use std::net::{IpAddr, SocketAddr, SocketAddrV4, UdpSocket};
use std::time::{Duration, Instant};

/// A client that has not said for so long that it is there gets no more frames.
const CLIENT_PATIENCE: Duration = Duration::from_secs(10);

#[derive(Debug)]
pub(in super::super) struct NatnetServer {
    socket: UdpSocket,
    info: ServerInfo,
    ids: [u32; 3],
    group: Option<SocketAddrV4>,
    clients: Vec<(SocketAddr, Instant)>,
}

impl NatnetServer {
    pub(super) fn open(natnet: &Natnet, arrivals: &Arrivals) -> Result<Self, LabError> {
        let socket = bind(natnet.server, "motion capture".to_owned())?;
        arrivals.watch(&socket, Line::Tracker).map_err(LabError::Watch)?;
        if let (Some(_), IpAddr::V4(local)) = (natnet.multicast, natnet.server.ip()) {
            let multicast = rustix::net::sockopt::set_ip_multicast_if(&socket, &local);
            multicast.map_err(|errno| LabError::Udp {
                what: "motion capture's multicast".to_owned(),
                address: natnet.server,
                source: errno.into(),
            })?;
        }
        let info = ServerInfo {
            version: natnet.version,
            group: natnet.multicast.map(|group| group.ip().octets()),
            data_port: natnet.multicast.map_or(natnet::DATA_PORT, |group| group.port()),
        };
        Ok(Self { socket, info, ids: natnet.ids.in_order(), group: natnet.multicast, clients: Vec::new() })
    }

    pub(super) fn poll(&mut self, arrivals: &Arrivals) {
        if !arrivals.came_on(Line::Tracker) {
            return;
        }
        let mut buffer = [0; 512];
        for _ in 0..MAX_REQUESTS {
            let Ok((len, from)) = self.socket.recv_from(&mut buffer) else { return };
            match Request::decode(buffer.get(..len).unwrap_or_default()) {
                Some(Request::Connect) => {
                    self.welcome(from);
                    self.answer(from, |buffer| self.info.encode(buffer));
                }
                Some(Request::KeepAlive) => self.welcome(from),
                Some(Request::ModelDefinition) => {
                    let bodies: [_; 3] = std::array::from_fn(|i| (self.ids[i], NAMES[i]));
                    self.answer(from, |buffer| natnet::encode_model_definition(self.info.version, &bodies, buffer));
                }
                Some(Request::Disconnect) => self.clients.retain(|(client, _)| *client != from),
                None => {}
            }
        }
    }

    fn welcome(&mut self, from: SocketAddr) {
        let now = Instant::now();
        self.clients.retain(|(client, said)| *client != from && now.duration_since(*said) < CLIENT_PATIENCE);
        if self.clients.len() < MAX_CLIENTS {
            self.clients.push((from, now));
        }
    }

    /// An answer that the network does not take is asked for again.
    fn answer(&self, to: SocketAddr, write: impl FnOnce(&mut [u8]) -> Result<usize, natnet::NatnetError>) {
        let mut buffer = [0; 1024];
        if let Ok(len) = write(&mut buffer) {
            let _ = self.socket.send_to(buffer.get(..len).unwrap_or_default(), to);
        }
    }

    pub(super) fn send(&self, frame: &[u8]) -> Result<(), (SocketAddr, io::Error)> {
        let to =
            |address: SocketAddr| self.socket.send_to(frame, address).map(|_| ()).map_err(|error| (address, error));
        match self.group {
            Some(group) => to(group.into()),
            // One that has gone does not keep frames from the others.
            None => self.clients.iter().map(|(client, _)| to(*client)).fold(Ok(()), Result::and),
        }
    }
}
