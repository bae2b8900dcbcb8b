//! The VICON object stream, seen from outside.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_wire::vicon::{Frame, HEADER_LEN, MAX_DATAGRAM_LEN, OBJECT_LEN, Object, ViconError, encode};
use proptest::prelude::*;

fn base() -> Object<'static> {
    Object { name: "base", position_m: [1.25, -0.5, 0.2], rotation_rad: [0.0, 0.01, -3.0] }
}

fn datagram(number: u32, objects: &[Object<'_>]) -> Vec<u8> {
    let mut buffer = [0; MAX_DATAGRAM_LEN];
    let len = encode(number, objects, &mut buffer).unwrap();
    buffer[..len].to_vec()
}

/// An item written field by field as in the table of the module documentation.
fn item(id: u8, name: &[u8], pose: [f64; 6], extra: &[u8]) -> Vec<u8> {
    let mut bytes = vec![id];
    bytes.extend((72 + extra.len() as u16).to_le_bytes());
    let mut padded = [0; 24];
    padded[..name.len()].copy_from_slice(name);
    bytes.extend(padded);
    bytes.extend(pose.iter().flat_map(|value| value.to_le_bytes()));
    bytes.extend(extra);
    bytes
}

#[test]
fn a_tracker_datagram_written_by_hand_reads_in_metres() {
    let mut bytes = vec![0x39, 0x30, 0, 0, 1];
    bytes.extend(item(0, b"target", [1500.0, -250.0, 3.0, 0.1, 0.2, 0.3], &[]));
    let frame = Frame::decode(&bytes).unwrap();
    assert_eq!(frame.number(), 12345);
    let object = frame.object("target").unwrap();
    assert_eq!(object.position_m, [1.5, -0.25, 0.003]);
    assert_eq!(object.rotation_rad, [0.1, 0.2, 0.3]);
    assert!(frame.object("base").is_none());
}

#[test]
fn longer_items_other_items_and_padding_do_not_hide_an_object() {
    let mut bytes = vec![1, 0, 0, 0, 3];
    bytes.extend(item(7, b"marker cloud", [9.0; 6], &[1, 2, 3]));
    bytes.extend(item(0, b"base", [1.0; 6], &[0xff; 9]));
    bytes.extend(item(0, b"end_effector", [2.0; 6], &[]));
    bytes.extend([0xaa; 100]);
    let names: Vec<_> = Frame::decode(&bytes).unwrap().objects().map(|object| object.name).collect();
    assert_eq!(names, ["base", "end_effector"]);
}

#[test]
fn every_shortened_datagram_is_called_truncated() {
    let whole = datagram(5, &[base(), Object { name: "target", ..base() }]);
    for len in 0..whole.len() {
        let error = Frame::decode(&whole[..len]).unwrap_err();
        assert!(matches!(error, ViconError::Truncated { .. }), "{len} bytes: {error}");
    }
}

#[test]
fn an_object_item_without_room_for_a_pose_is_refused() {
    let mut bytes = datagram(5, &[base()]);
    bytes[HEADER_LEN + 1] = 71;
    assert_eq!(Frame::decode(&bytes).unwrap_err(), ViconError::ShortObject { item: 1, size: 71 });
}

#[test]
fn a_name_that_is_no_text_is_refused() {
    let mut bytes = datagram(5, &[base()]);
    bytes[HEADER_LEN + 3] = 0xff;
    assert_eq!(Frame::decode(&bytes).unwrap_err(), ViconError::Name { item: 1 });
}

#[test]
fn zeros_and_numbers_that_are_none_are_not_tracked() {
    assert!(base().is_tracked());
    assert!(!Object { position_m: [0.0; 3], ..base() }.is_tracked());
    assert!(!Object { position_m: [0.0, f64::NAN, 0.0], ..base() }.is_tracked());
    assert!(!Object { rotation_rad: [0.0, 0.0, f64::INFINITY], ..base() }.is_tracked());
}

#[test]
fn what_does_not_fit_is_refused_by_the_encoder() {
    let mut buffer = [0; MAX_DATAGRAM_LEN];
    let full = encode(1, &[base(); 17], &mut buffer).unwrap_err();
    assert!(matches!(full, ViconError::Full { objects: 17, .. }));
    let small = encode(1, &[base()], &mut buffer[..HEADER_LEN + OBJECT_LEN - 1]).unwrap_err();
    assert!(matches!(small, ViconError::Full { objects: 1, .. }));
    for name in ["a name of twenty-five char", "nul\0inside"] {
        let unfit = encode(1, &[base(), Object { name, ..base() }], &mut buffer).unwrap_err();
        assert_eq!(unfit, ViconError::UnfitName { index: 1 });
    }
    assert_eq!(encode(1, &[base(); 16], &mut buffer).unwrap(), MAX_DATAGRAM_LEN);
}

proptest! {
    #[test]
    fn what_the_tracker_sends_is_what_is_read(
        number: u32,
        objects in prop::collection::vec(("[a-z_]{0,24}", prop::array::uniform3(-5.0..5.0), prop::array::uniform3(-4.0..4.0)), 0..=16),
    ) {
        let sent: Vec<_> = objects
            .iter()
            .map(|(name, position_m, rotation_rad)| Object { name, position_m: *position_m, rotation_rad: *rotation_rad })
            .collect();
        let bytes = datagram(number, &sent);
        let frame = Frame::decode(&bytes).unwrap();
        prop_assert_eq!(frame.number(), number);
        let read: Vec<_> = frame.objects().collect();
        prop_assert_eq!(read.len(), sent.len());
        for (read, sent) in read.iter().zip(&sent) {
            prop_assert_eq!(read.name, sent.name);
            prop_assert_eq!(read.rotation_rad, sent.rotation_rad);
            for axis in 0..3 {
                // Metres to millimetres and back may cost the last bit.
                prop_assert!((read.position_m[axis] - sent.position_m[axis]).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..1500)) {
        if let Ok(frame) = Frame::decode(&bytes) {
            prop_assert!(frame.objects().count() <= 255);
        }
    }
}
