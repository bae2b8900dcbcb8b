//! Two logs beside each other: the same, different by so much, or shifted in time.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{Header, Sample};
use fss_records::log::{Log, LogWriter};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

fn fly(seed: &str, out: &Path) -> String {
    let out = out.join(seed);
    let mut command = Command::new(env!("CARGO_BIN_EXE_fss"));
    let status =
        command.args(["run", "reach", "--fast", "--quiet", "--seed", seed, "--out"]).arg(&out).output().unwrap();
    assert!(status.status.success(), "{}", String::from_utf8_lossy(&status.stderr));
    out.join("run.mcap").to_str().unwrap().to_owned()
}

/// Exit code and answer.
fn compare(a: &str, b: &str, more: &[&str]) -> (i32, Value) {
    let output = Command::new(env!("CARGO_BIN_EXE_fss")).args(["compare", "--json", a, b]).args(more).output().unwrap();
    (output.status.code().unwrap(), serde_json::from_slice(&output.stdout).unwrap_or_default())
}

/// A log whose samples of the laboratory's truth are stamped later by `late_ns`.
struct Late<'a>(&'a Log, LogWriter, u64);

impl TopicVisitor for Late<'_> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        let channel = self.1.add_topic::<T>(topic.name).unwrap();
        for mut sample in self.0.samples::<T>(topic.name).unwrap() {
            let Header { sequence, stamp_ns, published_ns } = sample.header();
            let late_ns = if topic.name == "/truth/state" { self.2 } else { 0 };
            sample.set_header(Header { sequence, stamp_ns: stamp_ns + late_ns, published_ns });
            self.1.write(channel, &sample).unwrap();
        }
    }
}

#[test]
fn equal_flights_are_the_same_and_different_ones_differ_by_as_much_as_they_do() {
    let (one, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (a, again, b) = (fly("1", one.path()), fly("1", other.path()), fly("2", other.path()));
    let (code, answer) = compare(&a, &again, &[]);
    assert_eq!((code, &answer["same"]), (0, &Value::Bool(true)));
    assert!(answer["fields"].as_array().unwrap().len() > 100);
    let (code, answer) = compare(&a, &b, &["--only", "/truth/state.theta_rad"]);
    assert_eq!(code, 1);
    let row = &answer["fields"][0];
    let largest = row["largest"].as_f64().unwrap().abs();
    assert!(largest > 1e-6, "{row}");
    // A tolerance that is a hair wider holds it, one that is a hair narrower does not.
    let with = |share: f64| format!("theta_rad={}", share * largest);
    let tolerated =
        |tolerance: &str| compare(&a, &b, &["--only", "/truth/state.theta_rad", "--tolerance", tolerance]).0;
    assert_eq!((tolerated(&with(1.001)), tolerated(&with(0.999))), (0, 1));
    // The base turns by 0.2 rad: 20 % of that holds a few milliradian.
    assert_eq!(compare(&a, &b, &["--only", "/truth/state.theta_rad", "--relative", "0.2"]).0, 0);
}

#[test]
fn a_log_that_is_late_is_aligned_by_a_field_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let a = fly("1", folder.path());
    let late = folder.path().join("late.mcap");
    let log = Log::open(Path::new(&a)).unwrap();
    let mut copy = Late(&log, LogWriter::create(&late).unwrap(), 250_000_000);
    topic::visit(&mut copy);
    copy.1.finish().unwrap();
    let (late, only) = (late.to_str().unwrap(), ["--only", "/truth/state.theta_rad", "--absolute", "1e-5"]);
    assert_eq!(compare(&a, late, &only).0, 1, "by the begin of the mission they are 0.25 s apart");
    let (code, answer) = compare(&a, late, &[&only[..], &["--align", "/truth/state.theta_rad"]].concat());
    let shift_s = answer["shift_s"].as_f64().unwrap();
    assert!((shift_s + 0.25).abs() < 1e-3, "{shift_s}");
    assert_eq!(code, 0, "{:#}", answer["fields"]);
}

#[test]
fn what_cannot_be_compared_is_no_difference() {
    let folder = tempfile::tempdir().unwrap();
    let a = fly("1", folder.path());
    assert_eq!(compare(&a, "nowhere.mcap", &[]).0, 2);
    assert_eq!(compare(&a, &a, &["--only", "/no/topic"]).0, 2);
    assert_eq!(compare(&a, &a, &["--tolerance", "x_m"]).0, 2);
    assert_eq!(compare(&a, &a, &["--align", "/mission/state.no_field"]).0, 2);
}
