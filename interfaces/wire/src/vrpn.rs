//! VRPN, the Virtual-Reality Peripheral Network, as far as trackers need it: big endian, padded to 8 bytes.
//!
//! A client connects to the server's port (3883) by TCP, and all messages come that way. Or it sends a datagram with its
//! address and a port to that port ([`call_back`]); the server then connects to it there, and sends reports by UDP to the
//! port that the client describes. Both sides begin with a [`cookie`]. A message is
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 0 | u32 | length of head and payload, without the payload's padding |
//! | 4 | u32, u32 | time, s and us |
//! | 12 | i32 | sender |
//! | 16 | i32 | type |
//! | 20 | u32 | sequence number, or nothing |
//! | 24 | | payload |
//!
//! Types below zero are the protocol's own; they say which number a sender and a type have. A tracker's report is of the
//! type `vrpn_Tracker Pos_Quat`: `i32 sensor, i32 nothing, 3 f64 position, 4 f64 quaternion x y z w`.

use crate::bytes::{Reader, Writer};

/// The port of a server.
pub const PORT: u16 = 3883;
/// Bytes of a cookie.
pub const COOKIE_LEN: usize = 24;
/// Bytes before a message's payload.
pub const HEAD_LEN: usize = 24;
/// Longest message that is read.
pub const MAX_MESSAGE_LEN: usize = 4096;
/// A server says that nobody has pinged it in vain with a message of this type.
pub const PING: &str = "vrpn_Base ping_message";
/// The answer to a ping.
pub const PONG: &str = "vrpn_Base pong_message";

const POSE: &str = "vrpn_Tracker Pos_Quat";
/// Of the major version; minor ones understand each other.
const MAGIC: &[u8] = b"vrpn: ver. 07.";
const SENDER_DESCRIPTION: i32 = -1;
const TYPE_DESCRIPTION: i32 = -2;
const UDP_DESCRIPTION: i32 = -3;
const REPORT_LEN: usize = 64;
/// The types of [`introduction`], by their numbers.
const TYPES: [&str; 3] = [POSE, PING, PONG];
const PONG_TYPE: i32 = 2;

/// Why bytes are no VRPN.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum VrpnError {
    /// Not the cookie of version 7.
    #[error("the other side is no VRPN of version 7")]
    Cookie,
    /// A message that is too short or too long.
    #[error("VRPN message of {0} bytes: it has at least {HEAD_LEN}, and at most {MAX_MESSAGE_LEN}")]
    Length(u32),
    /// It does not fit into the buffer.
    #[error("the VRPN message does not fit into its buffer")]
    Full,
}

/// What both sides begin with.
pub fn cookie() -> [u8; COOKIE_LEN] {
    *b"vrpn: ver. 07.35  0\0\0\0\0\0"
}

/// Whether the other side began with the cookie of this version.
pub fn check_cookie(bytes: &[u8; COOKIE_LEN]) -> Result<(), VrpnError> {
    if bytes.starts_with(MAGIC) { Ok(()) } else { Err(VrpnError::Cookie) }
}

/// The datagram that asks a server to connect to `ip` at the TCP port `port`.
pub fn call_back(ip: std::net::IpAddr, port: u16) -> String {
    format!("{ip} {port}\0")
}

/// The port at which the sender of such a datagram wants to be called.
pub fn call_back_port(datagram: &[u8]) -> Option<u16> {
    let text = core::str::from_utf8(datagram).ok()?.trim_end_matches('\0');
    text.split_once(' ')?.1.trim().parse().ok()
}

/// A message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Message<'a> {
    /// Time, s and us.
    pub time: [u32; 2],
    /// The number of its sender.
    pub sender: i32,
    /// The number of its type.
    pub kind: i32,
    /// What it says.
    pub payload: &'a [u8],
}

impl<'a> Message<'a> {
    /// Reads the first message and gives its length in bytes; `None` where its end has not come yet.
    pub fn decode(bytes: &'a [u8]) -> Result<Option<(Self, usize)>, VrpnError> {
        let mut reader = Reader(bytes);
        let Some(len) = reader.u32_be() else { return Ok(None) };
        let payload_len = (len as usize).checked_sub(HEAD_LEN).ok_or(VrpnError::Length(len))?;
        let whole_len = HEAD_LEN + payload_len.next_multiple_of(8);
        if whole_len > MAX_MESSAGE_LEN {
            return Err(VrpnError::Length(len));
        }
        let Some(whole) = bytes.get(..whole_len) else { return Ok(None) };
        Ok(Self::read(&mut Reader(whole), payload_len).map(|message| (message, whole_len)))
    }

    fn read(reader: &mut Reader<'a>, payload_len: usize) -> Option<Self> {
        reader.u32_be()?;
        let time = [reader.u32_be()?, reader.u32_be()?];
        let (sender, kind) = (reader.u32_be()? as i32, reader.u32_be()? as i32);
        reader.u32_be()?;
        Some(Self { time, sender, kind, payload: reader.slice(payload_len)? })
    }

    /// Writes it, and gives its length in bytes.
    pub fn encode(&self, sequence: u32, buffer: &mut [u8]) -> Result<usize, VrpnError> {
        let mut writer = Writer::new(buffer);
        self.write(sequence, &mut writer).ok_or(VrpnError::Full)?;
        Ok(writer.len())
    }

    fn write(&self, sequence: u32, writer: &mut Writer<'_>) -> Option<()> {
        writer.put(&((HEAD_LEN + self.payload.len()) as u32).to_be_bytes())?;
        for word in [self.time[0], self.time[1], self.sender as u32, self.kind as u32, sequence] {
            writer.put(&word.to_be_bytes())?;
        }
        writer.put(self.payload)?;
        writer.put([0; 8].get(..self.payload.len().next_multiple_of(8) - self.payload.len())?)
    }

    /// Its time in microseconds; wraps around every 72 minutes.
    pub fn time_us(&self) -> u32 {
        self.time[0].wrapping_mul(1_000_000).wrapping_add(self.time[1])
    }

    /// The name that it gives to a sender (`true`) or a type, where it does.
    pub fn described(&self) -> Option<(bool, &'a str)> {
        if self.kind != SENDER_DESCRIPTION && self.kind != TYPE_DESCRIPTION {
            return None;
        }
        let name = self.payload.get(4..)?.split(|byte| *byte == 0).next()?;
        Some((self.kind == SENDER_DESCRIPTION, core::str::from_utf8(name).ok()?))
    }

    /// The UDP port at which its sender wants reports, where it says so.
    pub fn udp_port(&self) -> Option<u16> {
        if self.kind == UDP_DESCRIPTION { u16::try_from(self.sender).ok() } else { None }
    }
}

/// What a client says to have reports by UDP at `ip` and `port`.
pub fn describe_udp(ip: std::net::IpAddr, port: u16, buffer: &mut [u8]) -> Result<usize, VrpnError> {
    let host = format!("{ip}\0");
    Message { time: [0; 2], sender: port.into(), kind: UDP_DESCRIPTION, payload: host.as_bytes() }.encode(0, buffer)
}

/// What a server says to a new client: the numbers of its senders, which count from 0 as in `names`, and of its types.
pub fn introduction(names: &[String]) -> Vec<u8> {
    let senders = names.iter().map(|name| (SENDER_DESCRIPTION, name.as_str())).zip(0..);
    let types = TYPES.iter().map(|name| (TYPE_DESCRIPTION, *name)).zip(0..);
    let mut bytes = Vec::new();
    let mut buffer = [0; 512];
    for ((kind, name), number) in senders.chain(types) {
        let name: String = name.chars().take(64).collect();
        let payload = [&(name.len() as u32 + 1).to_be_bytes(), name.as_bytes(), &[0]].concat();
        if let Ok(len) = (Message { time: [0; 2], sender: number, kind, payload: &payload }).encode(0, &mut buffer) {
            bytes.extend_from_slice(&buffer[..len]);
        }
    }
    bytes
}

/// A server's answer to a ping for one of its senders.
pub fn pong(sender: i32, buffer: &mut [u8]) -> Result<usize, VrpnError> {
    Message { time: [0; 2], sender, kind: PONG_TYPE, payload: &[] }.encode(0, buffer)
}

/// A pose, in the axes and the unit of the tracker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// Of a tracker with several, from 0.
    pub sensor: i32,
    /// Position.
    pub position: [f64; 3],
    /// Rotation, a quaternion x, y, z, w.
    pub rotation: [f64; 4],
}

impl Report {
    fn decode(payload: &[u8]) -> Option<Self> {
        let mut reader = Reader(payload);
        let sensor = reader.u32_be()? as i32;
        reader.u32_be()?;
        let mut numbers = [0.0; 7];
        for number in &mut numbers {
            *number = f64::from_be_bytes(reader.array()?);
        }
        let [x, y, z, rotation @ ..] = numbers;
        Some(Self { sensor, position: [x, y, z], rotation })
    }
}

/// Writes a pose that a server with the numbers of [`introduction`] reports, and gives its length.
pub fn encode_report(
    sender: i32,
    sequence: u32,
    time_ns: u64,
    report: &Report,
    buffer: &mut [u8],
) -> Result<usize, VrpnError> {
    let mut payload = [0; REPORT_LEN];
    payload[..4].copy_from_slice(&report.sensor.to_be_bytes());
    for (slot, number) in payload[8..].chunks_exact_mut(8).zip(report.position.iter().chain(&report.rotation)) {
        slot.copy_from_slice(&number.to_be_bytes());
    }
    let time = [(time_ns / 1_000_000_000) as u32, (time_ns % 1_000_000_000 / 1000) as u32];
    Message { time, sender, kind: 0, payload: &payload }.encode(sequence, buffer)
}

/// What the numbers of a server's messages mean to a client that wants some of its senders.
#[derive(Debug, Clone)]
pub struct Directory {
    /// Wanted senders, and their numbers once the server has told them.
    senders: Vec<(String, Option<i32>)>,
    pose: Option<i32>,
}

impl Directory {
    /// One that knows no numbers yet.
    pub fn new(names: &[String]) -> Self {
        Self { senders: names.iter().map(|name| (name.clone(), None)).collect(), pose: None }
    }

    /// Takes a message; gives a wanted sender's place in the list and its pose, where that is what it says. Of a tracker with
    /// several sensors the first one counts.
    pub fn take(&mut self, message: &Message<'_>) -> Option<(usize, Report)> {
        if let Some((is_sender, name)) = message.described() {
            if is_sender {
                for (_, number) in self.senders.iter_mut().filter(|(wanted, _)| wanted == name) {
                    *number = Some(message.sender);
                }
            } else if name == POSE {
                self.pose = Some(message.sender);
            }
            return None;
        }
        let place = self.senders.iter().position(|(_, number)| *number == Some(message.sender))?;
        if self.pose != Some(message.kind) {
            return None;
        }
        let report = Report::decode(message.payload).filter(|report| report.sensor == 0)?;
        Some((place, report))
    }
}
