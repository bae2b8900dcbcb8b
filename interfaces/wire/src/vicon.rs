//! VICON Tracker's UDP object stream (port 51001).
//!
//! One datagram is one camera frame, little endian and packed:
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 0 | u32 | frame number, increasing |
//! | 4 | u8 | number of items |
//! | 5 | items | one after another |
//!
//! and an item:
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 0 | u8 | id: 0 is a tracked object, others are skipped |
//! | 1 | u16 | size of what follows: 72 for an object; a longer one is stepped over by its size |
//! | 3 | char\[24\] | name, ends at the first NUL |
//! | 27 | 3 f64 | x, y, z in mm, table frame |
//! | 51 | 3 f64 | rotation about x, y, z in rad |
//!
//! The stream carries neither time stamp, nor checksum, nor an occlusion flag: its reader stamps on receipt, checks that
//! the frame number increases, and refuses poses that are not [tracked](Object::is_tracked). Bytes after the last item
//! are accepted (Tracker may pad a datagram).

use crate::bytes::{Reader, Writer};

/// UDP port to which Tracker sends its object stream by default.
pub const PORT: u16 = 51001;

/// Longest object name in bytes.
pub const NAME_LEN: usize = 24;

/// Bytes before the first item.
pub const HEADER_LEN: usize = 5;

/// Bytes of one object item, its id and size included.
pub const OBJECT_LEN: usize = 3 + OBJECT_BODY_LEN;

/// Most objects that [`encode`] puts into one frame: it keeps a datagram below one Ethernet packet (1205 of 1472 bytes).
pub const MAX_OBJECTS: usize = 16;

/// Largest datagram that [`encode`] writes, in bytes.
pub const MAX_DATAGRAM_LEN: usize = HEADER_LEN + MAX_OBJECTS * OBJECT_LEN;

const OBJECT_ID: u8 = 0;
const OBJECT_BODY_LEN: usize = NAME_LEN + 48;
const M_PER_MM: f64 = 1e-3;

/// Pose of one tracked object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Object<'a> {
    /// Name given in Tracker, at most [`NAME_LEN`] bytes.
    pub name: &'a str,
    /// Position x, y, z in the table frame (m).
    pub position_m: [f64; 3],
    /// Rotation about x, y, z (rad); a planar vehicle turns about z.
    pub rotation_rad: [f64; 3],
}

impl Object<'_> {
    /// Whether the pose can be a measurement. Trackers send exact zeros for an object that they lost, and a pose that
    /// is not finite is none.
    pub fn is_tracked(&self) -> bool {
        let mut fields = self.position_m.iter().chain(&self.rotation_rad);
        fields.all(|value| value.is_finite()) && self.position_m != [0.0; 3]
    }
}

/// What is wrong with a datagram or with what should become one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ViconError {
    /// The datagram ends before what it announces.
    #[error("VICON datagram of {len} bytes ends within item {item} of {items}")]
    Truncated {
        /// Length of the datagram in bytes.
        len: usize,
        /// Item in which it ends, from 1; 0 is the header.
        item: u8,
        /// Items that the header announces.
        items: u8,
    },
    /// An object item is too small to hold a pose.
    #[error("VICON item {item} is an object of {size} bytes, an object has at least {OBJECT_BODY_LEN}")]
    ShortObject {
        /// Item, from 1.
        item: u8,
        /// Its announced size in bytes.
        size: u16,
    },
    /// An object's name is not UTF-8 text.
    #[error("VICON item {item} has a name that is not text")]
    Name {
        /// Item, from 1.
        item: u8,
    },
    /// An object to be encoded has a name longer than [`NAME_LEN`] bytes, or one that holds a NUL.
    #[error("object {index} has a name that does not fit into {NAME_LEN} bytes without a NUL")]
    UnfitName {
        /// Position in the list of objects, from 0.
        index: usize,
    },
    /// More objects than [`MAX_OBJECTS`], or a buffer too small for them.
    #[error("{objects} objects do not fit into a buffer of {capacity} bytes (at most {MAX_OBJECTS} in a frame)")]
    Full {
        /// Objects to be encoded.
        objects: usize,
        /// Size of the caller's buffer in bytes.
        capacity: usize,
    },
}

/// A datagram whose structure has been checked to the end.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    number: u32,
    items: u8,
    body: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Checks a datagram and gives access to its objects; nothing is copied.
    pub fn decode(datagram: &'a [u8]) -> Result<Self, ViconError> {
        let len = datagram.len();
        let mut reader = Reader(datagram);
        let (Some(number), Some(items)) = (reader.u32(), reader.u8()) else {
            return Err(ViconError::Truncated { len, item: 0, items: 0 });
        };
        let frame = Self { number, items, body: reader.0 };
        for item in 1..=items {
            read_item(&mut reader, item, items, len)?;
        }
        Ok(frame)
    }

    /// Frame number, increasing by one with each camera frame.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// The tracked objects in the order of the datagram; items of another kind are skipped.
    pub fn objects(&self) -> impl Iterator<Item = Object<'a>> + use<'a> {
        let mut reader = Reader(self.body);
        let items = self.items;
        // `decode` has walked over the same items, so an error can no longer occur.
        (1..=items).filter_map(move |item| read_item(&mut reader, item, items, 0).ok().flatten())
    }

    /// The object with this name, if the frame has it.
    pub fn object(&self, name: &str) -> Option<Object<'a>> {
        self.objects().find(|object| object.name == name)
    }
}

/// Reads one item; `None` for an item that is no object.
fn read_item<'a>(reader: &mut Reader<'a>, item: u8, items: u8, len: usize) -> Result<Option<Object<'a>>, ViconError> {
    let truncated = ViconError::Truncated { len, item, items };
    let id = reader.u8().ok_or(truncated)?;
    let size = reader.u16().ok_or(truncated)?;
    let mut body = Reader(reader.slice(size.into()).ok_or(truncated)?);
    if id != OBJECT_ID {
        return Ok(None);
    }
    let short = ViconError::ShortObject { item, size };
    let name = body.slice(NAME_LEN).ok_or(short)?;
    let name = name.split(|byte| *byte == 0).next().unwrap_or_default();
    let name = core::str::from_utf8(name).map_err(|_| ViconError::Name { item })?;
    let position_mm = body.f64x3().ok_or(short)?;
    let rotation_rad = body.f64x3().ok_or(short)?;
    Ok(Some(Object { name, position_m: position_mm.map(|mm| mm * M_PER_MM), rotation_rad }))
}

/// Writes one frame into `buffer` and returns its length in bytes; [`MAX_DATAGRAM_LEN`] bytes are always enough.
pub fn encode(number: u32, objects: &[Object<'_>], buffer: &mut [u8]) -> Result<usize, ViconError> {
    let full = ViconError::Full { objects: objects.len(), capacity: buffer.len() };
    if objects.len() > MAX_OBJECTS {
        return Err(full);
    }
    if let Some(index) = objects.iter().position(|object| !fits(object.name)) {
        return Err(ViconError::UnfitName { index });
    }
    let mut writer = Writer::new(buffer);
    write_frame(number, objects, &mut writer).ok_or(full)?;
    Ok(writer.len())
}

fn fits(name: &str) -> bool {
    name.len() <= NAME_LEN && !name.contains('\0')
}

fn write_frame(number: u32, objects: &[Object<'_>], writer: &mut Writer<'_>) -> Option<()> {
    writer.put(&number.to_le_bytes())?;
    writer.put(&[objects.len() as u8])?;
    for object in objects {
        writer.put(&[OBJECT_ID])?;
        writer.put(&(OBJECT_BODY_LEN as u16).to_le_bytes())?;
        writer.put(object.name.as_bytes())?;
        writer.put([0; NAME_LEN].get(object.name.len()..)?)?;
        for metres in object.position_m {
            writer.put(&(metres / M_PER_MM).to_le_bytes())?;
        }
        for radians in object.rotation_rad {
            writer.put(&radians.to_le_bytes())?;
        }
    }
    Some(())
}
