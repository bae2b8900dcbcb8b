//! What goes with each sample from one vehicle's bridge to another's.
//!
//! The sample itself travels as it lies in shared memory. Beside it goes an envelope of [`ENVELOPE_LEN`] bytes, little endian
//! and packed:
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 0 | u8\[4\] | magic, `FSSB` |
//! | 4 | u32 | version, 1 |
//! | 8 | u64 | hash of the sample's layout |
//! | 16 | u64 | session: calendar time at which the sending bridge started (ns since 1970) |
//! | 24 | u64 | number: counts the samples of this topic in this session from 1 |
//! | 32 | u64 | time of sending on the monotonic clock of the sending host (ns) |
//!
//! The same key addresses both: [`key`] gives `fss/VEHICLE/TOPIC`.

/// Bytes of an envelope.
pub const ENVELOPE_LEN: usize = 40;
const MAGIC: [u8; 4] = *b"FSSB";
const VERSION: u32 = 1;

/// Why an envelope cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum EnvelopeError {
    /// Not the length of an envelope.
    #[error("envelope of {0} bytes, expected {ENVELOPE_LEN}")]
    Length(usize),
    /// It does not begin with `FSSB`.
    #[error("envelope without the magic `FSSB`")]
    Magic,
    /// Of another version of this protocol.
    #[error("envelope of version {0}, this build speaks version {VERSION}")]
    Version(u32),
}

/// What the receiver's gates look at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Envelope {
    /// Hash of the sample's layout.
    pub layout: u64,
    /// When the sending bridge started, by the calendar (ns since 1970).
    pub session: u64,
    /// Counts the samples of the topic in the session from 1.
    pub number: u64,
    /// Time of sending on the sender's monotonic clock (ns).
    pub sent_ns: u64,
}

impl Envelope {
    /// As it travels.
    pub fn encode(&self) -> [u8; ENVELOPE_LEN] {
        let mut bytes = [0; ENVELOPE_LEN];
        bytes[..4].copy_from_slice(&MAGIC);
        bytes[4..8].copy_from_slice(&VERSION.to_le_bytes());
        let words = [self.layout, self.session, self.number, self.sent_ns];
        for (slot, word) in bytes[8..].chunks_exact_mut(8).zip(words) {
            slot.copy_from_slice(&word.to_le_bytes());
        }
        bytes
    }

    /// Reads one.
    pub fn decode(bytes: &[u8]) -> Result<Self, EnvelopeError> {
        let bytes: &[u8; ENVELOPE_LEN] = bytes.try_into().map_err(|_| EnvelopeError::Length(bytes.len()))?;
        if bytes[..4] != MAGIC {
            return Err(EnvelopeError::Magic);
        }
        let mut words = [0; 5];
        for (word, chunk) in words.iter_mut().zip(bytes.as_chunks::<8>().0) {
            *word = u64::from_le_bytes(*chunk);
        }
        let [head, layout, session, number, sent_ns] = words;
        let version = (head >> 32) as u32;
        if version != VERSION {
            return Err(EnvelopeError::Version(version));
        }
        Ok(Self { layout, session, number, sent_ns })
    }
}

/// The key under which a vehicle's topic travels: `fss/chaser/nav/state` for `/nav/state` of `chaser`.
pub fn key(vehicle: &str, topic: &str) -> String {
    format!("fss/{vehicle}{topic}")
}
