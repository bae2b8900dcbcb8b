//! Every decoder and every reader of a file takes any bytes: it reads them or refuses them, and never panics.
//!
//! The kept inputs of `tests/fuzz/corpus` and the files that come with fss are tried as they are, then damaged at random.
//! The seed is printed; `FSS_FUZZ_SEED` and `FSS_FUZZ_ROUNDS` repeat or prolong a run, for one reader `FSS_FUZZ_ONLY`. An
//! input that breaks a reader is kept in its corpus.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

#[path = "fuzz/checks.rs"]
#[allow(unreachable_pub)] // fuzzers ask for them too
mod checks;

/// What numbers and words are replaced with.
const ODD: [&str; 22] = [
    "0",
    "-1",
    "1e308",
    "-1e308",
    "1e-320",
    "nan",
    "inf",
    "-inf",
    "18446744073709551615",
    "-9223372036854775808",
    "4.2",
    "''",
    "[]",
    "{}",
    "[[]]",
    "true",
    "\"ä\u{202e}\"",
    "1979-05-27",
    "64",
    "1_000_000",
    "\u{0}",
    "999999999999",
];

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

fn corpus(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fuzz/corpus").join(name)
}

/// Whole inputs to begin with.
fn seeds(name: &str) -> Vec<Vec<u8>> {
    let etc = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/etc");
    let own = match name {
        "plant" => Some(etc.join("plants")),
        "mission" => Some(etc.join("missions")),
        "launch" => Some(etc.join("launch")),
        "faults" => Some(etc.join("faults")),
        _ => None,
    };
    let folders = own.into_iter().chain([corpus(name)]);
    let files = folders.flat_map(|folder| std::fs::read_dir(folder).unwrap().flatten()).map(|entry| entry.path());
    let mut files: Vec<_> = files.collect();
    files.sort();
    files.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

/// Damages bytes as networks, disks and editors do.
fn damage(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], is_text: bool, rng: &mut ChaCha8Rng) {
    let at = rng.random_range(0..=bytes.len());
    let to = (at + rng.random_range(0..16)).min(bytes.len());
    match rng.random_range(0..if is_text { 10 } else { 6 }) {
        0 if at < bytes.len() => bytes[at] ^= 1 << rng.random_range(0..8),
        1 if at < bytes.len() => bytes[at] = [0, 1, 0x7f, 0x80, 0xff][rng.random_range(0..5)],
        2 => bytes.truncate(at),
        3 => bytes.insert(at, rng.random()),
        4 => drop(bytes.drain(at..to)),
        5 => {
            let other = &seeds[rng.random_range(0..seeds.len())];
            let from = rng.random_range(0..=other.len());
            let piece = &other[from..(from + rng.random_range(0..200)).min(other.len())];
            bytes.splice(at..to, piece.iter().copied());
        }
        6 | 7 => replace_word(bytes, at, rng),
        _ => move_line(bytes, rng),
    }
    bytes.truncate(1 << 20);
}

/// Puts something odd in place of the number or word around `at`.
fn replace_word(bytes: &mut Vec<u8>, at: usize, rng: &mut ChaCha8Rng) {
    let is_of_word = |byte: &u8| byte.is_ascii_alphanumeric() || b"._-+\"".contains(byte);
    let start = bytes[..at].iter().rposition(|byte| !is_of_word(byte)).map_or(0, |i| i + 1);
    let end = bytes[at..].iter().position(|byte| !is_of_word(byte)).map_or(bytes.len(), |i| at + i);
    bytes.splice(start..end, ODD[rng.random_range(0..ODD.len())].bytes());
}

/// Takes out a line, or puts it elsewhere, or twice.
fn move_line(bytes: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    let mut lines: Vec<Vec<u8>> = bytes.split_inclusive(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
    if lines.is_empty() {
        return;
    }
    let (from, to) = (rng.random_range(0..lines.len()), rng.random_range(0..lines.len()));
    match rng.random_range(0..3) {
        0 => drop(lines.remove(from)),
        1 => lines.swap(from, to),
        _ => lines.insert(to, lines[from].clone()),
    }
    *bytes = lines.concat();
}

/// Tries one input; keeps it where it breaks the reader.
fn try_input(name: &str, check: fn(&[u8]), bytes: &[u8]) {
    if catch_unwind(AssertUnwindSafe(|| check(bytes))).is_err() {
        let sum = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(bytes);
        let path = corpus(name).join(format!("broke-{sum:08x}"));
        std::fs::write(&path, bytes).unwrap();
        panic!("{name} breaks on {}", path.display());
    }
}

#[test]
fn no_bytes_from_outside_break_a_reader() {
    let seed = setting("FSS_FUZZ_SEED", 20_261_121);
    let rounds = setting("FSS_FUZZ_ROUNDS", 500);
    let only = std::env::var("FSS_FUZZ_ONLY").unwrap_or_default();
    println!("seed {seed}, {rounds} rounds for each reader");
    for (name, check) in checks::CHECKS.iter().filter(|(name, _)| only.is_empty() || *name == only) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let seeds = seeds(name);
        assert!(!seeds.is_empty(), "{name} has no corpus");
        for bytes in &seeds {
            try_input(name, *check, bytes);
        }
        let is_text = seeds.iter().all(|bytes| std::str::from_utf8(bytes).is_ok());
        for _ in 0..rounds {
            let mut bytes = seeds[rng.random_range(0..seeds.len())].clone();
            for _ in 0..rng.random_range(1..5) {
                damage(&mut bytes, &seeds, is_text, &mut rng);
            }
            try_input(name, *check, &bytes);
        }
        println!("{name}: {} kept inputs, {rounds} damaged ones", seeds.len());
    }
}
