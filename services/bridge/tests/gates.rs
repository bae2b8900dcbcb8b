//! What the bridge lets in of another vehicle, and what it refuses.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_bridge::clock::PeerClock;
use fss_bridge::gate::{Arrival, Gate, Peer, Refusal};
use fss_bridge::{Bridge, HEARD_QUEUE, Heard, Line, MAX_SAMPLE, Parcel, Patience, SAID_QUEUE, Said};
use fss_bus::launch::Launch;
use fss_bus::{Bus, Feed, InputPort, Latest, Output, OutputPort, Queue, Runner, Time};
use fss_messages::{Event, NavState, PeerState, Sample, text_of, topic};
use fss_wire::bridge::Envelope;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use std::time::Duration;
use zerocopy::IntoBytes;

const MS: u64 = 1_000_000;
/// What the other host's clock is behind this one's.
const OFFSET_NS: u64 = 77_000 * MS;
const LEN: usize = size_of::<NavState>();

fn peer() -> (Peer, Gate) {
    (Peer::new("target", Duration::from_millis(300)), Gate::new(NavState::HASH, LEN))
}

/// The `number`-th sample, 5 ms after the one before, that took so long on its way.
fn arrival(number: u64, way_ms: u64) -> Arrival {
    let sent_ns = 1000 * MS + number * 5 * MS;
    let envelope = Envelope { layout: NavState::HASH, session: 7, number, sent_ns };
    let received_ns = sent_ns + OFFSET_NS + way_ms * MS;
    Arrival { envelope: Some(envelope), len: LEN, stamp_ns: sent_ns - 2 * MS, received_ns }
}

fn with(arrival: Arrival, change: impl Fn(&mut Envelope)) -> Arrival {
    let mut envelope = arrival.envelope.unwrap();
    change(&mut envelope);
    Arrival { envelope: Some(envelope), ..arrival }
}

#[test]
fn a_sample_that_comes_late_is_stale_and_the_next_in_time_is_not() {
    let (mut peer, mut gate) = peer();
    assert_eq!(peer.admit(&mut gate, &arrival(1, 1)), Ok(()));
    assert_eq!(peer.admit(&mut gate, &arrival(2, 250)), Ok(()), "251 ms old");
    let refused = peer.admit(&mut gate, &arrival(3, 5000));
    assert!(matches!(refused, Err(Refusal::Age(age_ns)) if age_ns.abs_diff(5001 * MS) < 20 * MS), "{refused:?}");
    assert_eq!(peer.admit(&mut gate, &arrival(1004, 1)), Ok(()));
    let state = peer.state();
    assert_eq!((state.received, state.refused_age, state.refused_sequence), (3, 1, 0));
}

#[test]
fn what_comes_twice_or_was_overtaken_is_refused() {
    let (mut peer, mut gate) = peer();
    for number in [1, 2, 5] {
        assert_eq!(peer.admit(&mut gate, &arrival(number, 1)), Ok(()));
    }
    for number in [5, 4, 3, 1] {
        assert_eq!(peer.admit(&mut gate, &arrival(number, 1)), Err(Refusal::Sequence), "{number}");
    }
    assert_eq!(peer.admit(&mut gate, &arrival(6, 1)), Ok(()));
    assert_eq!((peer.state().received, peer.state().refused_sequence), (4, 4));
}

#[test]
fn another_builds_layout_another_length_and_a_measurement_of_the_future_are_refused() {
    let (mut peer, mut gate) = peer();
    let other = with(arrival(1, 1), |envelope| envelope.layout ^= 1);
    assert_eq!(peer.admit(&mut gate, &other), Err(Refusal::Layout));
    for len in [0, LEN - 1, LEN + 1] {
        assert_eq!(peer.admit(&mut gate, &Arrival { len, ..arrival(1, 1) }), Err(Refusal::Form), "{len}");
    }
    assert_eq!(peer.admit(&mut gate, &Arrival { envelope: None, ..arrival(1, 1) }), Err(Refusal::Form));
    assert_eq!(peer.admit(&mut gate, &Arrival { stamp_ns: u64::MAX, ..arrival(1, 1) }), Err(Refusal::Form));
    assert_eq!(peer.admit(&mut gate, &arrival(1, 1)), Ok(()), "none of these has used the number up");
    assert_eq!((peer.state().refused_layout, peer.state().refused_form), (1, 5));
}

#[test]
fn a_bridge_that_starts_anew_counts_anew_and_its_forerunner_is_not_heard_beside_it() {
    let (mut peer, mut gate) = peer();
    assert_eq!(peer.admit(&mut gate, &arrival(1000, 1)), Ok(()));
    // Its computer started anew with it: the clock is another.
    let anew = |number| Arrival {
        received_ns: arrival(1000 + number, 1).received_ns,
        ..with(arrival(number, 1), |envelope| envelope.session = 8)
    };
    assert_eq!(peer.admit(&mut gate, &anew(1)), Ok(()));
    assert_eq!(peer.admit(&mut gate, &arrival(1002, 1)), Err(Refusal::Sequence));
    assert_eq!(peer.admit(&mut gate, &anew(3)), Ok(()));
    assert!(peer.state().age_ns < 3 * MS, "{}", peer.state().age_ns);
    // A calendar that was set back makes an older session, which counts when the newer one is gone.
    let back = with(arrival(1600, 1), |envelope| envelope.session = 2);
    assert_eq!(peer.admit(&mut gate, &back), Ok(()));
}

#[test]
fn the_offset_follows_drifting_clocks_and_not_a_slow_network() {
    let mut clock = PeerClock::default();
    let mut last = 0;
    // An hour of a clock that loses 100 parts in a million, over ways of 1 to 20 ms.
    for n in 0..3600 * 20_u64 {
        let received = OFFSET_NS + n * 50 * MS;
        let sent = n * 50 * MS - n * 50 * MS / 10_000;
        last = clock.observe(sent, received + (1 + n % 20) * MS) - (received - sent) as i64;
    }
    assert!((0..25 * MS as i64).contains(&last), "{last} ns off after an hour");
    // Ten seconds of samples that are all five seconds late.
    let before = clock.offset_ns().unwrap();
    for n in 0..200_u64 {
        let received = OFFSET_NS + 3_600_000 * MS + n * 50 * MS;
        clock.observe(received - before as u64 - 5000 * MS, received);
    }
    assert!(clock.offset_ns().unwrap() - before < 15 * MS as i64);
}

#[test]
fn random_arrivals_are_counted_one_by_one_and_none_panics() {
    let seed = 20_261_122;
    println!("seed {seed}");
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut peer, mut gate) = peer();
    let extremes = [0, 1, 7, u64::MAX, u64::MAX / 2, 1 << 63, NavState::HASH];
    for _ in 0..100_000 {
        let mut word = || if rng.random_bool(0.5) { extremes[rng.random_range(0..7)] } else { rng.random() };
        let envelope = Envelope { layout: NavState::HASH, session: word(), number: word(), sent_ns: word() };
        let arrival = Arrival { envelope: Some(envelope), len: LEN, stamp_ns: word(), received_ns: word() };
        let _either = peer.admit(&mut gate, &arrival);
    }
    let s = peer.state();
    assert_eq!(s.received + s.refused_age + s.refused_sequence + s.refused_layout + s.refused_form, 100_000);
}

const LAUNCH: &str = r#"
vehicle = "chaser"
target_vehicle = "target"
[devices]
vicon = "127.0.0.1:1"
gyro = "g"
valves = "v"
links_local = "127.0.0.1:2"
links = []
[bridge]
listen = ["127.0.0.1:7447"]
share = ["/nav/state"]
receive = ["/target/nav/state"]
[[service]]
name = "bridge"
rate_hz = 50
"#;

/// A bridge whose network is this test.
struct Flown {
    bridge: Runner<Bridge>,
    own: Output<NavState>,
    nav: Latest<NavState>,
    peer: Latest<PeerState>,
    events: Latest<Event>,
    heard: Queue<Heard>,
    said: Queue<Said>,
    now: Time,
}

impl Flown {
    fn new() -> Self {
        let launch = Launch::parse(LAUNCH, &["bridge"]).unwrap();
        let bus = Bus::local().for_stack(&launch);
        let patience = Patience { max_age: Duration::from_millis(300), silent_after: Duration::from_secs(1) };
        let words = Arc::new(crossbeam_queue::ArrayQueue::new(4));
        let bridge = Bridge::new(bus.neighbours(), patience, Line::default(), words);
        Self {
            bridge: Runner::new(bridge, &bus).unwrap(),
            own: Output::open(&bus, topic::NAV_STATE).unwrap(),
            nav: Latest::open(&bus, topic::NAV_STATE.of_target()).unwrap(),
            peer: Latest::open(&bus, topic::PEER.of_target()).unwrap(),
            events: Latest::open(&bus, topic::EVENTS).unwrap(),
            heard: bus.queue(HEARD_QUEUE, Feed::<Heard>::CAPACITY).unwrap(),
            said: bus.queue(SAID_QUEUE, Feed::<Said>::CAPACITY).unwrap(),
            now: Time::from_ns(OFFSET_NS),
        }
    }

    /// Steps once, 20 ms later, after `bytes` came with this envelope.
    fn step(&mut self, came: Option<(&[u8], Envelope)>) {
        self.now = self.now.plus_ns(20 * MS);
        if let Some((bytes, envelope)) = came {
            let parcel = Parcel::new(0, bytes);
            self.heard.force_push(Heard { parcel, envelope: Some(envelope), received_ns: self.now.ns() - MS });
        }
        self.bridge.step(self.now);
        self.bridge.flush(self.now);
        self.nav.refresh();
        self.peer.refresh();
        self.events.refresh();
    }

    /// The other vehicle's word as of now, on its clock.
    fn word(&self, number: u64) -> (NavState, Envelope) {
        let sent_ns = self.now.ns() - OFFSET_NS + 15 * MS;
        let nav = NavState {
            sequence: 40 + number,
            stamp_ns: sent_ns,
            published_ns: sent_ns,
            x_m: 0.1,
            ..NavState::default()
        };
        (nav, Envelope { layout: NavState::HASH, session: 1, number, sent_ns })
    }
}

#[test]
fn what_passes_is_published_with_the_same_bytes_in_the_other_vehicles_name() {
    let mut flown = Flown::new();
    let (nav, envelope) = flown.word(1);
    flown.step(Some((nav.as_bytes(), envelope)));
    assert_eq!(flown.nav.get(), Some(&nav), "its header too is as it was sent");
    let peer = flown.peer.get().unwrap();
    assert_eq!((text_of(&peer.vehicle), peer.received, peer.speaks), ("target", 1, 1));
    assert_eq!(nav.stamp_ns.wrapping_add_signed(peer.clock_offset_ns), flown.now.ns() - MS);
    assert_eq!(text_of(&flown.events.get().unwrap().text), "target speaks");
}

#[test]
fn silence_and_late_words_are_told_and_so_is_their_end() {
    let mut flown = Flown::new();
    let (nav, envelope) = flown.word(1);
    flown.step(Some((nav.as_bytes(), envelope)));
    for number in 2..100 {
        let late = flown.word(number).1;
        flown.step(Some((nav.as_bytes(), Envelope { sent_ns: envelope.sent_ns, ..late })));
    }
    let said = text_of(&flown.events.get().unwrap().text).to_owned();
    assert!(said.starts_with("target is stale: what comes of it is 1."), "{said}");
    assert_eq!(flown.peer.get().unwrap().speaks, 0);
    assert!(flown.peer.get().unwrap().refused_age > 50);
    let (nav, envelope) = flown.word(100);
    flown.step(Some((nav.as_bytes(), envelope)));
    assert_eq!(text_of(&flown.events.get().unwrap().text), "target speaks");
    (0..60).for_each(|_| flown.step(None));
    assert_eq!(text_of(&flown.events.get().unwrap().text), "target is stale: nothing comes of it");
}

#[test]
fn damaged_bytes_are_refused_and_never_published() {
    let seed = 20_261_123;
    println!("seed {seed}");
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut flown = Flown::new();
    for number in 1..2000 {
        let (nav, envelope) = flown.word(number);
        let mut bytes = nav.as_bytes().to_vec();
        bytes.resize(rng.random_range(0..MAX_SAMPLE + 100), rng.random());
        if bytes.len() != LEN {
            flown.step(Some((&bytes, envelope)));
            let mut raw = envelope.encode().to_vec();
            raw[rng.random_range(0..8)] ^= 1 << rng.random_range(0..8);
            raw.truncate(rng.random_range(0..=raw.len()));
            assert!(Envelope::decode(&raw).is_err());
        }
    }
    assert!(flown.nav.get().is_none());
    assert!(flown.peer.get().unwrap().refused_form > 1000);
}

#[test]
fn what_is_shared_goes_out_numbered_and_unchanged() {
    let mut flown = Flown::new();
    let stamp_ns = flown.now.ns();
    for _ in 0..3 {
        flown.own.publish(NavState { stamp_ns, x_m: 0.5, ..NavState::default() });
    }
    flown.own.flush(flown.now);
    flown.step(None);
    let said: Vec<Said> = std::iter::from_fn(|| flown.said.pop()).collect();
    assert_eq!(said.iter().map(|said| said.number).collect::<Vec<_>>(), [1, 2, 3]);
    let third = NavState { sequence: 3, stamp_ns, published_ns: stamp_ns, x_m: 0.5, ..NavState::default() };
    assert_eq!((said[2].parcel.sample(), said[2].layout), (third.as_bytes(), NavState::HASH));
}

#[test]
fn a_launch_file_that_makes_no_sense_is_refused_with_what_to_do() {
    for (from, to, words) in [
        ("vehicle = \"chaser\"\n", "", "a vehicle with a bridge needs a name"),
        ("vehicle = \"chaser\"", "vehicle = \"a/b\"", "no vehicle's name"),
        ("[\"/nav/state\"]", "[\"/nav/statte\"]", "there is no topic /nav/statte to share"),
        ("/target/nav/state", "/target/nav/statte", "there is no topic /nav/statte"),
        ("/target/nav/state", "/chaser/nav/state", "cannot come from another"),
        ("/target/nav/state", "/target/gyro", "the target vehicle 'target' is not heard"),
        ("name = \"bridge\"", "name = \"base\"", "the service is not launched"),
        ("127.0.0.1:7447", "somewhere", "invalid socket address"),
    ] {
        let refused = Launch::parse(&LAUNCH.replacen(from, to, 1), &["bridge", "base"]).unwrap_err();
        assert!(refused.message.contains(words), "{refused}, not '{words}'");
    }
}
