//! What the bus costs in shared memory, and who may look into it.
#![allow(clippy::unwrap_used)]

use fss_bus::allocation::{Counting, allocations_in};
use fss_bus::{Bus, InputPort, Latest, Output, OutputPort, SharedConfig, Time};
use fss_messages::{NavState, topic};
use std::os::unix::fs::PermissionsExt;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_sample_costs_iceoryx2s_one_allocation_to_send_and_none_to_receive_and_is_its_owners_alone() {
    let prefix = format!("fsstest{}_", std::process::id());
    let bus = Bus::shared(&SharedConfig { node: "test".to_owned(), prefix: prefix.clone() }).unwrap();
    let mut out = Output::open(&bus, topic::NAV_STATE).unwrap();
    let mut input = Latest::open(&bus, topic::NAV_STATE).unwrap();
    let mut exchange = |stamp_ns| {
        let sent = allocations_in(|| {
            out.publish(NavState { stamp_ns, ..NavState::default() });
            assert_eq!(out.flush(Time::from_ns(stamp_ns)), 0);
        });
        let received = allocations_in(|| {
            input.refresh();
            assert_eq!(input.fresh().unwrap().stamp_ns, stamp_ns);
        });
        (sent, received)
    };
    exchange(1); // the ends find each other
    for stamp_ns in 2..100 {
        assert_eq!(exchange(stamp_ns), (1, 0));
    }
    let own = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let own: Vec<_> = own.filter(|file| file.file_name().to_string_lossy().starts_with(&prefix)).collect();
    assert!(!own.is_empty());
    for file in own {
        assert_eq!(file.metadata().unwrap().permissions().mode() & 0o077, 0, "{:?}", file.file_name());
    }
    drop((out, input));
    fss_bus::remove_dead_nodes(&prefix, true).unwrap();
}

#[test]
fn the_newest_sample_is_the_one_that_is_seen() {
    let prefix = format!("fsstestnew{}_", std::process::id());
    let bus = Bus::shared(&SharedConfig { node: "test".to_owned(), prefix: prefix.clone() }).unwrap();
    let mut out = Output::open(&bus, topic::NAV_STATE).unwrap();
    let mut input = Latest::open(&bus, topic::NAV_STATE).unwrap();
    for round in 0..3 {
        for i in 1..=5 {
            out.publish(NavState { stamp_ns: round * 10 + i, ..NavState::default() });
            out.flush(Time::from_ns(1));
        }
        input.refresh();
        assert_eq!(input.fresh().unwrap().stamp_ns, round * 10 + 5);
        input.refresh();
        assert!(input.fresh().is_none(), "it comes once");
    }
    drop((out, input));
    fss_bus::remove_dead_nodes(&prefix, true).unwrap();
}
