//! Valid frames, damaged in ways that networks and serial lines know: bits turned, bytes lost, doubled and inserted, pieces
//! of frames joined. `tests/fuzz` at the top holds every reader to less, for
//! any bytes.
//!
//! The seed is printed; `FSS_FUZZ_SEED` and `FSS_FUZZ_ROUNDS` repeat or prolong a run.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_wire::{bridge, dsp3000, link, valves, vicon};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Damages copies of `frames` at random and hands each to `check`.
fn damage(frames: &[Vec<u8>], mut check: impl FnMut(&[u8])) {
    let seed = setting("FSS_FUZZ_SEED", 20_261_121);
    let rounds = setting("FSS_FUZZ_ROUNDS", 20_000);
    println!("seed {seed}, {rounds} rounds");
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for _ in 0..rounds {
        let mut bytes = frames[rng.random_range(0..frames.len())].clone();
        for _ in 0..rng.random_range(1..4) {
            mutate(&mut bytes, frames, &mut rng);
        }
        check(&bytes);
    }
}

fn mutate(bytes: &mut Vec<u8>, frames: &[Vec<u8>], rng: &mut ChaCha8Rng) {
    let at = rng.random_range(0..=bytes.len());
    match rng.random_range(0..6) {
        0 if at < bytes.len() => bytes[at] ^= 1 << rng.random_range(0..8),
        1 if at < bytes.len() => bytes[at] = [0, 1, 0x7f, 0x80, 0xff][rng.random_range(0..5)],
        2 => bytes.truncate(at),
        3 => bytes.insert(at, rng.random()),
        4 => bytes.extend_from_within(at..),
        _ => {
            bytes.truncate(at);
            let other = &frames[rng.random_range(0..frames.len())];
            bytes.extend(&other[rng.random_range(0..=other.len())..]);
        }
    }
    bytes.truncate(4096);
}

#[test]
fn damaged_vicon_datagrams_never_give_more_than_they_hold() {
    let object = vicon::Object { name: "base", position_m: [1.0, 2.0, 0.1], rotation_rad: [0.0, 0.0, 0.5] };
    let frames: Vec<_> = (0..4)
        .map(|objects| {
            let mut buffer = [0; vicon::MAX_DATAGRAM_LEN];
            let len = vicon::encode(objects as u32, &vec![object; objects], &mut buffer).unwrap();
            buffer[..len].to_vec()
        })
        .collect();
    let (mut read, mut refused) = (0, 0);
    damage(&frames, |bytes| match vicon::Frame::decode(bytes) {
        Ok(frame) => {
            assert!(frame.objects().count() * vicon::OBJECT_LEN + vicon::HEADER_LEN <= bytes.len());
            read += 1;
        }
        Err(_) => refused += 1,
    });
    assert!(read > 100 && refused > 100, "the damage reaches both ends: {read} read, {refused} refused");
}

#[test]
fn damaged_link_datagrams_are_refused() {
    let key = link::Key::new(&[7; 32]).unwrap();
    let command =
        link::Command { link: 1, mode: link::Mode::Current, current_a: 0.5, ..Default::default() }.encode(&key);
    let telemetry = link::Telemetry { link: 2, battery_v: 14.4, ..Default::default() }.encode();
    let frames = [command.to_vec(), telemetry.to_vec()];
    damage(&frames, |bytes| {
        let untouched = frames.iter().any(|frame| frame == bytes);
        let accepted = link::Command::decode(bytes, &key).is_ok() || link::Telemetry::decode(bytes).is_ok();
        assert_eq!(accepted, untouched, "{bytes:02x?}");
    });
}

#[test]
fn a_damaged_envelope_is_refused_or_says_what_its_bytes_say() {
    let envelope = bridge::Envelope { layout: 0x0123_4567_89ab_cdef, session: 1, number: 2, sent_ns: 3 };
    let (mut read, mut refused) = (0, 0);
    damage(&[envelope.encode().to_vec()], |bytes| match bridge::Envelope::decode(bytes) {
        Ok(envelope) => {
            assert_eq!(envelope.encode(), bytes);
            read += 1;
        }
        Err(_) => refused += 1,
    });
    assert!(read > 100 && refused > 100, "the damage reaches both ends: {read} read, {refused} refused");
}

#[test]
fn a_damaged_gyro_stream_is_read_again_one_line_later() {
    let lines: Vec<_> = [-0.5, 0.0, 0.001, 3.0]
        .map(|value_rad| dsp3000::Line::encode(dsp3000::Reading { value_rad, valid: true }).as_bytes().to_vec())
        .into();
    let mut decoder = dsp3000::Decoder::new();
    damage(&lines, |bytes| {
        let readings = bytes.iter().filter(|byte| decoder.push(**byte).is_some()).count();
        assert!(readings <= 1 + bytes.len() / 11);
        let whole: Vec<_> = lines[0].iter().chain(&lines[0]).filter_map(|byte| decoder.push(*byte)).collect();
        assert!((whole.last().unwrap().value_rad + 0.5).abs() < 1e-7);
    });
}

#[test]
fn a_damaged_valve_stream_opens_no_valve_that_was_not_asked_for() {
    let frames: Vec<_> =
        [0, 0x01, 0x24, 0x81].map(|mask| valves::ValveFrame { mask, counter: 77 }.encode().to_vec()).into();
    let (mut right, mut wrong) = (0, 0);
    damage(&frames, |bytes| {
        let mut decoder = valves::Decoder::new();
        for frame in bytes.iter().filter_map(|byte| decoder.push(*byte)) {
            let known = frames.iter().any(|sent| *sent == frame.encode());
            *(if known { &mut right } else { &mut wrong }) += 1;
        }
    });
    // Eight check bits let one heavily damaged frame in 256 through; the transport (a Unix socket) damages none.
    assert!(wrong * 200 < right, "{wrong} wrong of {right}");
}
