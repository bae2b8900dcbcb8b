//! Writing ROS 2 messages that hold text or lists: XCDR1, little endian.

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
