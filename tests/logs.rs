//! Logs in a user's hands: looked at, cut off, made whole.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::fss;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

fn info(log: &str) -> serde_json::Value {
    let output = fss(&["log", "info", "--json", log]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_log_that_was_cut_off_is_made_whole_and_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    assert!(fss(&["run", "reach", "--fast", "--quiet", "--out", out]).status.success());
    let (cut, whole) = (folder.path().join("cut.mcap"), folder.path().join("cut.recovered.mcap"));
    let bytes = std::fs::read(folder.path().join("run.mcap")).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let (cut, whole) = (cut.to_str().unwrap(), whole.to_str().unwrap());
    assert_eq!(info(cut)["complete"], false);
    assert!(fss(&["log", "recover", cut]).status.success());
    let recovered = info(whole);
    assert_eq!(recovered["complete"], true);
    assert_eq!(recovered["topics"], info(cut)["topics"]);
    let again = fss(&["log", "recover", cut]);
    assert!(!again.status.success() && String::from_utf8_lossy(&again.stderr).contains("exists"));
}

#[test]
fn a_reader_that_has_seen_enough_is_no_failure_and_files_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    assert!(fss(&["run", "reach", "--fast", "--quiet", "--out", out]).status.success());
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (log, plant, diagnosis) = (path("run.mcap"), path("plant.toml"), path("diagnosis"));
    for (words, lines) in [
        (&["log", "info", &log][..], 1),
        (&["log", "info", &log, "--json"], 0),
        (&["diagnose", &log, "--plant", &plant, "--out", &diagnosis], 0),
    ] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_fss"))
            .args(words)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // The reader goes before the first line was written, or at the latest after it.
        let mut reader = BufReader::new(child.stdout.take().unwrap());
        for _ in 0..lines {
            reader.read_line(&mut String::new()).unwrap();
        }
        drop(reader);
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success() && !said.contains("panicked"), "{words:?}: {said}");
    }
    assert!(folder.path().join("diagnosis/diagnosis.html").exists());
    // Where it cannot be written, that is another matter.
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_fss")).args(["log", "info", &log]).stdout(full).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && said.contains("cannot write to standard output"), "{said}");
}
