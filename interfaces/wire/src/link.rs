//! The datagrams between the vehicle's computer and one modular arm link, 5 times a second each way over UDP.
//!
//! Both kinds have [`DATAGRAM_LEN`] bytes, little endian and packed, and begin alike:
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 0 | u8\[4\] | magic, `FSSL` |
//! | 4 | u8 | version, 1 |
//! | 5 | u8 | kind: 1 command, 2 telemetry |
//! | 6 | u8 | link, counted from 1 at the base |
//! | 7 | u8 | mode: 0 disabled, 1 position, 2 velocity, 3 current; in commands plus 128 where the gripper shall be closed |
//! | 8 | u64 | sequence number, increasing |
//! | 16 | u64 | time of sending on the sender's own clock (ns, from an arbitrary start) |
//!
//! A **command** goes on with
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 24 | f32 | joint angle, encoder frame (rad) |
//! | 28 | f32 | joint rate (rad/s) |
//! | 32 | f32 | motor current (A) |
//! | 36 | f32 | largest torque that the driver may use (N m, at the joint) |
//! | 40 | u8\[16\] | tag: the first 16 bytes of HMAC-SHA-256 over bytes 0 to 39 with the shared [`Key`] |
//! | 56 | u32 | CRC-32 (ISO-HDLC, as in zlib) of bytes 0 to 55 |
//!
//! In position mode the target is the angle at reception and moves on at the rate given, so that a target sent 5 times a
//! second describes a smooth motion; in velocity mode the rate counts and in current mode the current.
//!
//! and **telemetry**, whose mode is the one that the driver is in, with
//!
//! | offset | type | field |
//! | --- | --- | --- |
//! | 24 | f32 | joint angle, encoder frame (rad) |
//! | 28 | f32 | joint rate (rad/s) |
//! | 32 | f32 | motor current (A) |
//! | 36 | i24 | torque sensor, two's complement [`TorqueCount`] |
//! | 39 | u8 | faults, bits of [`Faults`] |
//! | 40 | u64 | sequence number of the last command accepted, 0 before the first |
//! | 48 | f32 | battery voltage (V) |
//! | 52 | f32 | battery charge, 0 to 1 |
//! | 56 | u32 | CRC-32 (ISO-HDLC) of bytes 0 to 55 |
//!
//! A link whose commands stop disables its driver and says [`Faults::COMMAND_LOST`]. It accepts a command only when the
//! checksum and the tag are right, the link number is its own, and the sequence number is above that of every command
//! before ([`ReplayGuard`]); so neither a duplicate, nor one overtaken on the way, nor a recording moves the arm. A
//! sender that restarts continues above its old numbers: [`first_sequence`] gives a start from the calendar time.
//! Telemetry carries no tag: it commands nothing.

mod frame;
mod security;
mod torque;

pub use security::{Key, MIN_KEY_LEN, ReplayGuard, first_sequence};
pub use torque::TorqueCount;

use frame::{Fields, Header, finite, open};
use security::TAG_LEN;

/// Bytes of a datagram of either kind.
pub const DATAGRAM_LEN: usize = 60;

const VERSION: u8 = 1;
const KIND_COMMAND: u8 = 1;
const KIND_TELEMETRY: u8 = 2;
const TAGGED_LEN: usize = 40;

/// What the servo driver controls.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Mode {
    /// Driver off, the motor free.
    #[default]
    Disabled = 0,
    /// Joint angle.
    Position = 1,
    /// Joint rate.
    Velocity = 2,
    /// Motor current.
    Current = 3,
}

impl Mode {
    /// The mode with this number on the wire.
    pub const fn from_u8(number: u8) -> Option<Self> {
        match number {
            0 => Some(Self::Disabled),
            1 => Some(Self::Position),
            2 => Some(Self::Velocity),
            3 => Some(Self::Current),
            _ => None,
        }
    }
}

/// Faults that a link reports, a set of bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Faults(pub u8);

impl Faults {
    /// The driver or its encoder failed.
    pub const DRIVER: Self = Self(1);
    /// The torque sensor's converter is at its end.
    pub const TORQUE_SATURATED: Self = Self(1 << 1);
    /// The joint is at its limit and the driver holds it there.
    pub const JOINT_LIMIT: Self = Self(1 << 2);
    /// Commands stopped and the driver disabled itself.
    pub const COMMAND_LOST: Self = Self(1 << 3);
    /// The battery is nearly empty.
    pub const BATTERY_LOW: Self = Self(1 << 4);
    /// The driver gives less than asked because of its torque or current limit.
    pub const TORQUE_LIMIT: Self = Self(1 << 5);
    /// No fault: the gripper at the end of this link holds something.
    pub const GRIPPING: Self = Self(1 << 6);

    /// Whether all bits of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// These faults, and those of `other` if `present`.
    pub const fn with(self, other: Self, present: bool) -> Self {
        if present { Self(self.0 | other.0) } else { self }
    }
}

/// Why a datagram is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum LinkError {
    /// Not the length of a datagram.
    #[error("link datagram of {len} bytes, expected {DATAGRAM_LEN}")]
    Length {
        /// Bytes received.
        len: usize,
    },
    /// It does not begin with `FSSL`.
    #[error("link datagram without the magic `FSSL`")]
    Magic,
    /// Of another version of this protocol.
    #[error("link datagram of version {0}, this build speaks version {VERSION}")]
    Version(u8),
    /// Changed on its way.
    #[error("link datagram with a wrong checksum")]
    Checksum,
    /// Of the other kind, or of none.
    #[error("link datagram of kind {0}, expected {1}")]
    Kind(u8, u8),
    /// For link 0 (links count from 1), or where a receiver checks that, for another link.
    #[error("link datagram for link 0 or for another link")]
    Link,
    /// No such mode.
    #[error("link datagram with mode {0}, modes are 0 to 3")]
    Mode(u8),
    /// A number is infinite or not a number.
    #[error("link datagram with a value that is not finite")]
    NotFinite,
    /// Not signed with the shared key.
    #[error("link command with a wrong tag")]
    Tag,
    /// The sequence number is not above the last one accepted.
    #[error("link datagram {sequence} is a replay or was overtaken; the last accepted is {last}")]
    Replayed {
        /// Its sequence number.
        sequence: u64,
        /// The last one accepted.
        last: u64,
    },
    /// A secret that is too short to be one.
    #[error("link key of {len} bytes, at least {MIN_KEY_LEN} are needed")]
    ShortKey {
        /// Bytes of the secret.
        len: usize,
    },
}

/// What the vehicle's computer asks of a link.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Command {
    /// Link, from 1.
    pub link: u8,
    /// Number of the command; above all before it.
    pub sequence: u64,
    /// Time of sending on the sender's clock (ns).
    pub time_ns: u64,
    /// What the driver is to control.
    pub mode: Mode,
    /// Joint angle wanted, encoder frame (rad).
    pub position_rad: f32,
    /// Joint rate wanted, or the rate at which the position wanted moves on (rad/s).
    pub velocity_rad_s: f32,
    /// Motor current wanted (A).
    pub current_a: f32,
    /// Largest torque that the driver may use, at the joint (N m).
    pub max_torque_nm: f32,
    /// Whether the gripper at the end of this link shall be closed; a link without one does not care.
    pub gripper: bool,
}

impl Command {
    /// The datagram, signed with `key`.
    pub fn encode(&self, key: &Key) -> [u8; DATAGRAM_LEN] {
        let Self { link, mode, sequence, time_ns, gripper, .. } = *self;
        let mut fields = Fields::begin(KIND_COMMAND, &Header { link, mode, gripper, sequence, time_ns });
        for value in [self.position_rad, self.velocity_rad_s, self.current_a, self.max_torque_nm] {
            fields.put(value.to_le_bytes());
        }
        let tag = key.tag(fields.so_far());
        fields.put(tag);
        fields.finish()
    }

    /// Reads a datagram and checks form, checksum and tag; the caller checks `link` and the sequence number.
    pub fn decode(datagram: &[u8], key: &Key) -> Result<Self, LinkError> {
        let (header, mut body) = open(datagram, KIND_COMMAND)?;
        let short = LinkError::Length { len: datagram.len() };
        let command = Self {
            link: header.link,
            sequence: header.sequence,
            time_ns: header.time_ns,
            mode: header.mode,
            position_rad: finite(body.f32().ok_or(short)?)?,
            velocity_rad_s: finite(body.f32().ok_or(short)?)?,
            current_a: finite(body.f32().ok_or(short)?)?,
            max_torque_nm: finite(body.f32().ok_or(short)?)?,
            gripper: header.gripper,
        };
        let tag = body.array::<TAG_LEN>().ok_or(short)?;
        let tagged = datagram.get(..TAGGED_LEN).ok_or(short)?;
        if key.verifies(tagged, &tag) { Ok(command) } else { Err(LinkError::Tag) }
    }
}

/// What a link reports of itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Telemetry {
    /// Link, from 1.
    pub link: u8,
    /// Number of the report.
    pub sequence: u64,
    /// Time of measurement on the link's own clock (ns).
    pub time_ns: u64,
    /// What the driver controls now.
    pub mode: Mode,
    /// Joint angle, encoder frame (rad).
    pub position_rad: f32,
    /// Joint rate (rad/s).
    pub velocity_rad_s: f32,
    /// Motor current (A).
    pub current_a: f32,
    /// Torque sensor.
    pub torque: TorqueCount,
    /// What is wrong.
    pub faults: Faults,
    /// Sequence number of the last command accepted, 0 before the first.
    pub last_command: u64,
    /// Battery voltage (V).
    pub battery_v: f32,
    /// Battery charge, 0 to 1.
    pub battery_charge: f32,
}

impl Telemetry {
    /// The datagram.
    pub fn encode(&self) -> [u8; DATAGRAM_LEN] {
        let Self { link, mode, sequence, time_ns, .. } = *self;
        let mut fields = Fields::begin(KIND_TELEMETRY, &Header { link, mode, gripper: false, sequence, time_ns });
        for value in [self.position_rad, self.velocity_rad_s, self.current_a] {
            fields.put(value.to_le_bytes());
        }
        fields.put(self.torque.to_bytes());
        fields.put([self.faults.0]);
        fields.put(self.last_command.to_le_bytes());
        fields.put(self.battery_v.to_le_bytes());
        fields.put(self.battery_charge.to_le_bytes());
        fields.finish()
    }

    /// Reads a datagram and checks its form and checksum; the caller checks `link` and the sequence number.
    pub fn decode(datagram: &[u8]) -> Result<Self, LinkError> {
        let (header, mut body) = open(datagram, KIND_TELEMETRY)?;
        let short = LinkError::Length { len: datagram.len() };
        Ok(Self {
            link: header.link,
            sequence: header.sequence,
            time_ns: header.time_ns,
            mode: header.mode,
            position_rad: finite(body.f32().ok_or(short)?)?,
            velocity_rad_s: finite(body.f32().ok_or(short)?)?,
            current_a: finite(body.f32().ok_or(short)?)?,
            torque: TorqueCount::from_bytes(body.array().ok_or(short)?),
            faults: Faults(body.u8().ok_or(short)?),
            last_command: body.u64().ok_or(short)?,
            battery_v: finite(body.f32().ok_or(short)?)?,
            battery_charge: finite(body.f32().ok_or(short)?)?,
        })
    }
}
