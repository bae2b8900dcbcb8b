//! What the bus costs in shared memory, and who may look into it.
#![allow(clippy::unwrap_used)]

use fss_bus::allocation::{Counting, allocations_in};
use fss_bus::launch::Launch;
use fss_bus::{Bus, InputPort, Latest, Output, OutputPort, RawBatch, RawOutput, RawTopic, SharedConfig, Time};
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

#[test]
fn a_sample_that_is_known_by_its_definition_only_is_the_same_in_shared_and_in_local_memory() {
    let prefix = format!("fsstestraw{}_", std::process::id());
    let shared = Bus::shared(&SharedConfig { node: "test".to_owned(), prefix: prefix.clone() }).unwrap();
    for bus in [&shared, &Bus::local()] {
        let raw = RawTopic::of(topic::NAV_STATE);
        let mut typed_out = Output::open(bus, topic::NAV_STATE).unwrap();
        let mut raw_in = RawBatch::open(bus, &raw, 8).unwrap();
        typed_out.publish(NavState { stamp_ns: 7, x_m: 1.5, ..NavState::default() });
        typed_out.flush(Time::from_ns(9));
        raw_in.refresh();
        let samples: Vec<_> = raw_in.samples().map(<[u8]>::to_vec).collect();
        assert_eq!(samples.len(), 1);
        let raw_out = RawOutput::open(bus, &raw).unwrap();
        let mut typed_in = Latest::open(bus, topic::NAV_STATE).unwrap();
        assert!(raw_out.relay(&samples[0]));
        assert!(!raw_out.relay(&samples[0][1..]), "not of the topic's size");
        typed_in.refresh();
        let sample = typed_in.fresh().unwrap();
        assert_eq!((sample.sequence, sample.stamp_ns, sample.published_ns, sample.x_m), (1, 7, 9, 1.5));
        let mut other = raw.clone();
        other.definition.hash += 1;
        assert!(RawOutput::open(bus, &other).is_err(), "another layout");
    }
    fss_bus::remove_dead_nodes(&prefix, true).unwrap();
}

#[test]
fn a_topic_has_as_many_readers_as_the_launch_file_says_and_one_more_is_told_what_to_do() {
    let prefix = format!("fsstestmany{}_", std::process::id());
    let text = "[devices]\nvicon = '127.0.0.1:1'\ngyro = '-'\nvalves = '-'\nlinks_local = '127.0.0.1:1'\nlinks = []\n\
                [shared_memory]\nreaders = 12\n[[service]]\nname = 'base'\nrate_hz = 100\n";
    let launch = Launch::parse(text, &["base"]).unwrap();
    let bus = Bus::shared(&SharedConfig { node: "test".to_owned(), prefix: prefix.clone() }).unwrap();
    let bus = bus.for_stack(&launch);
    let readers: Vec<Latest<NavState>> = (0..12).map(|_| Latest::open(&bus, topic::NAV_STATE).unwrap()).collect();
    let refused = Latest::<NavState>::open(&bus, topic::NAV_STATE).err().unwrap().to_string();
    assert!(refused.contains("/nav/state") && refused.contains("[shared_memory] readers"), "{refused}");
    drop(readers);
    fss_bus::remove_dead_nodes(&prefix, true).unwrap();
    let few = Launch::parse(&text.replace("12", "3"), &["base"]).unwrap_err();
    assert!(few.message.contains("readers = 3") && few.help.contains("10 to 64"), "{few:?}");
}
