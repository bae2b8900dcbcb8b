//! The tracker's place on the network: VICON's datagrams, a NatNet server, or a VRPN server.

mod natnet_server;
mod vrpn_server;

use super::{bind, local_ip};
use crate::LabError;
use crate::process::arrivals::Arrivals;
use fss_bus::launch::Mocap;
use natnet_server::NatnetServer;
use std::io;
use std::net::{SocketAddr, UdpSocket};
use vrpn_server::VrpnServer;

/// Most clients that one server has; a flood of them does not stop the laboratory.
const MAX_CLIENTS: usize = 8;
/// Most requests read in one step.
const MAX_REQUESTS: usize = 16;

/// Where frames leave the laboratory.
#[derive(Debug)]
pub(super) enum TrackerLine {
    Vicon { socket: UdpSocket, to: SocketAddr },
    Natnet(NatnetServer),
    Vrpn(VrpnServer),
}

impl TrackerLine {
    pub(super) fn open(mocap: &Mocap, arrivals: &Arrivals) -> Result<Self, LabError> {
        Ok(match mocap {
            Mocap::Vicon(vicon) => {
                let from = SocketAddr::new(local_ip(vicon.listen.ip()), 0);
                Self::Vicon { socket: bind(from, "motion capture".to_owned())?, to: vicon.listen }
            }
            Mocap::Natnet(natnet) => Self::Natnet(NatnetServer::open(natnet, arrivals)?),
            Mocap::Vrpn(vrpn) => Self::Vrpn(VrpnServer::open(vrpn, mocap.tracker(), arrivals)?),
        })
    }

    /// Answers those who asked since the last call.
    pub(super) fn poll(&mut self, arrivals: &Arrivals) {
        match self {
            Self::Vicon { .. } => {}
            Self::Natnet(server) => server.poll(arrivals),
            Self::Vrpn(server) => server.poll(arrivals),
        }
    }

    /// Sends a frame to all who listen.
    pub(super) fn send(&mut self, frame: &[u8]) -> Result<(), (SocketAddr, io::Error)> {
        match self {
            Self::Vicon { socket, to } => socket.send_to(frame, *to).map(|_| ()).map_err(|error| (*to, error)),
            Self::Natnet(server) => server.send(frame),
            Self::Vrpn(server) => {
                server.send(frame);
                Ok(())
            }
        }
    }
}
