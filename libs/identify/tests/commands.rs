//! Commands that are not those of the motion, in flights of a base without an arm.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "../../diagnosis/tests/flights/mod.rs"]
mod flights;

use flights::{flights_with_borrowed_commands, flights_with_early_commands, plant};
use fss_diagnosis::diagnosis::Verdict;
use fss_identify::diagnosis::diagnose;

#[test]
fn commands_of_another_run_are_told_from_weak_thrusters() {
    let found = diagnose(&plant(), &flights_with_borrowed_commands(), &[], &|_| ()).unwrap();
    assert!(found.causes.is_empty(), "{:?}", found.causes);
    let [mismatch] = &found.input_mismatch[..] else { panic!("{:?}", found.input_mismatch) };
    assert_eq!(mismatch.run, "run-1");
    assert_eq!(found.verdict, Verdict::Unexplained);
}

#[test]
fn commands_by_a_clock_that_is_off_are_told_and_by_how_much() {
    let found = diagnose(&plant(), &flights_with_early_commands(), &[], &|_| ()).unwrap();
    assert!(found.causes.iter().all(|c| c.effect.id() == "clock_offset"), "{:?}", found.causes);
    for mismatch in &found.input_mismatch {
        assert!(mismatch.why.contains("1.40 s later"), "{mismatch:?}");
    }
    assert!(found.causes.len() + found.input_mismatch.len() > 0, "{:?}", found.verdict);
}
