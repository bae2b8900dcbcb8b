//! A viewer that does not read loses its oldest messages, and the service knows how many.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_bus::{Batch, Bus, InputPort, Output, OutputPort, Runner, Time};
use fss_ground::{Ground, GroundConfig};
use fss_messages::{Event, NavState, text_of, topic};
use fss_plant::Plant;
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

const PATIENCE: Duration = Duration::from_secs(30);

/// A stack of the view and one who publishes.
struct Stack {
    ground: Runner<Ground>,
    nav: Output<NavState>,
    events: Batch<Event>,
    said: Vec<String>,
    dropped: u64,
    published: u64,
}

impl Stack {
    /// Publishes so many states, and lets the view step.
    fn step(&mut self, count: u64) {
        let now = Time::from_ns(1_000_000 * (self.published + 1));
        for _ in 0..count {
            self.nav.publish(NavState { stamp_ns: now.ns(), ..NavState::default() });
        }
        self.published += count;
        assert_eq!(self.nav.flush(now), 0);
        self.ground.step(now);
        self.dropped += self.ground.flush(now);
        self.events.refresh();
        self.said.extend(self.events.samples().iter().map(|event| text_of(&event.text).to_owned()));
        // As in flight: the threads of the view have the time between two steps.
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// One that wants navigation, and which sample it has seen.
fn subscribe(stack: &mut Stack, address: std::net::SocketAddr) -> (WebSocket<TcpStream>, u64) {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut request = format!("ws://{address}/").into_client_request().unwrap();
    request.headers_mut().insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
    let (mut viewer, _) = tungstenite::client(request, stream).unwrap();
    let channel = loop {
        let Message::Text(words) = viewer.read().unwrap() else { continue };
        let words: serde_json::Value = serde_json::from_str(&words).unwrap();
        let mut channels = words["channels"].as_array().into_iter().flatten();
        if let Some(channel) = channels.find(|channel| channel["topic"] == "/nav/state") {
            break channel["id"].clone();
        }
    };
    let wish = serde_json::json!({ "op": "subscribe", "subscriptions": [{ "id": 1, "channelId": channel }] });
    viewer.send(Message::text(wish.to_string())).unwrap();
    // The first sample says that the wish was heard.
    let begun = Instant::now();
    viewer.get_ref().set_nonblocking(true).unwrap();
    let seen = loop {
        if let Some(seen) = viewer.read().ok().and_then(|message| sequence(&message)) {
            break seen;
        }
        assert!(begun.elapsed() < PATIENCE, "nothing comes");
        stack.step(1);
    };
    viewer.get_ref().set_nonblocking(false).unwrap();
    (viewer, seen)
}

/// Of a sample: behind opcode, subscription, time and the encapsulation's header.
fn sequence(message: &Message) -> Option<u64> {
    let Message::Binary(bytes) = message else { return None };
    (bytes[0] == 1).then(|| u64::from_le_bytes(bytes[17..25].try_into().unwrap()))
}

#[test]
fn what_a_slow_viewer_misses_is_what_the_service_says_that_it_dropped() {
    let bus = Bus::local();
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let config = GroundConfig { listen: address, name: "test".to_owned(), commands: false, origins: Vec::new() };
    let ground = Ground::listen(&config, &Plant::default_laboratory().unwrap(), &bus).unwrap();
    let mut stack = Stack {
        ground: Runner::new(ground, &bus).unwrap(),
        nav: Output::open(&bus, topic::NAV_STATE).unwrap(),
        events: Batch::open(&bus, topic::EVENTS).unwrap(),
        said: Vec::new(),
        dropped: 0,
        published: 0,
    };
    let (mut viewer, mut before) = subscribe(&mut stack, address);
    let viewer_at = viewer.get_ref().local_addr().unwrap();
    assert_eq!(stack.dropped, 0, "one that reads loses nothing");
    // More than the kernel holds for it.
    let begun = Instant::now();
    while stack.dropped < 500 {
        stack.step(16);
        assert!(begun.elapsed() < PATIENCE, "{} samples, {} dropped", stack.published, stack.dropped);
    }
    // Now it reads all there is; the last sample is never dropped.
    let mut missed = 0;
    while before != stack.published {
        let Some(sequence) = sequence(&viewer.read().unwrap()) else { continue };
        missed += sequence - before - 1;
        before = sequence;
    }
    stack.step(0);
    assert_eq!(missed, stack.dropped, "of {} samples", stack.published);
    drop(viewer);
    let last = format!("the slow viewer at {viewer_at} has gone: {missed} of its messages were dropped");
    let begun = Instant::now();
    while !stack.said.contains(&last) {
        stack.step(0);
        assert!(begun.elapsed() < PATIENCE, "'{last}' is not among {:#?}", stack.said);
    }
    assert!(stack.said.iter().any(|words| words.starts_with(&format!("the viewer at {viewer_at} reads too slowly"))));
    stack.ground.service.close();
}
