//! The DSP-3000's line, seen from outside.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_wire::dsp3000::{Decoder, LINEAR_RANGE_RAD_S, Line, Mode, Reading, Request, ZERO_LETTER};
use proptest::prelude::*;

fn read(bytes: &[u8]) -> Vec<Reading> {
    let mut decoder = Decoder::new();
    bytes.iter().filter_map(|byte| decoder.push(*byte)).collect()
}

#[test]
fn a_line_has_the_form_of_the_units_manual() {
    let reading = Reading { value_rad: (-12.345678_f64).to_radians(), valid: true };
    assert_eq!(Line::encode(reading).as_bytes(), b"-012.345678 1\r\n");
    let fault = Reading { value_rad: 90.0_f64.to_radians(), valid: false };
    assert_eq!(Line::encode(fault).as_bytes(), b"090.000000 0\r\n");
}

#[test]
fn degrees_on_the_line_are_radians_in_the_reading() {
    let readings = read(b"\n180.000000 1\r\n-000.500000 0\r\n");
    assert_eq!(readings.len(), 2);
    assert!((readings[0].value_rad - std::f64::consts::PI).abs() < 1e-15);
    assert!(readings[0].valid && !readings[1].valid);
    assert!((readings[1].value_rad + 0.5_f64.to_radians()).abs() < 1e-15);
}

#[test]
fn the_piece_of_a_line_with_which_the_stream_begins_is_not_believed() {
    // Of "123.456789 1" only the end was seen: it looks like a line and is none.
    let readings = read(b"3.456789 1\r\n001.000000 1\r\n");
    assert_eq!(readings.len(), 1);
    assert!((readings[0].value_rad - 1.0_f64.to_radians()).abs() < 1e-15);
}

#[test]
fn a_spoilt_line_costs_itself_only_and_is_counted() {
    let mut decoder = Decoder::new();
    let stream = b"\n001.000000 1\r\n00x.000000 1\r\n001.0000 1\r\n001.000000 2\r\n\xff\xfe rubbish that goes on and on and on\n002.000000 1\r\n";
    let readings: Vec<_> = stream.iter().filter_map(|byte| decoder.push(*byte)).collect();
    assert_eq!(readings.len(), 2);
    assert_eq!(decoder.rejected(), 4);
}

#[test]
fn a_rate_beyond_the_linear_range_is_not_usable_even_if_flagged_valid() {
    let reading = |value_rad, valid| Reading { value_rad, valid };
    assert!(reading(LINEAR_RANGE_RAD_S, true).is_usable_rate());
    assert!(!reading(-1.01 * LINEAR_RANGE_RAD_S, true).is_usable_rate());
    assert!(!reading(0.1, false).is_usable_rate());
    assert!(!reading(f64::NAN, true).is_usable_rate());
}

#[test]
fn a_rate_that_is_none_goes_out_as_a_fault() {
    for value_rad in [f64::NAN, f64::INFINITY] {
        assert_eq!(Line::encode(Reading { value_rad, valid: true }).as_bytes(), b"000.000000 0\r\n");
    }
    assert_eq!(Line::encode(Reading { value_rad: -1e9, valid: true }).as_bytes(), b"-999.999999 1\r\n");
}

#[test]
fn letters_select_the_mode() {
    for mode in [Mode::Rate, Mode::IncrementalAngle, Mode::IntegratedAngle] {
        assert_eq!(Request::from_byte(mode.letter()), Some(Request::Select(mode)));
        assert_eq!(Request::from_byte(mode.letter().to_ascii_lowercase()), Some(Request::Select(mode)));
    }
    assert_eq!(Request::from_byte(ZERO_LETTER), Some(Request::Zero));
    assert_eq!(Request::from_byte(b'\r'), None);
}

proptest! {
    #[test]
    fn what_the_gyro_sends_is_what_is_read(degrees in -999.0..999.0_f64, valid: bool) {
        let sent = Reading { value_rad: degrees.to_radians(), valid };
        let mut stream = b"\n".to_vec();
        stream.extend_from_slice(Line::encode(sent).as_bytes());
        let readings = read(&stream);
        prop_assert_eq!(readings.len(), 1);
        prop_assert_eq!(readings[0].valid, valid);
        // Half of the line's last digit.
        prop_assert!((readings[0].value_rad - sent.value_rad).abs() < 0.51e-6_f64.to_radians());
    }

    #[test]
    fn any_bytes_leave_the_decoder_ready_for_the_next_line(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let mut stream = bytes;
        stream.extend_from_slice(b"\n-001.500000 1\r\n");
        let last = read(&stream).pop().unwrap();
        prop_assert!((last.value_rad + 1.5_f64.to_radians()).abs() < 1e-15);
    }
}
