//! The serial line of the KVH DSP-3000, a one-axis fibre-optic gyro (RS-232, 38400 baud, 8N1).
//!
//! About 100 times a second, by its own clock that may be 2 to 3 % off, the unit sends one ASCII line
//!
//! ```text
//! (-)xxx.xxxxxx y\r\n
//! ```
//!
//! The number is in degrees per second, the mean rate since the last line, when the unit is in mode `R`; `y` is `1` for a
//! valid reading and `0` for a fault. Nothing protects the line against a changed digit: gate what it says. The scale is
//! linear to [`LINEAR_RANGE_RAD_S`]. Which way is positive depends on how the unit is mounted, so the sign is for the
//! reader to apply.

/// The unit's output is linear within this rate (rad/s), 375 deg/s; far beyond it is wrong whatever the flag says.
pub const LINEAR_RANGE_RAD_S: f64 = 375.0 * core::f64::consts::PI / 180.0;

/// Longest line that [`Line`] holds and [`Decoder`] accepts, in bytes, its end included.
pub const MAX_LINE_LEN: usize = 16;

const MAX_DEG: f64 = 999.999_999;

/// What the unit sends; selected by writing the mode's [letter](Self::letter) to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Mean rate since the last line (deg/s on the wire).
    Rate,
    /// Angle turned since the last line (deg on the wire).
    IncrementalAngle,
    /// Angle turned since the integrator was zeroed (deg on the wire).
    IntegratedAngle,
}

impl Mode {
    /// The letter that selects the mode.
    pub const fn letter(self) -> u8 {
        match self {
            Self::Rate => b'R',
            Self::IncrementalAngle => b'A',
            Self::IntegratedAngle => b'P',
        }
    }
}

/// The letter that zeroes the integrated angle.
pub const ZERO_LETTER: u8 = b'Z';

/// What a byte sent to the unit asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Send this quantity from now on.
    Select(Mode),
    /// Set the integrated angle to zero.
    Zero,
}

impl Request {
    /// Reads one byte as the unit does: letters in either case, everything else is ignored.
    pub const fn from_byte(byte: u8) -> Option<Self> {
        match byte.to_ascii_uppercase() {
            b'R' => Some(Self::Select(Mode::Rate)),
            b'A' => Some(Self::Select(Mode::IncrementalAngle)),
            b'P' => Some(Self::Select(Mode::IntegratedAngle)),
            ZERO_LETTER => Some(Self::Zero),
            _ => None,
        }
    }
}

/// One reading of the gyro.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Rate (rad/s), or an angle (rad) in the two angle modes.
    pub value_rad: f64,
    /// The unit's own opinion of itself.
    pub valid: bool,
}

impl Reading {
    /// Whether a rate reading may be used: flagged valid, and within the range where the unit is linear.
    pub fn is_usable_rate(&self) -> bool {
        self.valid && self.value_rad.abs() <= LINEAR_RANGE_RAD_S
    }
}

/// One encoded line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Line {
    bytes: [u8; MAX_LINE_LEN],
    len: usize,
}

impl Line {
    /// Writes a reading as the unit does, rounded to 1e-6 degrees and held within three digits; a reading that is not
    /// finite becomes a zero that is flagged invalid.
    pub fn encode(reading: Reading) -> Self {
        let finite = reading.value_rad.is_finite();
        let degrees = if finite { reading.value_rad.to_degrees().clamp(-MAX_DEG, MAX_DEG) } else { 0.0 };
        let micro_degrees = (degrees * 1e6).round() as i64;
        let mut line = Self { bytes: [0; MAX_LINE_LEN], len: 0 };
        if micro_degrees < 0 {
            line.push(b'-');
        }
        let mut place = 100_000_000;
        while place > 0 {
            line.push(b'0' + (micro_degrees.abs() / place % 10) as u8);
            if place == 1_000_000 {
                line.push(b'.');
            }
            place /= 10;
        }
        line.push(b' ');
        line.push(if reading.valid && finite { b'1' } else { b'0' });
        line.push(b'\r');
        line.push(b'\n');
        line
    }

    /// The bytes that go over the serial line.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    fn push(&mut self, byte: u8) {
        if let Some(place) = self.bytes.get_mut(self.len) {
            *place = byte;
            self.len += 1;
        }
    }
}

/// Turns a stream of bytes into readings, whatever the pieces in which it comes.
///
/// It starts in the middle of a line and says nothing until that line has ended. A line that is none is counted and
/// skipped; the next one is read again.
#[derive(Debug, Clone)]
pub struct Decoder {
    line: [u8; MAX_LINE_LEN],
    len: usize,
    /// Within a line whose beginning was not seen, or that is too long to be one.
    skipping: bool,
    rejected: u64,
}

impl Default for Decoder {
    fn default() -> Self {
        Self { line: [0; MAX_LINE_LEN], len: 0, skipping: true, rejected: 0 }
    }
}

impl Decoder {
    /// A decoder for a stream that is joined at an unknown place.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes the next byte; a reading comes with the byte that ends its line.
    pub fn push(&mut self, byte: u8) -> Option<Reading> {
        if byte == b'\n' {
            let reading = if self.skipping { None } else { parse(self.line.get(..self.len)?) };
            if reading.is_none() && !self.skipping {
                self.rejected += 1;
            }
            self.skipping = false;
            self.len = 0;
            return reading;
        }
        if self.skipping {
            return None;
        }
        if let Some(place) = self.line.get_mut(self.len) {
            *place = byte;
            self.len += 1;
        } else {
            self.skipping = true;
            self.rejected += 1;
        }
        None
    }

    /// Lines refused so far; the part of a line with which the stream began is not one of them.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }
}

/// Reads `(-)xxx.xxxxxx y\r`. Blanks before the number and fewer than three digits before the point are accepted; the
/// six digits after it are not negotiable, so that a line which lost its end does not pass.
fn parse(line: &[u8]) -> Option<Reading> {
    let line = line.strip_suffix(b"\r").unwrap_or(line).trim_ascii_start();
    let (negative, line) = match line.strip_prefix(b"-") {
        Some(rest) => (true, rest),
        None => (false, line),
    };
    let point = line.iter().position(|byte| *byte == b'.')?;
    let (whole, rest) = line.split_at_checked(point)?;
    let (fraction, rest) = rest.get(1..)?.split_first_chunk::<6>()?;
    let valid = match rest {
        b" 1" => true,
        b" 0" => false,
        _ => return None,
    };
    if whole.is_empty() || whole.len() > 3 {
        return None;
    }
    let mut micro_degrees = 0_i64;
    for digit in whole.iter().chain(fraction) {
        if !digit.is_ascii_digit() {
            return None;
        }
        micro_degrees = 10 * micro_degrees + i64::from(digit - b'0');
    }
    let degrees = micro_degrees as f64 / 1e6;
    let value_rad = if negative { -degrees } else { degrees }.to_radians();
    Some(Reading { value_rad, valid })
}
