//! What travels between the device's thread and the service.

use fss_messages::LinkDatagram;
use fss_wire::link::DATAGRAM_LEN;

/// Device queue of received telemetry datagrams.
pub const TELEMETRY_QUEUE: &str = "links.telemetry";
/// Device queue of command datagrams to be sent.
pub const COMMAND_QUEUE: &str = "links.command";

/// A datagram as it was received: anything may be in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TelemetryDatagram {
    /// Time of receipt, ns, monotonic clock.
    pub received_ns: u64,
    /// Bytes received, of which the first [`Self::CAPACITY`] are kept.
    pub len: usize,
    /// The bytes, filled with zeros.
    pub bytes: [u8; Self::CAPACITY],
}

impl TelemetryDatagram {
    /// Bytes kept: more than a valid datagram has, so that a longer one is seen to be none.
    pub const CAPACITY: usize = DATAGRAM_LEN + 4;

    /// Keeps what fits of a received datagram.
    pub fn new(received_ns: u64, datagram: &[u8]) -> Self {
        let len = datagram.len().min(Self::CAPACITY);
        let mut bytes = [0; Self::CAPACITY];
        bytes[..len].copy_from_slice(&datagram[..len]);
        Self { received_ns, len, bytes }
    }

    /// What was received.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.len.min(Self::CAPACITY)]
    }
}

impl From<&TelemetryDatagram> for LinkDatagram {
    /// As it is recorded.
    fn from(datagram: &TelemetryDatagram) -> Self {
        let (stamp_ns, received_ns) = (datagram.received_ns, datagram.received_ns);
        Self { stamp_ns, received_ns, len: datagram.len as u32, bytes: datagram.bytes, ..Self::default() }
    }
}

impl From<&LinkDatagram> for TelemetryDatagram {
    /// As it was received.
    fn from(recorded: &LinkDatagram) -> Self {
        Self { received_ns: recorded.received_ns, len: recorded.len as usize, bytes: recorded.bytes }
    }
}

/// An encoded and signed command for one link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandDatagram {
    /// The link, counted from 0 at the base.
    pub link: usize,
    /// The datagram.
    pub bytes: [u8; DATAGRAM_LEN],
}
