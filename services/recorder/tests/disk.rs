//! Whatever the disk does, the recorder keeps its pace, counts what it cannot keep, and goes on when it can.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_bus::{Batch, Bus, InputPort, InputPorts, Output, OutputPort, OutputPorts, Service, Time};
use fss_messages::{Event, NavState, text_of, topic};
use fss_recorder::{AllTopics, Limits, Opener, Recorder};
use fss_records::log::{Log, LogWriter};
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::{Duration, Instant};

/// A file on a disk with little room, or one that stalls.
struct Disk {
    file: File,
    room: Arc<AtomicI64>,
    stalls: Arc<AtomicBool>,
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        while self.stalls.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        if self.room.fetch_sub(bytes.len() as i64, Ordering::Relaxed) < bytes.len() as i64 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Disk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

fn part(folder: &Path, number: u32) -> PathBuf {
    folder.join(format!("part{number}.mcap"))
}

/// Makes logs on such a disk.
fn opener(folder: &Path, room: &Arc<AtomicI64>, stalls: &Arc<AtomicBool>) -> Opener {
    let (folder, room, stalls) = (folder.to_owned(), room.clone(), stalls.clone());
    Box::new(move |number| {
        let path = part(&folder, number);
        let disk = Disk { file: File::create(&path).unwrap(), room: room.clone(), stalls: stalls.clone() };
        LogWriter::to(&path, Box::new(disk))
    })
}

/// A recorder beside a publisher of navigation states at 200 Hz.
struct Scene {
    recorder: Recorder,
    inputs: AllTopics,
    outputs: <Recorder as Service>::Outputs,
    nav: Output<NavState>,
    events: Batch<Event>,
    said: Vec<String>,
    step: u64,
}

impl Scene {
    fn new(open: Opener, limits: Limits) -> Self {
        let bus = Bus::local();
        Self {
            recorder: Recorder::threaded(&bus, open, limits).unwrap(),
            inputs: AllTopics::open(&bus).unwrap(),
            outputs: OutputPorts::open(&bus).unwrap(),
            nav: Output::open(&bus, topic::NAV_STATE).unwrap(),
            events: Batch::open(&bus, topic::EVENTS).unwrap(),
            said: Vec::new(),
            step: 0,
        }
    }

    /// 20 ms of flight: four states, one step of the recorder.
    fn step(&mut self) {
        for i in 0..4 {
            let stamp_ns = 1_000_000_000 + self.step * 20_000_000 + i * 5_000_000;
            let noise = (stamp_ns as f64).sin();
            self.nav.publish(NavState { stamp_ns, x_m: noise, std: [noise.cos(); 7], ..NavState::default() });
            self.nav.flush(Time::from_ns(stamp_ns));
        }
        self.step += 1;
        let now = Time::from_ns(1_000_000_000 + self.step * 20_000_000);
        self.inputs.refresh();
        self.recorder.step(now, &self.inputs, &mut self.outputs);
        self.outputs.flush(now);
        self.events.refresh();
        self.said.extend(self.events.samples().iter().map(|event| text_of(&event.text).to_owned()));
    }

    /// Steps until the condition holds, giving the tape's thread time between steps.
    fn step_until(&mut self, mut condition: impl FnMut(&Self) -> bool) {
        let start = Instant::now();
        while !condition(self) {
            self.step();
            std::thread::sleep(Duration::from_micros(200));
            assert!(
                start.elapsed() < Duration::from_mins(1),
                "it said {:?}",
                self.said.iter().take(20).collect::<Vec<_>>()
            );
        }
    }

    fn has_said(&self, words: &str) -> bool {
        self.said.iter().any(|said| said.contains(words))
    }
}

fn sequences(path: &Path) -> Vec<u64> {
    let samples: Vec<NavState> = Log::open(path).unwrap().samples(topic::NAV_STATE.name).unwrap();
    samples.iter().map(|sample| sample.sequence).collect()
}

fn no_stall() -> Arc<AtomicBool> {
    Arc::new(AtomicBool::new(false))
}

#[test]
fn a_long_flight_is_cut_into_logs_without_losing_a_sample() {
    let folder = tempfile::tempdir().unwrap();
    let room = Arc::new(AtomicI64::new(i64::MAX));
    let limits = Limits { rotate_bytes: Some(100_000), keep_free_bytes: 0 };
    let mut scene = Scene::new(opener(folder.path(), &room, &no_stall()), limits);
    scene.step_until(|scene| scene.step == 500);
    scene.recorder.finish().unwrap();
    let mut all = Vec::new();
    for number in 1..=4 {
        let path = part(folder.path(), number);
        assert!(Log::open(&path).unwrap().is_complete());
        all.extend(sequences(&path));
    }
    assert!(all.iter().copied().take(1500).eq(1..=1500), "a sample is missing or doubled");
}

#[test]
fn a_full_disk_ends_the_log_and_another_begins_when_there_is_room() {
    let folder = tempfile::tempdir().unwrap();
    let room = Arc::new(AtomicI64::new(100_000));
    let mut scene = Scene::new(opener(folder.path(), &room, &no_stall()), Limits::default());
    scene.step_until(|scene| scene.has_said("recording pauses"));
    scene.step_until(|scene| scene.has_said("/nav/state") && scene.has_said("samples lost"));
    room.store(i64::MAX, Ordering::Relaxed);
    scene.step_until(|scene| scene.has_said("recording goes on in part"));
    let before = scene.step;
    scene.step_until(|scene| scene.step == before + 100);
    let (lost, published) = (scene.recorder.lost(), 4 * scene.step);
    scene.recorder.finish().unwrap();
    // Every sample is in a log or counted as lost; an event that the recorder itself said may be lost too.
    let mut kept: Vec<u64> = Vec::new();
    for entry in std::fs::read_dir(folder.path()).unwrap() {
        kept.extend(Log::open(&entry.unwrap().path()).map_or(Vec::new(), |log| {
            log.samples::<NavState>(topic::NAV_STATE.name).unwrap().iter().map(|s| s.sequence).collect()
        }));
    }
    kept.sort_unstable();
    assert!(kept.windows(2).all(|pair| pair[0] < pair[1]), "a sample is doubled");
    let missing = published - kept.len() as u64;
    assert!(missing > 0 && lost >= missing && lost < missing + 200, "{missing} are missing, {lost} counted");
}

#[test]
fn a_disk_that_stalls_holds_up_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let (room, stalls) = (Arc::new(AtomicI64::new(i64::MAX)), no_stall());
    let mut scene = Scene::new(opener(folder.path(), &room, &stalls), Limits::default());
    scene.step_until(|scene| scene.step == 50);
    stalls.store(true, Ordering::Relaxed);
    // A minute of flight while the disk takes nothing: a recorder that waited for it would never come back.
    let before = scene.step;
    for _ in 0..6000 {
        scene.step();
    }
    assert_eq!(scene.step, before + 6000);
    assert!(scene.recorder.lost() == 0 || scene.has_said("/nav/state"), "losses are told");
    stalls.store(false, Ordering::Relaxed);
    let published = 4 * scene.step;
    scene.recorder.finish().unwrap();
    let kept = sequences(&part(folder.path(), 1)).len() as u64;
    let facts = Log::open(&part(folder.path(), 1)).unwrap().metadata("fss-recorder").unwrap().unwrap();
    let lost = facts.get("lost /nav/state").map_or(0, |text| text.parse().unwrap());
    assert_eq!(kept + lost, published, "every sample is kept or counted");
}

#[test]
fn a_disk_that_is_nearly_full_is_left_to_others() {
    let folder = tempfile::tempdir().unwrap();
    let room = Arc::new(AtomicI64::new(i64::MAX));
    let limits = Limits { rotate_bytes: None, keep_free_bytes: u64::MAX };
    let mut scene = Scene::new(opener(folder.path(), &room, &no_stall()), limits);
    scene.step_until(|scene| scene.has_said("the disk has no room"));
    scene.recorder.finish().unwrap();
    assert!(Log::open(&part(folder.path(), 1)).unwrap().is_complete());
}
