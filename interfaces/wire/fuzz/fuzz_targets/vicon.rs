//! A VICON datagram of any bytes is read or refused, and holds every object that it gives.
#![no_main]

use fss_wire::vicon::{Frame, HEADER_LEN, OBJECT_LEN};

libfuzzer_sys::fuzz_target!(|datagram: &[u8]| {
    if let Ok(frame) = Frame::decode(datagram) {
        assert!(frame.objects().count() * OBJECT_LEN + HEADER_LEN <= datagram.len());
    }
});
