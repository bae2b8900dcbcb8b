//! A gyro stream of any bytes gives finite readings, and the line after it is read.
#![no_main]

use fss_wire::dsp3000::Decoder;

libfuzzer_sys::fuzz_target!(|stream: &[u8]| {
    let mut decoder = Decoder::new();
    for reading in stream.iter().filter_map(|byte| decoder.push(*byte)) {
        assert!(reading.value_rad.is_finite());
    }
    assert!(
        b"\n001.500000 1\r\n"
            .iter()
            .filter_map(|byte| decoder.push(*byte))
            .last()
            .is_some()
    );
});
