//! The frame that commands and telemetry share: header, length, checksum.

use super::{DATAGRAM_LEN, LinkError, Mode, VERSION};
use crate::bytes::{Reader, Writer};
use crc::{CRC_32_ISO_HDLC, Crc, Table};

const MAGIC: [u8; 4] = *b"FSSL";
const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// Bit of the mode's byte: the gripper shall be closed.
const GRIPPER: u8 = 0x80;

/// The fields that both kinds share.
pub(super) struct Header {
    pub(super) link: u8,
    pub(super) mode: Mode,
    /// Of commands only.
    pub(super) gripper: bool,
    pub(super) sequence: u64,
    pub(super) time_ns: u64,
}

/// Builds a datagram field by field; both kinds are equally long.
pub(super) struct Fields {
    bytes: [u8; DATAGRAM_LEN],
    len: usize,
}

impl Fields {
    /// Begins with the header.
    pub(super) fn begin(kind: u8, header: &Header) -> Self {
        let mut fields = Self { bytes: [0; DATAGRAM_LEN], len: 0 };
        fields.put(MAGIC);
        let gripper = if header.gripper { GRIPPER } else { 0 };
        fields.put([VERSION, kind, header.link, header.mode as u8 | gripper]);
        fields.put(header.sequence.to_le_bytes());
        fields.put(header.time_ns.to_le_bytes());
        fields
    }

    pub(super) fn put<const N: usize>(&mut self, value: [u8; N]) {
        let mut writer = Writer::new(self.bytes.get_mut(self.len..).unwrap_or_default());
        if writer.put(&value).is_some() {
            self.len += N;
        }
    }

    pub(super) fn so_far(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    /// Appends the checksum.
    pub(super) fn finish(mut self) -> [u8; DATAGRAM_LEN] {
        let checksum = CRC.checksum(self.so_far());
        self.put(checksum.to_le_bytes());
        self.bytes
    }
}

/// Checks everything that both kinds share and hands back the header and what follows it.
pub(super) fn open(datagram: &[u8], kind: u8) -> Result<(Header, Reader<'_>), LinkError> {
    let length = LinkError::Length { len: datagram.len() };
    let (body, checksum) = datagram.split_last_chunk::<4>().ok_or(length)?;
    let mut reader = Reader(body);
    if reader.array().ok_or(length)? != MAGIC {
        return Err(LinkError::Magic);
    }
    let version = reader.u8().ok_or(length)?;
    if version != VERSION {
        return Err(LinkError::Version(version));
    }
    if datagram.len() != DATAGRAM_LEN {
        return Err(length);
    }
    if u32::from_le_bytes(*checksum) != CRC.checksum(body) {
        return Err(LinkError::Checksum);
    }
    let found = reader.u8().ok_or(length)?;
    if found != kind {
        return Err(LinkError::Kind(found, kind));
    }
    let link = reader.u8().ok_or(length)?;
    if link == 0 {
        return Err(LinkError::Link);
    }
    let byte = reader.u8().ok_or(length)?;
    // Telemetry has no gripper to close: there the bit is no mode.
    let gripper = kind == super::KIND_COMMAND && byte & GRIPPER != 0;
    let mode = if gripper { byte & !GRIPPER } else { byte };
    let header = Header {
        link,
        gripper,
        mode: Mode::from_u8(mode).ok_or(LinkError::Mode(mode))?,
        sequence: reader.u64().ok_or(length)?,
        time_ns: reader.u64().ok_or(length)?,
    };
    Ok((header, reader))
}

/// Refuses a number that is infinite or none.
pub(super) fn finite(value: f32) -> Result<f32, LinkError> {
    if value.is_finite() { Ok(value) } else { Err(LinkError::NotFinite) }
}
