//! A log gives back what was written, also when its end is missing.
#![allow(clippy::unwrap_used)]

use fss_messages::{Header, NavState, Sample, ThrustersCommand, topic};
use fss_records::log::{LOG_FILE, Log, LogWriter};
use std::collections::BTreeMap;

fn nav(i: u64) -> NavState {
    let mut sample = NavState { x_m: i as f64 * 0.5, theta_rad: -0.1, ..NavState::default() };
    sample.set_header(Header { sequence: i + 1, stamp_ns: i * 5_000_000, published_ns: i * 5_000_000 + 7 });
    sample
}

fn write_log(path: &std::path::Path, samples: u64) {
    let mut log = LogWriter::create(path).unwrap();
    let topic = log.add_topic::<NavState>(topic::NAV_STATE.name).unwrap();
    log.attach("plant.toml", "application/toml", "[base]\n").unwrap();
    log.metadata("fss", BTreeMap::from([("seed".to_owned(), "7".to_owned())])).unwrap();
    for i in 0..samples {
        log.write(topic, &nav(i)).unwrap();
    }
    log.finish().unwrap();
}

#[test]
fn a_log_gives_back_what_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    write_log(&path, 1000);
    let log = Log::open(&path).unwrap();
    let samples: Vec<NavState> = log.samples("/nav/state").unwrap();
    assert_eq!(samples, (0..1000).map(nav).collect::<Vec<_>>());
    assert!(log.is_complete());
    assert_eq!(log.attachment("plant.toml").unwrap().unwrap(), "[base]\n");
    assert!((log.topics().unwrap()[0].rate_hz().unwrap() - 200.0).abs() < 1e-6);
    assert!(log.gaps::<NavState>("/nav/state").unwrap().is_empty());
}

#[test]
fn a_run_is_read_by_the_name_of_its_folder() {
    let run = tempfile::tempdir().unwrap();
    write_log(&run.path().join(LOG_FILE), 10);
    let log = Log::open(run.path()).unwrap();
    assert_eq!(log.path(), run.path().join(LOG_FILE));
    assert!(log.is_complete());
}

#[test]
fn a_log_that_was_cut_off_gives_all_but_its_last_second() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    write_log(&path, 2000); // 10 s
    let whole = std::fs::read(&path).unwrap();
    let data_end = whole.len() - 1500; // within the last chunk or what follows it
    std::fs::write(&path, &whole[..data_end]).unwrap();
    let log = Log::open(&path).unwrap();
    let samples: Vec<NavState> = log.samples("/nav/state").unwrap();
    assert!(!log.is_complete());
    assert!(samples.len() >= 1800, "only {} of 2000 samples survived", samples.len());
    assert_eq!(samples[..], (0..samples.len() as u64).map(nav).collect::<Vec<_>>());
}

#[test]
fn a_topic_read_as_another_sample_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    write_log(&path, 3);
    let error = Log::open(&path).unwrap().samples::<ThrustersCommand>("/nav/state").unwrap_err();
    let text = error.to_string();
    assert!(text.contains("/nav/state") && text.contains("NavState") && text.contains("ThrustersCommand"), "{text}");
}
