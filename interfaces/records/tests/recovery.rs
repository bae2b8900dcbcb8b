//! A log that was killed at any byte, or damaged at any, gives back all that it can.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_messages::{Header, NavState, Sample, ThrustersState, topic};
use fss_records::log::{Log, LogWriter, Recovered};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const SECOND_NS: u64 = 1_000_000_000;
/// Between two samples: 200 a second, as fusion makes them.
const PERIOD_NS: u64 = 5_000_000;
const SAMPLES: u64 = 1600;

fn header(i: u64) -> Header {
    Header { sequence: i + 1, stamp_ns: i * PERIOD_NS, published_ns: i * PERIOD_NS }
}

fn nav(i: u64) -> NavState {
    // Digits that compression cannot foresee.
    let noise = (i as f64 * 12.9898).sin() * 43_758.545;
    let mut sample = NavState { x_m: noise, vy_m_s: noise.cos(), std: [noise.sin(); 7], ..NavState::default() };
    sample.set_header(header(i));
    sample
}

fn valves(i: u64) -> ThrustersState {
    let mut sample = ThrustersState { valve_count: 8, open_time_ns: [i * i; 16], ..ThrustersState::default() };
    sample.set_header(header(i));
    sample
}

/// A log of 8 s, and how long the file was after each sample.
struct Written {
    folder: tempfile::TempDir,
    bytes: Vec<u8>,
    lengths: Vec<u64>,
}

impl Written {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let mut log = LogWriter::create(&path).unwrap();
        let (navigation, state) = (
            log.add_topic::<NavState>(topic::NAV_STATE.name).unwrap(),
            log.add_topic::<ThrustersState>(topic::THRUSTERS_STATE.name).unwrap(),
        );
        log.attach("plant.toml", "application/toml", "[base]\n").unwrap();
        log.metadata("fss", BTreeMap::from([("seed".to_owned(), "7".to_owned())])).unwrap();
        let mut lengths = Vec::new();
        for i in 0..SAMPLES {
            log.write(navigation, &nav(i)).unwrap();
            log.write(state, &valves(i)).unwrap();
            lengths.push(std::fs::metadata(&path).unwrap().len());
        }
        log.finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        Self { folder, bytes, lengths }
    }

    fn recover(&self, bytes: &[u8]) -> (PathBuf, Recovered) {
        let (broken, whole) = (self.folder.path().join("broken.mcap"), self.folder.path().join("whole.mcap"));
        std::fs::write(&broken, bytes).unwrap();
        let recovered = Log::open(&broken).unwrap().recover_to(&whole).unwrap();
        (whole, recovered)
    }
}

/// The samples of both topics must be those that were written; says of which numbers.
fn numbers(path: &Path) -> (Vec<u64>, Vec<u64>) {
    let log = Log::open(path).unwrap();
    assert!(log.is_complete());
    let navigation: Vec<NavState> = log.samples(topic::NAV_STATE.name).unwrap();
    let states: Vec<ThrustersState> = log.samples(topic::THRUSTERS_STATE.name).unwrap();
    assert!(
        navigation.iter().all(|s| *s == nav(s.sequence - 1)) && states.iter().all(|s| *s == valves(s.sequence - 1))
    );
    (navigation.iter().map(|s| s.sequence - 1).collect(), states.iter().map(|s| s.sequence - 1).collect())
}

#[test]
fn a_recorder_killed_at_any_byte_leaves_all_but_its_last_second() {
    let written = Written::new();
    let seed = 20_261;
    println!("seed {seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let end_of_data = *written.lengths.last().unwrap();
    for _ in 0..150 {
        let cut = random.random_range(8..end_of_data);
        let (whole, recovered) = written.recover(&written.bytes[..cut as usize]);
        // It died, at the latest, when the file grew beyond the cut.
        let died = written.lengths.partition_point(|length| *length <= cut) as u64;
        let surely = died.saturating_sub(SECOND_NS / PERIOD_NS);
        let (navigation, states) = numbers(&whole);
        for survivors in [&navigation, &states] {
            assert!(survivors.iter().copied().eq(0..survivors.len() as u64), "cut at {cut}: a gap in the middle");
            assert!(survivors.len() as u64 >= surely, "cut at {cut}: {} of {surely} survived", survivors.len());
        }
        assert_eq!(recovered.messages as usize, navigation.len() + states.len());
        assert_eq!(recovered.damage.places, 0, "cut at {cut}");
    }
}

#[test]
fn a_flipped_byte_costs_at_most_the_second_in_which_it_lies() {
    let written = Written::new();
    let seed = 20_262;
    println!("seed {seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for _ in 0..150 {
        let (at, flip) = (random.random_range(8..written.bytes.len()), random.random_range(1..=255_u8));
        let mut bytes = written.bytes.clone();
        bytes[at] ^= flip;
        let (whole, _) = written.recover(&bytes);
        let (navigation, states) = numbers(&whole);
        for survivors in [navigation, states] {
            let lost: Vec<u64> = (0..SAMPLES).filter(|i| survivors.binary_search(i).is_err()).collect();
            let span = lost.last().map_or(0, |last| last - lost[0]) * PERIOD_NS;
            assert!(survivors.is_sorted() && span <= SECOND_NS, "byte {at} ^ {flip:#04x}: lost {lost:?}");
        }
    }
}

#[test]
fn a_recovered_log_keeps_its_files_and_facts_and_says_that_it_was_recovered() {
    let written = Written::new();
    let (whole, recovered) = written.recover(&written.bytes[..written.bytes.len() / 2]);
    let log = Log::open(&whole).unwrap();
    assert_eq!(log.attachment("plant.toml").unwrap().unwrap(), "[base]\n");
    assert_eq!(log.metadata("fss").unwrap().unwrap()["seed"], "7");
    let facts = log.metadata("fss-recover").unwrap().unwrap();
    assert_eq!(facts["messages"], recovered.messages.to_string());
    assert!(recovered.damage.cut_off_bytes > 0);
}

#[test]
fn a_file_of_random_bytes_gives_nothing_and_does_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("noise.mcap"), folder.path().join("out.mcap"));
    let seed = 20_263;
    println!("seed {seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for _ in 0..200 {
        // Small numbers are record names and lengths that fit: the reader's worst case.
        let byte = |random: &mut ChaCha8Rng| {
            if random.random_bool(0.7) { random.random_range(0..16) } else { random.random() }
        };
        let mut bytes = mcap::MAGIC.to_vec();
        bytes.extend((0..random.random_range(0..4000)).map(|_| byte(&mut random)));
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(Log::open(&path).unwrap().recover_to(&out).unwrap().messages, 0);
    }
    std::fs::write(&path, b"no log at all").unwrap();
    assert!(Log::open(&path).is_err());
}
