//! The link datagrams, seen from outside.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_wire::link::{
    Command, DATAGRAM_LEN, Faults, Key, LinkError, Mode, ReplayGuard, Telemetry, TorqueCount, first_sequence,
};
use proptest::prelude::*;

fn key() -> Key {
    let secret: Vec<u8> = (0..32).collect();
    Key::new(&secret).unwrap()
}

fn command() -> Command {
    Command {
        link: 3,
        sequence: 1_000_001,
        time_ns: 2_000_000_000,
        mode: Mode::Position,
        position_rad: 0.5,
        velocity_rad_s: -0.25,
        current_a: 0.0,
        max_torque_nm: 1.5,
        gripper: false,
    }
}

fn telemetry() -> Telemetry {
    Telemetry {
        link: 4,
        sequence: 7,
        time_ns: 1_500_000_000,
        mode: Mode::Velocity,
        position_rad: -1.25,
        velocity_rad_s: 0.125,
        current_a: 0.75,
        torque: TorqueCount::new(-4_194_304),
        faults: Faults::TORQUE_SATURATED,
        last_command: 1_000_001,
        battery_v: 14.5,
        battery_charge: 0.875,
    }
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

// Golden bytes: written by an independent script (Python struct, hmac, hashlib, zlib) from the module's tables.
const COMMAND_HEX: &str = "4653534c0101030141420f000000000000943577000000000000003f000080be000000000000c03f4ceef5182a0c8ffcdc146c2ba9c17f8f20216806";
const TELEMETRY_HEX: &str = "4653534c010204020700000000000000002f6859000000000000a0bf0000003e0000403f0000c00241420f0000000000000068410000603f07dd4d7c";

#[test]
fn both_kinds_have_the_bytes_of_their_tables() {
    assert_eq!(command().encode(&key()).as_slice(), bytes(COMMAND_HEX));
    assert_eq!(telemetry().encode().as_slice(), bytes(TELEMETRY_HEX));
}

#[test]
fn every_single_bit_error_is_detected() {
    for (datagram, decode) in [
        (
            command().encode(&key()),
            (|bytes| Command::decode(bytes, &key()).map(|_| ())) as fn(&[u8]) -> Result<(), LinkError>,
        ),
        (telemetry().encode(), |bytes| Telemetry::decode(bytes).map(|_| ())),
    ] {
        assert_eq!(decode(&datagram), Ok(()));
        for bit in 0..8 * DATAGRAM_LEN {
            let mut spoilt = datagram;
            spoilt[bit / 8] ^= 1 << (bit % 8);
            assert!(decode(&spoilt).is_err(), "bit {bit}");
        }
    }
}

#[test]
fn a_stranger_who_repairs_the_checksum_still_fails_the_tag() {
    let stranger = Key::new(b"a key that nobody shares").unwrap();
    assert_eq!(Command::decode(&command().encode(&stranger), &key()), Err(LinkError::Tag));
}

#[test]
fn a_command_recorded_on_the_air_cannot_be_played_back() {
    let mut guard = ReplayGuard::default();
    let mut accept = |sequence| {
        let datagram = Command { sequence, ..command() }.encode(&key());
        guard.admit(Command::decode(&datagram, &key()).unwrap().sequence)
    };
    assert_eq!(accept(10), Ok(0));
    assert_eq!(accept(13), Ok(2), "two were lost on the way");
    assert_eq!(accept(13), Err(LinkError::Replayed { sequence: 13, last: 13 }), "a duplicate");
    assert_eq!(accept(11), Err(LinkError::Replayed { sequence: 11, last: 13 }), "overtaken");
    assert_eq!(accept(14), Ok(0));
    assert!(ReplayGuard::after(u64::MAX).admit(u64::MAX).is_err());
}

#[test]
fn a_restarted_sender_begins_above_its_old_numbers() {
    let started_ns = 1_790_000_000_000_000_000;
    let sent_in_an_hour = 3600 * 5;
    assert!(first_sequence(started_ns + 3_600_000_000_000) > first_sequence(started_ns) + sent_in_an_hour);
}

#[test]
fn the_wrong_kind_version_length_or_magic_is_named() {
    let datagram = command().encode(&key());
    assert_eq!(Telemetry::decode(&datagram), Err(LinkError::Kind(1, 2)));
    assert_eq!(Command::decode(&telemetry().encode(), &key()), Err(LinkError::Kind(2, 1)));
    assert_eq!(Telemetry::decode(&datagram[..59]), Err(LinkError::Length { len: 59 }));
    assert_eq!(Telemetry::decode(&[]), Err(LinkError::Length { len: 0 }));
    let mut other = datagram;
    other[4] = 2;
    assert_eq!(Telemetry::decode(&other), Err(LinkError::Version(2)));
    other[0] = b'X';
    assert_eq!(Telemetry::decode(&other), Err(LinkError::Magic));
}

#[test]
fn a_signed_command_with_a_number_that_is_none_is_refused() {
    let odd = Command { current_a: f32::NAN, ..command() };
    assert_eq!(Command::decode(&odd.encode(&key()), &key()), Err(LinkError::NotFinite));
    let nobody = Command { link: 0, ..command() };
    assert_eq!(Command::decode(&nobody.encode(&key()), &key()), Err(LinkError::Link));
}

#[test]
fn a_key_too_short_to_be_secret_is_refused_and_none_is_printed() {
    assert_eq!(Key::new(b"password").unwrap_err(), LinkError::ShortKey { len: 8 });
    assert_eq!(format!("{:?}", key()), "Key(secret)");
}

#[test]
fn the_end_values_of_the_converter_are_no_torque() {
    let full_scale_nm = 2.1;
    for torque_nm in [2.2, -2.2, f64::INFINITY] {
        let count = TorqueCount::from_torque(torque_nm, full_scale_nm);
        assert!(count.is_saturated());
        assert_eq!(count.torque_nm(full_scale_nm), None);
        let read = Telemetry::decode(&Telemetry { torque: count, ..telemetry() }.encode()).unwrap();
        assert!(read.torque.is_saturated());
    }
    let torque_nm = TorqueCount::from_torque(-1.234, full_scale_nm).torque_nm(full_scale_nm).unwrap();
    assert!((torque_nm + 1.234).abs() < full_scale_nm / f64::from(TorqueCount::MAX));
}

proptest! {
    #[test]
    fn a_command_arrives_as_it_was_sent(
        link in 1..=u8::MAX, sequence: u64, time_ns: u64, mode in 0..4_u8,
        values in prop::array::uniform4(-1e6..1e6_f32),
    ) {
        let [position_rad, velocity_rad_s, current_a, max_torque_nm] = values;
        let mode = Mode::from_u8(mode).unwrap();
        let sent = Command { link, sequence, time_ns, mode, position_rad, velocity_rad_s, current_a, max_torque_nm, gripper: sequence % 2 == 1 };
        prop_assert_eq!(Command::decode(&sent.encode(&key()), &key()), Ok(sent));
    }

    #[test]
    fn telemetry_arrives_as_it_was_sent(
        link in 1..=u8::MAX, sequence: u64, time_ns: u64, mode in 0..4_u8, count in TorqueCount::MIN..=TorqueCount::MAX,
        faults: u8, last_command: u64, values in prop::array::uniform5(-1e6..1e6_f32),
    ) {
        let [position_rad, velocity_rad_s, current_a, battery_v, battery_charge] = values;
        let sent = Telemetry {
            link, sequence, time_ns, mode: Mode::from_u8(mode).unwrap(), position_rad, velocity_rad_s, current_a,
            torque: TorqueCount::new(count), faults: Faults(faults), last_command, battery_v, battery_charge,
        };
        prop_assert_eq!(Telemetry::decode(&sent.encode()), Ok(sent));
    }

    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..100)) {
        prop_assert!(Command::decode(&bytes, &key()).is_err());
        prop_assert!(Telemetry::decode(&bytes).is_err());
    }
}
