//! Every service gives the same bits again from the inputs that a log holds; and where a log lies, replay says where.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{Sample, SampleVisitor};
use fss_records::log::{Log, LogWriter};
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const SERVICES: [&str; 6] = ["fusion", "links", "mission", "arm", "base", "thrusters"];

fn fss(arguments: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_fss")).args(arguments).output().unwrap();
    assert!(output.status.success(), "fss {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// Exit code and answer of `fss replay`.
fn replay(log: &Path) -> (i32, Value) {
    let output = Command::new(env!("CARGO_BIN_EXE_fss")).args(["replay", "--json"]).arg(log).output().unwrap();
    let answer = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&output.stderr)));
    (output.status.code().unwrap(), answer)
}

fn of_service<'a>(answer: &'a Value, name: &str) -> &'a Value {
    answer["services"].as_array().unwrap().iter().find(|v| v["service"] == name).unwrap()
}

fn assert_identical(log: &Path) -> Value {
    let (code, answer) = replay(log);
    assert_eq!((code, &answer["identical"]), (0, &Value::Bool(true)), "{answer:#}");
    for name in SERVICES {
        let verdict = of_service(&answer, name);
        assert!(verdict["steps"].as_u64().unwrap() > 50, "{verdict}");
        assert!(verdict["samples"].as_u64().unwrap() >= verdict["steps"].as_u64().unwrap(), "{verdict}");
    }
    answer
}

/// Copies a log, with one byte of one sample changed.
struct Forger<'a> {
    log: &'a Log,
    out: LogWriter,
    topic: &'a str,
    /// Which sample, and which byte of it.
    at: (usize, usize),
}

impl TopicVisitor for Forger<'_> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        let channel = self.out.add_topic::<T>(topic.name).unwrap();
        for (i, sample) in self.log.samples::<T>(topic.name).unwrap().into_iter().enumerate() {
            let mut bytes = sample.as_bytes().to_vec();
            if topic.name == self.topic && i == self.at.0 {
                bytes[self.at.1] ^= 1;
            }
            self.out.write_bytes(channel, &sample.header(), &bytes).unwrap();
        }
    }
}

fn forged(log: &Path, topic: &str, at: (usize, usize)) -> PathBuf {
    let path = log.with_extension(format!("forged{}.mcap", topic.replace('/', "-")));
    let log = Log::open(log).unwrap();
    let mut out = LogWriter::create(&path).unwrap();
    for name in ["launch.toml", "plant.toml", "mission.toml"] {
        out.attach(name, "application/toml", &log.attachment(name).unwrap().unwrap()).unwrap();
    }
    let mut forger = Forger { log: &log, out, topic, at };
    topic::visit(&mut forger);
    forger.out.finish().unwrap();
    path
}

/// Where a field of a sample begins.
fn offset(sample: &str, field: &str) -> usize {
    struct Find<'a>(&'a str, &'a str, Option<usize>);
    impl SampleVisitor for Find<'_> {
        fn visit<T: Sample>(&mut self) {
            if T::NAME == self.0 {
                self.2 = T::FIELDS.iter().find(|field| field.name == self.1).map(|field| field.offset);
            }
        }
    }
    let mut find = Find(sample, field, None);
    fss_messages::visit_samples(&mut find);
    find.2.unwrap()
}

#[test]
fn a_fast_flight_replays_bit_for_bit_and_a_changed_bit_is_found_where_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    fss(&["run", "slew", "--fast", "--quiet", "--out", out]);
    let log = folder.path().join("run.mcap");
    assert_identical(&log);
    // An output: the sample's own step differs, in that field; what other services computed from it shows as well.
    let (code, answer) = replay(&forged(&log, "/nav/state", (1000, offset("NavState", "omega_rad_s"))));
    assert_eq!(code, 1);
    let fusion = of_service(&answer, "fusion");
    assert_eq!(fusion["difference_count"], 1, "{fusion:#}");
    let difference = &fusion["differences"][0];
    assert_eq!((&difference["step"], &difference["topic"]), (&1001.into(), &"/nav/state".into()));
    assert_eq!(difference["field"], "omega_rad_s");
    // An input from a device: what came of it differs from that step on, and nothing before.
    let (code, answer) = replay(&forged(&log, "/links/telemetry", (100, offset("LinkDatagram", "bytes") + 8)));
    assert_eq!(code, 1);
    let links = of_service(&answer, "links");
    let log = Log::open(&log).unwrap();
    let published_ns = log.samples::<fss_messages::LinkDatagram>("/links/telemetry").unwrap()[100].published_ns;
    let states = log.samples::<fss_messages::LinksState>("/links/state").unwrap();
    let step = states.iter().position(|state| state.published_ns == published_ns).unwrap() + 1;
    assert_eq!(links["differences"][0]["step"], step, "{links:#}");
    assert_eq!(links["differences"][0]["topic"], "/links/state");
}

#[test]
fn a_log_without_a_sample_that_a_step_used_says_so_and_claims_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    fss(&["run", "slew", "--fast", "--quiet", "--out", out]);
    let log = folder.path().join("run.mcap");
    // The 300th command of the arm gets another number.
    let (code, answer) = replay(&forged(&log, "/arm/command", (300, 2)));
    let links = of_service(&answer, "links");
    assert_ne!(code, 0);
    assert_eq!(answer["identical"], false);
    assert!(links["gaps"][0].as_str().unwrap().contains("/arm/command"), "{links:#}");
}

/// Writes the first `half` of a log's time, or the rest.
struct Part<'a>(&'a Log, LogWriter, u64, bool);

impl TopicVisitor for Part<'_> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        let channel = self.1.add_topic::<T>(topic.name).unwrap();
        for sample in self.0.samples::<T>(topic.name).unwrap() {
            if (sample.header().published_ns < self.2) == self.3 {
                self.1.write(channel, &sample).unwrap();
            }
        }
    }
}

#[test]
fn the_parts_of_a_flight_replay_together_and_the_second_alone_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    fss(&["run", "slew", "--fast", "--quiet", "--out", out]);
    let log = Log::open(&folder.path().join("run.mcap")).unwrap();
    let parts = [true, false].map(|first| {
        let path = folder.path().join(format!("first-{first}.mcap"));
        let mut out = LogWriter::create(&path).unwrap();
        for name in ["launch.toml", "plant.toml", "mission.toml"] {
            out.attach(name, "application/toml", &log.attachment(name).unwrap().unwrap()).unwrap();
        }
        let mut part = Part(&log, out, 10_000_000_000, first);
        topic::visit(&mut part);
        part.1.finish().unwrap();
        path
    });
    fss(&["replay", parts[0].to_str().unwrap(), parts[1].to_str().unwrap()]);
    assert_eq!(replay(&parts[0]).0, 0);
    let (code, answer) = replay(&parts[1]);
    assert_eq!(code, 2);
    for name in SERVICES {
        assert!(
            of_service(&answer, name)["gaps"][0].as_str().unwrap().contains("lacks the steps before"),
            "{answer:#}"
        );
    }
}

/// The process of a service of the flight in this folder.
fn process_of(service: &str, folder: &Path) -> Option<u32> {
    let (folder, word) = (folder.display().to_string(), format!(" service {service} "));
    std::fs::read_dir("/proc").unwrap().flatten().find_map(|entry| {
        let id = entry.file_name().to_string_lossy().parse().ok()?;
        let command = std::fs::read(entry.path().join("cmdline")).ok()?;
        let command = String::from_utf8_lossy(&command).replace('\0', " ");
        (command.contains(&folder) && command.contains(&word)).then_some(id)
    })
}

#[test]
fn a_flight_in_real_time_replays_bit_for_bit_though_a_service_was_killed_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut mission = "name = \"turn\"\ndescription = \"The base turns, the arm moves.\"\n".to_owned();
    let base = "{ goal = \"goto\", x_m = 0, y_m = 0, theta_deg = 5 }";
    let arm = "{ goal = \"joints\", q_deg = [-20, 50, -60, 30] }";
    writeln!(mission, "[initial]\nq_deg = [-30, 60, -60, 30]").unwrap();
    writeln!(mission, "[[phase]]\nname = \"turn\"\nduration_s = 4\nbase = {base}\narm = {arm}").unwrap();
    let launch = include_str!("../deploy/etc/launch/lab.toml").replace("51001", "53401").replace("5110", "5341");
    let (mission_file, launch_file) = (folder.path().join("turn.toml"), folder.path().join("launch-test.toml"));
    std::fs::write(&mission_file, mission).unwrap();
    std::fs::write(&launch_file, launch).unwrap();
    let out = folder.path().join("out");
    let mut run = Command::new(env!("CARGO_BIN_EXE_fss"))
        .arg("run")
        .arg(&mission_file)
        .arg("--launch")
        .arg(&launch_file)
        .args(["--quiet", "--out"])
        .arg(&out)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let began = Instant::now();
    let base = loop {
        assert!(began.elapsed() < Duration::from_secs(30), "base does not start");
        std::thread::sleep(Duration::from_millis(100));
        if let Some(base) = process_of("base", &out) {
            break base;
        }
    };
    std::thread::sleep(Duration::from_secs(3));
    assert!(Command::new("kill").args(["-9", &base.to_string()]).status().unwrap().success());
    run.wait().unwrap();
    let answer = assert_identical(&out.join("run.mcap"));
    assert_eq!(of_service(&answer, "base")["starts"], 2, "{answer:#}");
    assert_eq!(of_service(&answer, "fusion")["starts"], 1, "{answer:#}");
}
