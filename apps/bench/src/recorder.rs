//! What the recorder costs a byte, against the bare MCAP writer with the same samples and the same compression.

use fss_bus::{Bus, Output, OutputPort, Runner, Time};
use fss_estimation::statistics::median;
use fss_messages::{CDR_HEADER, Header, NavState, Sample, topic};
use fss_recorder::Recorder;
use fss_records::log::LogWriter;
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use miette::{IntoDiagnostic, Result, WrapErr};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;
use zerocopy::IntoBytes;

/// Each has its turn so many times; medians are told.
const ROUNDS: usize = 9;
/// Steps of the recorder in a turn, at 50 Hz.
const STEPS: u64 = 3000;
/// Samples a step.
const BATCH: u64 = 20;

/// What the benchmark found.
#[derive(Serialize)]
pub(crate) struct RecorderTimes {
    format: &'static str,
    bytes: u64,
    rounds: usize,
    /// From the bus to the file, ns a byte.
    recorder_ns_per_byte: f64,
    /// The bare writer, ns a byte.
    bare_ns_per_byte: f64,
    recorder_mb_per_s: f64,
    bare_mb_per_s: f64,
    ratio: f64,
}

/// Measures in a folder of its own within `folder`, and leaves nothing there.
pub(crate) fn measure(folder: &Path) -> Result<RecorderTimes> {
    let folder = folder.join(format!("fss-bench-{}", std::process::id()));
    std::fs::create_dir_all(&folder).into_diagnostic().wrap_err_with(|| format!("cannot make {}", folder.display()))?;
    let outcome = in_turns(&folder);
    let _best_effort = std::fs::remove_dir_all(&folder);
    outcome
}

fn in_turns(folder: &Path) -> Result<RecorderTimes> {
    let bytes = STEPS * BATCH * size_of::<NavState>() as u64;
    let (mut ours, mut bare) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        ours.push(run_recorder(&folder.join("ours.mcap"))? / bytes as f64);
        bare.push(run_bare(&folder.join("bare.mcap"))? / bytes as f64);
    }
    let (ours, bare) = (median(&mut ours).unwrap_or(f64::NAN), median(&mut bare).unwrap_or(f64::NAN));
    Ok(RecorderTimes {
        format: "fss-bench-recorder/1",
        bytes,
        rounds: ROUNDS,
        recorder_ns_per_byte: ours,
        bare_ns_per_byte: bare,
        recorder_mb_per_s: 1e3 / ours,
        bare_mb_per_s: 1e3 / bare,
        ratio: ours / bare,
    })
}

/// A state of a base that drifts and trembles, so that compression has real work.
fn sample(i: u64) -> NavState {
    let t_s = i as f64 * 0.001;
    let tremble = (t_s * 12_345.678).sin() * 1e-4;
    let stamp_ns = 1_000_000_000 + i * 1_000_000;
    NavState {
        stamp_ns,
        x_m: 0.01 * t_s + tremble,
        y_m: tremble * tremble,
        theta_rad: 0.1 * t_s.sin() + tremble,
        omega_rad_s: 0.1 * t_s.cos() - tremble,
        std: [1e-3; 7],
        mocap_age_ns: i % 10 * 1_000_000,
        ..NavState::default()
    }
}

/// All that the recorder does, on one thread: from the bus through its blocks to the file. Time, ns.
fn run_recorder(path: &Path) -> Result<f64> {
    let bus = Bus::local();
    let file = PathBuf::from(path);
    let recorder = Recorder::waiting(&bus, Box::new(move |_| LogWriter::create(&file))).into_diagnostic()?;
    let mut recorder = Runner::new(recorder, &bus).into_diagnostic()?;
    let mut nav = Output::open(&bus, topic::NAV_STATE).into_diagnostic()?;
    let start = Instant::now();
    for step in 0..STEPS {
        for i in step * BATCH..(step + 1) * BATCH {
            let state = sample(i);
            nav.publish(state);
            nav.flush(Time::from_ns(state.stamp_ns));
        }
        recorder.step(Time::from_ns(1_000_000_000 + (step + 1) * BATCH * 1_000_000));
    }
    recorder.service.finish().into_diagnostic()?;
    Ok(start.elapsed().as_secs_f64() * 1e9)
}

/// The library's writer and nothing else. Time, ns.
fn run_bare(path: &Path) -> Result<f64> {
    let start = Instant::now();
    let mut log = WriteOptions::new()
        .compression(Some(Compression::Zstd))
        .compression_level(1)
        .compression_threads(0)
        .create(BufWriter::new(File::create(path).into_diagnostic()?))
        .into_diagnostic()?;
    let schema = log.add_schema("NavState", "ros2msg", NavState::definition().as_bytes()).into_diagnostic()?;
    let channel = log.add_channel(schema, "/nav/state", "cdr", &BTreeMap::new()).into_diagnostic()?;
    let mut record = Vec::new();
    for i in 0..STEPS * BATCH {
        let mut state = sample(i);
        state.set_header(Header { sequence: i + 1, stamp_ns: state.stamp_ns, published_ns: state.stamp_ns });
        record.clear();
        record.extend_from_slice(&CDR_HEADER);
        record.extend_from_slice(state.as_bytes());
        let (log_time, publish_time) = (state.stamp_ns, state.stamp_ns);
        let header = MessageHeader { channel_id: channel, sequence: i as u32, log_time, publish_time };
        log.write_to_known_channel(&header, &record).into_diagnostic()?;
    }
    log.finish().into_diagnostic()?;
    log.into_inner().flush().into_diagnostic()?;
    Ok(start.elapsed().as_secs_f64() * 1e9)
}

impl RecorderTimes {
    /// The table for a person.
    pub(crate) fn print(&self) {
        say!("recorder          {:.2} ns a byte, {:.0} MB/s", self.recorder_ns_per_byte, self.recorder_mb_per_s);
        say!("bare MCAP writer  {:.2} ns a byte, {:.0} MB/s", self.bare_ns_per_byte, self.bare_mb_per_s);
        say!("ratio             {:.2}, medians of {} turns of {} bytes", self.ratio, self.rounds, self.bytes);
    }
}
