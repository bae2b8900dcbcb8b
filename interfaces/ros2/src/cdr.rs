//! Writing and reading ROS 2 messages that hold text or lists: XCDR1, little endian.

use fss_messages::CDR_HEADER;

/// A message in the making; each primitive is aligned to its own size, counted from behind the encapsulation header.
#[derive(Default)]
pub struct Cdr(Vec<u8>);

impl Cdr {
    fn put(mut self, bytes: &[u8]) -> Self {
        self.0.resize(self.0.len().next_multiple_of(bytes.len()), 0);
        self.0.extend_from_slice(bytes);
        self
    }

    /// A number.
    pub fn u32(self, value: u32) -> Self {
        self.put(&value.to_le_bytes())
    }

    /// A byte.
    pub fn u8(self, value: u8) -> Self {
        self.put(&[value])
    }

    /// A number.
    pub fn f64(self, value: f64) -> Self {
        self.put(&value.to_le_bytes())
    }

    /// A text.
    pub fn text(self, text: &str) -> Self {
        let mut next = self.u32(text.len() as u32 + 1);
        next.0.extend_from_slice(text.as_bytes());
        next.0.push(0);
        next
    }

    /// A list: how many, then each.
    pub fn list<T>(self, items: &[T], each: impl Fn(Self, &T) -> Self) -> Self {
        items.iter().fold(self.u32(items.len() as u32), each)
    }

    /// `std_msgs/Header`.
    pub fn header(self, time_ns: u64, frame: &str) -> Self {
        self.u32((time_ns / 1_000_000_000) as u32).u32((time_ns % 1_000_000_000) as u32).text(frame)
    }

    /// A translation or position, then a rotation about the vertical as a quaternion: `geometry_msgs/Pose` and
    /// `geometry_msgs/Transform`.
    pub fn pose(self, [x_m, y_m, angle_rad]: [f64; 3], z_m: f64) -> Self {
        let (sin, cos) = (angle_rad / 2.0).sin_cos();
        [x_m, y_m, z_m, 0.0, 0.0, sin, cos].into_iter().fold(self, Self::f64)
    }

    /// The message with its encapsulation header.
    pub fn message(self) -> Vec<u8> {
        [&CDR_HEADER[..], &self.0].concat()
    }
}

/// A message that is read; what does not lie within it is none.
pub struct Reader<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// Of a message with its encapsulation header, which must say XCDR1, little endian.
    pub fn new(message: &'a [u8]) -> Option<Self> {
        let (header, body) = message.split_first_chunk::<4>()?;
        (header[..2] == CDR_HEADER[..2]).then_some(Self { body, at: 0 })
    }

    fn primitive<const N: usize>(&mut self) -> Option<[u8; N]> {
        let start = self.at.checked_next_multiple_of(N)?;
        let (value, _) = self.body.get(start..)?.split_first_chunk()?;
        self.at = start + N;
        Some(*value)
    }

    /// A number.
    pub fn u32(&mut self) -> Option<u32> {
        self.primitive().map(u32::from_le_bytes)
    }

    /// A number.
    pub fn f64(&mut self) -> Option<f64> {
        self.primitive().map(f64::from_le_bytes)
    }

    /// A text, without the zero at its end.
    pub fn text(&mut self) -> Option<&'a str> {
        let len = self.u32()? as usize;
        let bytes = self.body.get(self.at..self.at.checked_add(len)?)?;
        self.at += len;
        core::str::from_utf8(bytes.strip_suffix(&[0])?).ok()
    }

    /// `std_msgs/Header`: the time, ns since 1970, and the frame.
    pub fn header(&mut self) -> Option<(u64, &'a str)> {
        let (seconds, ns) = (self.u32()?, self.u32()?);
        (ns < 1_000_000_000).then_some(())?;
        Some((u64::from(seconds) * 1_000_000_000 + u64::from(ns), self.text()?))
    }

    /// Whether nothing is left but what fills up a multiple of four.
    pub fn is_at_end(&self) -> bool {
        self.body.len() - self.at < 4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn primitives_lie_where_xcdr1_puts_them() {
        let bytes = Cdr::default().text("map").u32(7).text("base").f64(1.0).message();
        let expected = [
            &[0, 1, 0, 0][..],
            &[4, 0, 0, 0],
            b"map\0",
            &[7, 0, 0, 0],
            &[5, 0, 0, 0],
            b"base\0\0\0\0", // up to 24, a multiple of 8
            &1.0_f64.to_le_bytes(),
        ];
        assert_eq!(bytes, expected.concat());
    }
}
