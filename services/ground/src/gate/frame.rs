//! What the library says to a viewer, in pieces: the answer to its request, then WebSocket frames (RFC 6455, 5.2).

use std::io::{self, BufRead};

/// The library says nothing longer at once, bytes.
const LONGEST: u64 = 1 << 26;
/// The first byte of a binary message that is whole in one frame.
const WHOLE_BINARY: u8 = 0x82;
/// The first byte of what such a message says where it is a sample (Foxglove's "message data").
const SAMPLE: u8 = 1;

/// A frame, with its head as it came.
pub(super) struct Frame {
    pub(super) bytes: Vec<u8>,
    /// Whether it is a sample, which may be dropped; what else is said must be heard.
    pub(super) is_sample: bool,
}

/// The answer up to its empty line.
pub(super) fn read_answer(from: &mut impl BufRead) -> io::Result<Vec<u8>> {
    let mut answer = Vec::new();
    loop {
        let length = from.read_until(b'\n', &mut answer)?;
        if length == 0 || answer.ends_with(b"\r\n\r\n") {
            return Ok(answer);
        }
    }
}

/// The next frame; a server does not mask what it says.
pub(super) fn read_frame(from: &mut impl BufRead) -> io::Result<Frame> {
    let mut bytes = vec![0; 2];
    from.read_exact(&mut bytes)?;
    let short = bytes[1] & 0x7f;
    let head = match short {
        126 => 4,
        127 => 10,
        _ => 2,
    };
    bytes.resize(head, 0);
    from.read_exact(&mut bytes[2..])?;
    let long = bytes[2..].iter().fold(0, |length, byte| length << 8 | u64::from(*byte));
    let length = if head == 2 { u64::from(short) } else { long };
    if length > LONGEST {
        return Err(io::ErrorKind::InvalidData.into());
    }
    bytes.resize(head + length as usize, 0);
    from.read_exact(&mut bytes[head..])?;
    let is_sample = bytes[0] == WHOLE_BINARY && bytes.get(head) == Some(&SAMPLE);
    Ok(Frame { bytes, is_sample })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn frames_of_any_length_are_taken_whole_and_samples_are_told_from_words() {
        for (head, length) in
            [(vec![125], 125), (vec![126, 1, 44], 300), (vec![127, 0, 0, 0, 0, 0, 1, 17, 112], 70_000)]
        {
            for (first, says, is_sample) in [(0x82, 1, true), (0x82, 4, false), (0x81, 1, false), (0x02, 1, false)] {
                let frame = [&[first][..], &head, &vec![says; length]].concat();
                let mut stream = &[&frame[..], b"next"].concat()[..];
                let read = read_frame(&mut stream).unwrap();
                assert_eq!((read.bytes, read.is_sample, stream), (frame, is_sample, &b"next"[..]));
            }
        }
        assert!(read_frame(&mut &[0x82, 127, 255, 0, 0, 0, 0, 0, 0, 0][..]).is_err(), "nothing is that long");
        assert!(read_frame(&mut &[0x82, 5, 1, 2][..]).is_err(), "cut off");
    }
}
