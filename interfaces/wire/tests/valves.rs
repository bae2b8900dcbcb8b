//! The virtual valve line, seen from outside.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_wire::valves::{Decoder, FRAME_LEN, ValveFrame};
use proptest::prelude::*;

fn read(bytes: &[u8]) -> Vec<ValveFrame> {
    let mut decoder = Decoder::new();
    bytes.iter().filter_map(|byte| decoder.push(*byte)).collect()
}

#[test]
fn a_frame_has_the_bytes_of_its_table() {
    // Source: written by an independent script (Python struct, bitwise CRC-8).
    let frame = ValveFrame { mask: 0x0081, counter: 258 };
    assert_eq!(frame.encode(), [0x56, 0x81, 0x00, 0x02, 0x01, 0x00, 0x00, 0xd8]);
}

#[test]
fn every_single_bit_error_is_refused() {
    let frame = ValveFrame { mask: 0x0081, counter: 258 }.encode();
    for bit in 0..8 * FRAME_LEN {
        let mut spoilt = frame;
        spoilt[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(ValveFrame::decode(&spoilt), None, "bit {bit}");
    }
}

proptest! {
    #[test]
    fn frames_survive_the_stream_in_order(masks in prop::collection::vec(any::<u16>(), 0..20)) {
        let sent: Vec<_> = masks.iter().zip(0..).map(|(mask, counter)| ValveFrame { mask: *mask, counter }).collect();
        let stream: Vec<u8> = sent.iter().flat_map(ValveFrame::encode).collect();
        prop_assert_eq!(read(&stream), sent);
    }

    #[test]
    fn after_garbage_the_line_is_found_again(garbage in prop::collection::vec(any::<u8>(), 0..100)) {
        let shut = ValveFrame { mask: 0, counter: 9 };
        let mut stream = garbage;
        // One frame may be swallowed by garbage that happens to look like the start of one; the second one is not.
        stream.extend(shut.encode());
        stream.extend(shut.encode());
        prop_assert_eq!(read(&stream).pop(), Some(shut));
    }
}
