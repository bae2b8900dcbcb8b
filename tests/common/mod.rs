//! The program, run as a user runs it.
// Not every test needs all of it.
#![allow(dead_code)]

use serde_json::Value;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output};

/// Runs the program.
pub(crate) fn fss(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_fss")).args(arguments).output().unwrap()
}

/// What it printed.
pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that must succeed; gives what it printed.
#[track_caller]
pub(crate) fn succeed(arguments: &[&str]) -> String {
    let output = fss(arguments);
    assert!(output.status.success(), "fss {arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// Runs a command that must fail with one error that says all of `words`.
#[track_caller]
pub(crate) fn refused(arguments: &[&str], words: &[&str]) {
    let output = fss(arguments);
    let said = text(&output.stderr);
    assert!(!output.status.success(), "fss {arguments:?} should be refused");
    // The frame that miette draws around an error breaks lines: compare without white space.
    let flat: String = said.chars().filter(|c| !c.is_whitespace() && !"│╭╰─·".contains(*c)).collect();
    for word in words {
        let word: String = word.chars().filter(|c| !c.is_whitespace()).collect();
        assert!(flat.contains(&word), "fss {arguments:?} should say '{word}':\n{said}");
    }
    assert!(!said.contains("panicked"), "{said}");
}

/// A JSON file.
pub(crate) fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Says that a test shows nothing here, past the harness, which shows what a test prints only where it fails.
pub(crate) fn skipped(why: &str) {
    std::io::stderr().write_all(format!("skipped: {why}\n").as_bytes()).unwrap();
}
