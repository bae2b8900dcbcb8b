//! The virtual valve line between the thrusters driver and the simulated laboratory: a Unix stream socket that stands in
//! for eight GPIO lines of one request.
//!
//! Each frame sets all lines at once, 8 bytes, little endian and packed:
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 0 | u8 | magic, `V` |
//! | 1 | u16 | valve mask, bit 0 is thruster 1, set is open |
//! | 3 | u32 | counter, one more with each frame (wraps) |
//! | 7 | u8 | CRC-8 (polynomial 0x07, initial value 0) of bytes 0 to 6 |
//!
//! A connection that closes lets the lines fall: a pull-down shuts every valve, as on the real board when the driver's
//! process dies. There is no other time-out here; commands that stop are the `thrusters` service's business.

use crate::bytes::{Reader, Writer};
use crc::{CRC_8_SMBUS, Crc, Table};

/// Bytes of one frame.
pub const FRAME_LEN: usize = 8;

const MAGIC: u8 = b'V';
const CHECKED_LEN: usize = 7;
const CRC: Crc<u8, Table<1>> = Crc::<u8, Table<1>>::new(&CRC_8_SMBUS);

/// The state of all lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ValveFrame {
    /// Open valves; bit 0 is thruster 1.
    pub mask: u16,
    /// Number of the frame; wraps.
    pub counter: u32,
}

impl ValveFrame {
    /// The frame's bytes.
    pub fn encode(&self) -> [u8; FRAME_LEN] {
        let [mask0, mask1] = self.mask.to_le_bytes();
        let [count0, count1, count2, count3] = self.counter.to_le_bytes();
        let checked = [MAGIC, mask0, mask1, count0, count1, count2, count3];
        let mut frame = [0; FRAME_LEN];
        let mut writer = Writer::new(&mut frame);
        let _fits = writer.put(&checked).and_then(|()| writer.put(&[CRC.checksum(&checked)]));
        frame
    }

    /// Reads a frame; `None` when magic or checksum are wrong.
    pub fn decode(bytes: &[u8; FRAME_LEN]) -> Option<Self> {
        let mut reader = Reader(bytes);
        let magic = reader.u8()?;
        let mask = reader.u16()?;
        let counter = reader.u32()?;
        let checksum = reader.u8()?;
        let right = magic == MAGIC && checksum == CRC.checksum(bytes.get(..CHECKED_LEN)?);
        right.then_some(Self { mask, counter })
    }
}

/// Finds frames in a stream of bytes; after garbage it slides on byte by byte until a frame fits.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    window: [u8; FRAME_LEN],
    len: usize,
    skipped: u64,
}

impl Decoder {
    /// A decoder at the start of a connection.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the next byte; a frame comes with its last byte.
    pub fn push(&mut self, byte: u8) -> Option<ValveFrame> {
        *self.window.get_mut(self.len)? = byte;
        self.len += 1;
        if self.len < FRAME_LEN {
            return None;
        }
        let frame = ValveFrame::decode(&self.window);
        if frame.is_some() {
            self.len = 0;
        } else {
            self.window.rotate_left(1);
            self.len -= 1;
            self.skipped += 1;
        }
        frame
    }

    /// Bytes skipped so far because no frame began with them.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }
}
