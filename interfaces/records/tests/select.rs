//! Samples selected from a log: with its summary, on all cores, as without.
#![allow(clippy::unwrap_used)]

use fss_messages::{GyroRate, Header, NavState, Sample};
use fss_records::log::{Layout, Log, LogWriter, Selection};
use std::path::Path;
use zerocopy::IntoBytes;

fn header(i: u64) -> Header {
    Header { sequence: i + 1, stamp_ns: i * 5_000_000, published_ns: i * 5_000_000 + 7 }
}

/// 30 s, with a gyro that speaks in the first second only.
fn write_log(path: &Path) {
    let mut log = LogWriter::create(path).unwrap();
    let (nav, gyro) = (log.add_topic::<NavState>("/nav/state").unwrap(), log.add_topic::<GyroRate>("/gyro").unwrap());
    for i in 0..6000 {
        let mut state = NavState { x_m: i as f64 * 0.5, omega_rad_s: (i as f64).sin(), ..NavState::default() };
        state.set_header(header(i));
        log.write(nav, &state).unwrap();
        if i < 200 {
            let mut rate = GyroRate { omega_rad_s: i as f64, ..GyroRate::default() };
            rate.set_header(header(i));
            log.write(gyro, &rate).unwrap();
        }
    }
    log.finish().unwrap();
}

/// A copy without the summary: its magic at the end is missing.
fn without_summary(path: &Path) -> std::path::PathBuf {
    let cut = path.with_extension("cut");
    let bytes = std::fs::read(path).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() - 1]).unwrap();
    cut
}

fn all_of(topics: &[&str]) -> Selection {
    let topics = topics.iter().map(|&topic| topic.to_owned()).collect();
    Selection { topics, fields: Vec::new(), log_time_ns: 0..=u64::MAX, most_rows: usize::MAX }
}

/// Blocks as they are given: topic, size of a sample, bytes.
fn select(path: &Path, selection: &Selection) -> Vec<(usize, usize, Vec<u8>)> {
    let mut blocks = Vec::new();
    let take = |topic, layout: &Layout, bytes| {
        blocks.push((topic, layout.size, bytes));
        true
    };
    Log::open(path).unwrap().select(selection, take).unwrap();
    blocks
}

#[test]
fn samples_are_the_same_with_a_summary_and_without() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    write_log(&path);
    let cut = without_summary(&path);
    let whole = Log::open(&path).unwrap().samples::<NavState>("/nav/state").unwrap();
    let both = all_of(&["/gyro", "/nav/state"]);
    let blocks = select(&path, &both);
    assert_eq!(blocks[1].2, whole.iter().flat_map(|sample| sample.as_bytes().to_vec()).collect::<Vec<_>>());
    for selection in [
        both.clone(),
        Selection { log_time_ns: 7_000_000_000..=9_000_000_007, ..both.clone() },
        Selection { most_rows: 77, ..both.clone() },
        Selection { fields: vec!["omega_rad_s".to_owned(), "sequence".to_owned()], ..both },
    ] {
        let sorted = |path| {
            // Blocks of two topics may come in another order; those of one topic may not.
            let mut blocks = select(path, &selection);
            blocks.sort_by_key(|(topic, _, _)| *topic);
            blocks
        };
        assert_eq!(sorted(&path), sorted(&cut), "{selection:?}");
    }
}

#[test]
fn a_field_alone_has_the_values_of_whole_samples() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    write_log(&path);
    let selection = Selection { fields: vec!["x_m".to_owned()], ..all_of(&["/nav/state"]) };
    let [(_, size, bytes)] = &select(&path, &selection)[..] else { panic!("not one block") };
    assert_eq!(*size, 8);
    let x_m: Vec<f64> = bytes.as_chunks().0.iter().map(|word| f64::from_le_bytes(*word)).collect();
    assert_eq!(x_m, (0..6000).map(|i| f64::from(i) * 0.5).collect::<Vec<_>>());
}

#[test]
fn a_damaged_chunk_of_a_whole_log_costs_itself_and_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    write_log(&path);
    let mut bytes = std::fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let chunk = &summary.chunk_indexes[20];
    bytes[(chunk.chunk_start_offset + chunk.chunk_length / 2) as usize] ^= 0x10;
    std::fs::write(&path, bytes).unwrap();
    let mut kept = 0;
    let take = |_, layout: &Layout, bytes: Vec<u8>| {
        kept += bytes.len() / layout.size;
        true
    };
    let damage = Log::open(&path).unwrap().select(&all_of(&["/nav/state"]), take).unwrap();
    assert_eq!(damage.places, 1);
    assert!((5700..6000).contains(&kept), "{kept} of 6000");
}

#[test]
fn who_has_enough_ends_the_reading() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    write_log(&path);
    for path in [path.clone(), without_summary(&path)] {
        let mut blocks = 0;
        let selection = Selection { most_rows: 100, ..all_of(&["/nav/state"]) };
        let take = |_, _: &Layout, _| {
            blocks += 1;
            blocks < 3
        };
        Log::open(&path).unwrap().select(&selection, take).unwrap();
        assert_eq!(blocks, 3);
    }
}
