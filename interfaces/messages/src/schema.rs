//! What a sample says about itself: fields, constants, ROS 2 definition, layout hash.

use iceoryx2::prelude::ZeroCopySend;
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

/// The first three fields of every sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// Counts the samples of one publisher from 1; a gap is a loss. The publisher's port sets it.
    pub sequence: u64,
    /// Time of measurement, ns on the monotonic clock.
    pub stamp_ns: u64,
    /// Time of publication, ns on the monotonic clock. The publisher's port sets it.
    pub published_ns: u64,
}

impl Header {
    /// Of a sample as it lies in memory; none where that is too short.
    pub fn of_sample(sample: &[u8]) -> Option<Self> {
        let number = |at: usize| Some(u64::from_le_bytes(*sample.get(at..)?.first_chunk()?));
        Some(Self { sequence: number(0)?, stamp_ns: number(8)?, published_ns: number(16)? })
    }
}

/// A primitive of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Scalar {
    U8,
    U16,
    U32,
    U64,
    I64,
    F64,
}

impl Scalar {
    /// Size and alignment in bytes.
    pub const fn size(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::U32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// The name in a ROS 2 message definition.
    pub const fn ros_name(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::U16 => "uint16",
            Self::U32 => "uint32",
            Self::U64 => "uint64",
            Self::I64 => "int64",
            Self::F64 => "float64",
        }
    }
}

/// A Rust type that may be a field of a sample.
pub trait FieldType {
    /// The primitive.
    const SCALAR: Scalar;
    /// How many of them; `None` for a single one.
    const COUNT: Option<usize>;
}

macro_rules! field_types {
    ($($rust:ty => $scalar:ident),*) => {$(
        impl FieldType for $rust {
            const SCALAR: Scalar = Scalar::$scalar;
            const COUNT: Option<usize> = None;
        }
        impl<const N: usize> FieldType for [$rust; N] {
            const SCALAR: Scalar = Scalar::$scalar;
            const COUNT: Option<usize> = Some(N);
        }
    )*};
}
field_types!(u8 => U8, u16 => U16, u32 => U32, u64 => U64, i64 => I64, f64 => F64);

/// One field of a sample; of a [`Definition`](crate::Definition) with owned text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field<Text = &'static str> {
    /// Its name, with the unit where it has one.
    pub name: Text,
    /// What it means, frames and all.
    pub doc: Text,
    /// The primitive.
    pub scalar: Scalar,
    /// How many of them; `None` for a single one.
    pub count: Option<usize>,
    /// Where it starts in the sample, bytes.
    pub offset: usize,
}

impl<Text: AsRef<str>> Field<Text> {
    /// Whether it holds text, as its documentation says: UTF-8, filled with zeros.
    pub fn is_text(&self) -> bool {
        self.scalar == Scalar::U8 && self.count.is_some() && self.doc.as_ref().contains("UTF-8")
    }

    /// Whether it only fills the room that the layout needs.
    pub fn is_padding(&self) -> bool {
        self.name.as_ref().starts_with("reserved")
    }

    /// Its `i`-th value in a sample, as a number; none where the field or the sample has no such value.
    pub fn number(&self, i: usize, sample: &[u8]) -> Option<f64> {
        let size = self.scalar.size();
        let at = self.offset + i * size;
        let bytes = sample.get(at..at + size).filter(|_| i < self.count.unwrap_or(1))?;
        let mut word = [0; 8];
        word[..size].copy_from_slice(bytes);
        let word = u64::from_le_bytes(word);
        Some(match self.scalar {
            Scalar::F64 => f64::from_bits(word),
            Scalar::I64 => word as i64 as f64,
            _ => word as f64,
        })
    }

    /// How many bytes it has.
    pub fn size(&self) -> usize {
        self.scalar.size() * self.count.unwrap_or(1)
    }
}

/// A named value of a sample's `u8` field.
#[derive(Clone, Copy, Debug)]
pub struct Constant {
    /// Upper-case name.
    pub name: &'static str,
    /// Its value.
    pub value: u8,
    /// What it means.
    pub doc: &'static str,
}

/// A plain sample: see the crate's documentation for the rules that its layout obeys.
pub trait Sample:
    Copy + core::fmt::Debug + PartialEq + IntoBytes + FromBytes + Immutable + KnownLayout + ZeroCopySend + Send + 'static
{
    /// The ROS 2 package of the message.
    const PACKAGE: &'static str;
    /// The message's name, without its package.
    const NAME: &'static str;
    /// Under which the type travels through shared memory: `PACKAGE/NAME@HASH`.
    const TYPE_NAME: &'static str;
    /// What the sample is.
    const DOC: &'static str;
    /// Its fields in order, the header's first.
    const FIELDS: &'static [Field];
    /// Its named values.
    const CONSTANTS: &'static [Constant];
    /// FNV-1a hash of name, field names and types.
    const HASH: u64;

    /// The first three fields.
    fn header(&self) -> Header;
    /// Sets the first three fields.
    fn set_header(&mut self, header: Header);

    /// A sample of zeros.
    fn zeroed() -> Self {
        Self::new_zeroed()
    }

    /// The ROS 2 message definition (`.msg` text) with units and meaning as comments.
    fn definition() -> String {
        use core::fmt::Write;
        let mut msg = String::new();
        let mut line = |text: core::fmt::Arguments| {
            let _ = writeln!(msg, "{text}");
        };
        line(format_args!("# {}", Self::DOC));
        for c in Self::CONSTANTS {
            line(format_args!("uint8 {}={} # {}", c.name, c.value, c.doc));
        }
        for f in Self::FIELDS {
            let array = f.count.map_or(String::new(), |n| format!("[{n}]"));
            line(format_args!("{}{array} {} # {}", f.scalar.ros_name(), f.name, f.doc));
        }
        msg
    }
}

/// FNV-1a over `bytes`, from `hash`.
pub(crate) const fn fnv1a(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0100_0000_01b3);
        i += 1;
    }
    hash
}

/// Hash of a sample's name and fields: two layouts that differ in a name, a type, a count or an order differ in it.
pub const fn layout_hash(name: &str, fields: &[Field]) -> u64 {
    let mut hash = name_hash(name);
    let mut i = 0;
    while i < fields.len() {
        hash = field_hash(hash, fields[i].name, fields[i].scalar, fields[i].count);
        i += 1;
    }
    hash
}

/// The hash of a sample without fields.
pub(crate) const fn name_hash(name: &str) -> u64 {
    fnv1a(0xcbf2_9ce4_8422_2325, name.as_bytes())
}

/// The hash with one field more.
pub(crate) const fn field_hash(hash: u64, name: &str, scalar: Scalar, count: Option<usize>) -> u64 {
    let hash = fnv1a(fnv1a(hash, name.as_bytes()), scalar.ros_name().as_bytes());
    let count = match count {
        Some(n) => n as u64,
        None => 0,
    };
    fnv1a(hash, &count.to_le_bytes())
}

/// Whether each field starts where XCDR1 puts it and the sample ends with its last field.
pub const fn is_cdr_layout<Text>(fields: &[Field<Text>], size: usize) -> bool {
    let mut end: usize = 0;
    let mut i = 0;
    while i < fields.len() {
        let f = &fields[i];
        let align = f.scalar.size();
        let start = end.next_multiple_of(align);
        if start != end || f.offset != start {
            return false;
        }
        end = start
            + align
                * match f.count {
                    Some(n) => n,
                    None => 1,
                };
        i += 1;
    }
    end == size
}

/// `"PACKAGE/NAME@HASH"` as bytes, for the name under which a type travels through shared memory.
pub const fn type_name_bytes<const N: usize>(package: &str, name: &str, hash: u64) -> [u8; N] {
    let mut out = [0; N];
    let mut n = 0;
    let parts: [&[u8]; 4] = [package.as_bytes(), b"/", name.as_bytes(), b"@"];
    let mut p = 0;
    while p < parts.len() {
        let mut i = 0;
        while i < parts[p].len() {
            out[n] = parts[p][i];
            n += 1;
            i += 1;
        }
        p += 1;
    }
    let mut shift = 64;
    while shift > 0 {
        shift -= 4;
        out[n] = b"0123456789abcdef"[(hash >> shift) as usize & 15];
        n += 1;
    }
    out
}

/// Does something with a sample type.
pub trait SampleVisitor {
    /// Called once for each type.
    fn visit<T: Sample>(&mut self);
}

const _: () = assert!(cfg!(target_endian = "little"), "samples are the log's bytes: little endian");
const _: () = assert!(align_of::<u64>() == 8, "XCDR1 aligns 8-byte primitives to 8");
