//! The line between the laboratories of two vehicles on one table.

use super::bind;
use crate::LabError;
use fss_wire::shared_table::{STATE_LEN, State};
use std::net::{SocketAddr, UdpSocket};

/// Most datagrams read in one step: the other laboratory sends one a millisecond.
const MAX_STATES_PER_STEP: usize = 256;

/// One end of the line.
#[derive(Debug)]
pub(super) struct TableLine {
    socket: UdpSocket,
    there: SocketAddr,
}

impl TableLine {
    /// Listens `here` to the laboratory that listens `there`.
    pub(super) fn open(here: SocketAddr, there: SocketAddr) -> Result<Self, LabError> {
        Ok(Self { socket: bind(here, "the other vehicle's laboratory".to_owned())?, there })
    }

    /// What is read.
    pub(super) fn socket(&self) -> &UdpSocket {
        &self.socket
    }

    /// What the other laboratory said last since the last call.
    pub(super) fn hear(&self) -> Option<State> {
        let mut last = None;
        let mut buffer = [0; STATE_LEN + 1];
        for _ in 0..MAX_STATES_PER_STEP {
            match self.socket.recv_from(&mut buffer) {
                Ok((len, from)) if from == self.there => last = State::decode(&buffer[..len]).or(last),
                Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => break,
                // A stranger; or nobody listened there when this one spoke.
                Ok(_) | Err(_) => {}
            }
        }
        last
    }

    /// Says it; where nobody listens yet, nobody hears.
    pub(super) fn tell(&self, state: &State) {
        let _nobody_there = self.socket.send_to(&state.encode(), self.there);
    }
}
