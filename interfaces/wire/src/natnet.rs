//! OptiTrack's NatNet, versions 3 and 4 of its bit stream: UDP, little endian, packed.
//!
//! A client asks at the server's command port (1510) and is answered there. Frames of motion capture come to a multicast
//! group (239.255.42.99, port 1511), or by unicast to the address that asked to connect and says every second that it is
//! still there.
//!
//! A message is `u16 id, u16 size of what follows`, and then, for a frame of motion capture (id 7):
//!
//! | field | type |
//! | --- | --- |
//! | frame number | u32 |
//! | marker sets | u32 count, \[u32 size\], each a name ending with NUL, u32 count, 3 f32 a marker |
//! | markers without label | u32 count, \[u32 size\], 3 f32 each |
//! | rigid bodies | u32 count, \[u32 size\], each u32 id, 3 f32 position, 4 f32 quaternion x y z w, f32 mean marker error, u16 flags: bit 0 tracked |
//!
//! The sizes in brackets are there from version 4.1. Skeletons, assets, labelled markers, force plates, devices and time
//! stamps follow; they are not read.

use crate::bytes::{Reader, Writer};

/// UDP port to which it sends frames by multicast.
pub const DATA_PORT: u16 = 1511;
/// The multicast group of Motive.
pub const MULTICAST_GROUP: [u8; 4] = [239, 255, 42, 99];
/// Ticks of the server's clock a second, as [`encode_frame`] stamps.
pub const CLOCK_HZ: u64 = 1_000_000_000;

const CONNECT: u16 = 0;
const SERVER_INFO: u16 = 1;
const REQUEST_MODEL_DEFINITION: u16 = 4;
const MODEL_DEFINITION: u16 = 5;
const FRAME_OF_DATA: u16 = 7;
const DISCONNECT: u16 = 9;
const KEEP_ALIVE: u16 = 10;
const RIGID_BODY_LEN: usize = 38;
const NAME_LEN: usize = 256;
const TRACKED: u16 = 1;
const RIGID_BODY_DESCRIPTION: u32 = 1;

/// Of the bit stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// 3 or 4.
    pub major: u8,
    /// Within it.
    pub minor: u8,
}

impl Version {
    /// What Motive 3.1 and later speaks.
    pub const NEWEST: Self = Self { major: 4, minor: 1 };

    /// From text such as `4.1`.
    pub fn parse(text: &str) -> Option<Self> {
        let (major, minor) = text.split_once('.')?;
        Self { major: major.parse().ok()?, minor: minor.parse().ok()? }.known().ok()
    }

    fn known(self) -> Result<Self, NatnetError> {
        if matches!(self.major, 3 | 4) { Ok(self) } else { Err(NatnetError::Version(self.major)) }
    }

    fn has_sizes(self) -> bool {
        self >= Self { major: 4, minor: 1 }
    }
}

/// Why a message cannot be read or written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NatnetError {
    /// It ends before what it announces.
    #[error("NatNet message of {0} bytes ends before what it announces")]
    Truncated(usize),
    /// Another version than 3 or 4.
    #[error("NatNet version {0} is not read: set Motive to version 3 or 4")]
    Version(u8),
    /// It does not fit into the buffer.
    #[error("the NatNet message does not fit into its buffer")]
    Full,
}

/// What a client asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Who the server is, and frames by unicast.
    Connect,
    /// Names and numbers of the rigid bodies.
    ModelDefinition,
    /// More frames by unicast.
    KeepAlive,
    /// No more of them.
    Disconnect,
}

impl Request {
    /// Reads one; `None` for a message that is none.
    pub fn decode(datagram: &[u8]) -> Option<Self> {
        match Reader(datagram).u16()? {
            CONNECT => Some(Self::Connect),
            REQUEST_MODEL_DEFINITION => Some(Self::ModelDefinition),
            KEEP_ALIVE => Some(Self::KeepAlive),
            DISCONNECT => Some(Self::Disconnect),
            _ => None,
        }
    }

    /// As it travels.
    pub fn encode(self) -> [u8; 4] {
        let id = match self {
            Self::Connect => CONNECT,
            Self::ModelDefinition => REQUEST_MODEL_DEFINITION,
            Self::KeepAlive => KEEP_ALIVE,
            Self::Disconnect => DISCONNECT,
        };
        let [low, high] = id.to_le_bytes();
        [low, high, 0, 0]
    }
}

/// What a server says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ServerInfo {
    /// Of its bit stream.
    pub version: Version,
    /// Where its multicast frames go; `None` where it sends by unicast.
    pub group: Option<[u8; 4]>,
    /// The port of frames.
    pub data_port: u16,
}

impl ServerInfo {
    /// Reads one; `None` for another message.
    pub fn decode(datagram: &[u8]) -> Result<Option<Self>, NatnetError> {
        let truncated = NatnetError::Truncated(datagram.len());
        let mut reader = Reader(datagram);
        if reader.u16().ok_or(truncated)? != SERVER_INFO {
            return Ok(None);
        }
        reader.slice(2 + NAME_LEN + 4).ok_or(truncated)?;
        let [major, minor, ..]: [u8; 4] = reader.array().ok_or(truncated)?;
        let version = Version { major, minor }.known()?;
        reader.u64().ok_or(truncated)?;
        let data_port = reader.u16().ok_or(truncated)?;
        let is_multicast = reader.u8().ok_or(truncated)? != 0;
        let group = reader.array().ok_or(truncated)?;
        Ok(Some(Self { version, data_port, group: is_multicast.then_some(group) }))
    }

    /// Writes one, and gives its length.
    pub fn encode(&self, buffer: &mut [u8]) -> Result<usize, NatnetError> {
        message(SERVER_INFO, buffer, |writer| {
            let mut name = [0; NAME_LEN];
            name[..7].copy_from_slice(b"fss lab");
            writer.put(&name)?;
            writer.put(&[0, 2, 0, 0])?;
            writer.put(&[self.version.major, self.version.minor, 0, 0])?;
            writer.put(&CLOCK_HZ.to_le_bytes())?;
            writer.put(&self.data_port.to_le_bytes())?;
            writer.put(&[self.group.is_some().into()])?;
            writer.put(&self.group.unwrap_or_default())
        })
    }
}

/// Pose of a rigid body, in the axes and the unit of the tracker.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RigidBody {
    /// Its streaming id.
    pub id: u32,
    /// Position.
    pub position: [f64; 3],
    /// Rotation, a quaternion x, y, z, w.
    pub rotation: [f64; 4],
    /// Whether it was seen in this frame.
    pub is_tracked: bool,
}

/// A frame whose structure has been checked up to its rigid bodies.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    number: u32,
    bodies: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Checks a datagram; `None` for another message than a frame. Nothing is copied.
    pub fn decode(datagram: &'a [u8], version: Version) -> Result<Option<Self>, NatnetError> {
        version.known()?;
        let mut reader = Reader(datagram);
        let truncated = NatnetError::Truncated(datagram.len());
        if reader.u16().ok_or(truncated)? != FRAME_OF_DATA {
            return Ok(None);
        }
        Self::read(&mut reader, version).map(Some).ok_or(truncated)
    }

    fn read(reader: &mut Reader<'a>, version: Version) -> Option<Self> {
        reader.u16()?;
        let number = reader.u32()?;
        skip(reader, version, |reader| {
            reader.text()?;
            let markers = reader.u32()?;
            reader.slice(12_usize.checked_mul(markers as usize)?)
        })?;
        skip(reader, version, |reader| reader.slice(12))?;
        let count = reader.u32()? as usize;
        if version.has_sizes() {
            reader.u32()?;
        }
        let bodies = reader.slice(RIGID_BODY_LEN.checked_mul(count)?)?;
        Some(Self { number, bodies })
    }

    /// Number of the frame, increasing.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// The rigid bodies in the order of the datagram.
    pub fn rigid_bodies(&self) -> impl Iterator<Item = RigidBody> + use<'a> {
        self.bodies.as_chunks::<RIGID_BODY_LEN>().0.iter().filter_map(|bytes| {
            let mut reader = Reader(bytes);
            let id = reader.u32()?;
            let mut numbers = [0.0; 7];
            for number in &mut numbers {
                *number = reader.f32()?.into();
            }
            let [x, y, z, rotation @ ..] = numbers;
            reader.f32()?;
            let is_tracked = reader.u16()? & TRACKED != 0;
            Some(RigidBody { id, position: [x, y, z], rotation, is_tracked })
        })
    }
}

/// Steps over a list, by its size where the version gives one, else item by item.
fn skip<'a>(
    reader: &mut Reader<'a>,
    version: Version,
    item: impl Fn(&mut Reader<'a>) -> Option<&'a [u8]>,
) -> Option<()> {
    let count = reader.u32()?;
    if version.has_sizes() {
        let size = reader.u32()?;
        return reader.slice(size as usize).map(|_| ());
    }
    // An item has at least 8 bytes, so that a count of billions ends with the datagram.
    (0..count).try_for_each(|_| item(reader).map(|_| ()))
}

/// Writes a frame with these rigid bodies and nothing else, and gives its length; `time_ns` is when the cameras saw them.
pub fn encode_frame(
    version: Version,
    number: u32,
    time_ns: u64,
    bodies: &[RigidBody],
    buffer: &mut [u8],
) -> Result<usize, NatnetError> {
    version.known()?;
    message(FRAME_OF_DATA, buffer, |writer| {
        let list = |writer: &mut Writer<'_>, count: usize, size: usize| {
            writer.put(&(count as u32).to_le_bytes())?;
            if version.has_sizes() { writer.put(&(size as u32).to_le_bytes()) } else { Some(()) }
        };
        writer.put(&number.to_le_bytes())?;
        list(writer, 0, 0)?; // marker sets
        list(writer, 0, 0)?; // markers without label
        list(writer, bodies.len(), bodies.len() * RIGID_BODY_LEN)?;
        for body in bodies {
            writer.put(&body.id.to_le_bytes())?;
            for number in body.position.iter().chain(&body.rotation) {
                writer.put(&(*number as f32).to_le_bytes())?;
            }
            writer.put(&0_f32.to_le_bytes())?;
            writer.put(&(if body.is_tracked { TRACKED } else { 0 }).to_le_bytes())?;
        }
        list(writer, 0, 0)?; // skeletons
        if version.has_sizes() {
            list(writer, 0, 0)?; // assets
        }
        for _ in 0..3 {
            list(writer, 0, 0)?; // labelled markers, force plates, devices
        }
        writer.put(&[0; 8])?; // time code
        writer.put(&(time_ns as f64 * 1e-9).to_le_bytes())?;
        for _ in 0..3 {
            writer.put(&time_ns.to_le_bytes())?; // exposure, receipt and sending, in ticks of the clock
        }
        writer.put(&[0; 2])?; // flags
        writer.put(&[0; 4]) // end of data
    })
}

/// Writes what a server knows of its rigid bodies, and gives its length.
pub fn encode_model_definition(
    version: Version,
    bodies: &[(u32, &str)],
    buffer: &mut [u8],
) -> Result<usize, NatnetError> {
    message(MODEL_DEFINITION, buffer, |writer| {
        writer.put(&(bodies.len() as u32).to_le_bytes())?;
        for (id, name) in bodies {
            writer.put(&RIGID_BODY_DESCRIPTION.to_le_bytes())?;
            // From 4.2 a rigid body has a rotation of its own beside its offset.
            let turned = if version >= (Version { major: 4, minor: 2 }) { 16 } else { 0 };
            if version.has_sizes() {
                writer.put(&((name.len() + 1 + 24 + turned) as u32).to_le_bytes())?;
            }
            writer.put(name.as_bytes())?;
            writer.put(&[0])?;
            writer.put(&id.to_le_bytes())?;
            writer.put(&(-1_i32).to_le_bytes())?; // no parent
            writer.put(&[0; 12])?; // offset from it
            if turned > 0 {
                writer.put(&[0; 12])?;
                writer.put(&1_f32.to_le_bytes())?;
            }
            writer.put(&[0; 4])?; // markers
        }
        Some(())
    })
}

/// Writes a message: its head, and what `body` puts behind it.
fn message(id: u16, buffer: &mut [u8], body: impl FnOnce(&mut Writer<'_>) -> Option<()>) -> Result<usize, NatnetError> {
    let (head, rest) = buffer.split_at_mut_checked(4).ok_or(NatnetError::Full)?;
    let mut writer = Writer::new(rest);
    body(&mut writer).ok_or(NatnetError::Full)?;
    let len = u16::try_from(writer.len()).map_err(|_| NatnetError::Full)?;
    head[..2].copy_from_slice(&id.to_le_bytes());
    head[2..].copy_from_slice(&len.to_le_bytes());
    Ok(4 + usize::from(len))
}
