//! A link datagram of any bytes is read or refused; what is read encodes to the same bytes.
//!
//! Checksum and tag keep the fuzzer out of the body, so it also tries the datagram with the checksum repaired.
#![no_main]

use fss_wire::link::{Command, Key, Telemetry};

libfuzzer_sys::fuzz_target!(|datagram: &[u8]| {
    let Ok(key) = Key::new(&[7; 32]) else { return };
    check(datagram, &key);
    if let Some((body, _)) = datagram.split_last_chunk::<4>() {
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(body);
        check(&[body, &crc.to_le_bytes()].concat(), &key);
    }
});

fn check(datagram: &[u8], key: &Key) {
    if let Ok(command) = Command::decode(datagram, key) {
        assert_eq!(command.encode(key), datagram);
    }
    if let Ok(telemetry) = Telemetry::decode(datagram) {
        assert_eq!(telemetry.encode(), datagram);
    }
}
