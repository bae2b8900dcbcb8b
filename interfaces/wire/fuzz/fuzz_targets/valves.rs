//! A valve line of any bytes gives no more frames than it has room for, and a frame sent twice after it arrives.
#![no_main]

use fss_wire::valves::{Decoder, FRAME_LEN, ValveFrame};

libfuzzer_sys::fuzz_target!(|stream: &[u8]| {
    let mut decoder = Decoder::new();
    let frames = stream
        .iter()
        .filter(|byte| decoder.push(**byte).is_some())
        .count();
    assert!(frames * FRAME_LEN <= stream.len());
    let shut = ValveFrame {
        mask: 0,
        counter: 1,
    }
    .encode();
    let last = shut
        .iter()
        .chain(&shut)
        .filter_map(|byte| decoder.push(*byte))
        .last();
    assert_eq!(last.map(|frame| frame.mask), Some(0));
});
