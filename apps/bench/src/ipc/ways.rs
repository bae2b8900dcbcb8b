//! The ways of a sample between two threads, and the ends of each.
#![allow(clippy::unnecessary_wraps)] // all ways are opened by one type of function; sockets can fail

use fss_bus::{Bus, InputPort, Latest, Output, OutputPort, SharedConfig, Time};
use fss_messages::topic::Topic;
use fss_messages::{NavState, Sample};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{Config, FileName, NodeBuilder, SemanticString, ServiceName, ipc};
use miette::{IntoDiagnostic, Result, miette};
use std::net::UdpSocket;
use std::os::unix::net::UnixDatagram;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use zerocopy::{FromBytes, IntoBytes};

/// The sample that travels.
pub(super) const SAMPLE_BYTES: usize = size_of::<NavState>();
const WORDS: usize = SAMPLE_BYTES / 8;
/// How long anybody waits for a sample.
const PATIENCE: Duration = Duration::from_secs(1);

/// One end of a way. Sending and receiving never fail in a way that this could mend: a failed end shows as silence.
pub(super) trait End {
    fn send(&mut self, sequence: u64);
    /// The sequence of the sample that comes next; zero where one side is gone.
    fn receive(&mut self) -> u64;
}

/// A way opens an end in the thread that uses it.
pub(super) type Opener = Box<dyn FnOnce() -> Result<Box<dyn End>> + Send>;

/// A sample that says its number.
fn sample(sequence: u64) -> NavState {
    NavState { stamp_ns: sequence, ..NavState::default() }
}

/// Asks until there is an answer, at most for a second.
fn poll(mut ask: impl FnMut() -> Option<u64>) -> u64 {
    let mut tries = 0_u32;
    let mut start = None;
    loop {
        if let Some(sequence) = ask() {
            return sequence;
        }
        tries = tries.wrapping_add(1);
        if tries.is_multiple_of(1 << 16) && start.get_or_insert_with(Instant::now).elapsed() > PATIENCE {
            return 0;
        }
        std::hint::spin_loop();
    }
}

struct BusEnd {
    out: Output<NavState>,
    input: Latest<NavState>,
    _bus: Bus,
}

impl End for BusEnd {
    fn send(&mut self, sequence: u64) {
        self.out.publish(sample(sequence));
        self.out.flush(Time::from_ns(sequence));
    }

    fn receive(&mut self) -> u64 {
        poll(|| {
            self.input.refresh();
            self.input.fresh().map(|sample| sample.header().stamp_ns)
        })
    }
}

pub(super) fn bus_way(prefix: &str) -> Result<(Opener, Opener)> {
    let end = |out: &'static str, input: &'static str| -> Opener {
        let prefix = prefix.to_owned();
        Box::new(move || {
            let bus = Bus::shared(&SharedConfig { node: "bench".to_owned(), prefix }).into_diagnostic()?;
            let out = Output::open(&bus, Topic::new(out)).into_diagnostic()?;
            let input = Latest::open(&bus, Topic::new(input)).into_diagnostic()?;
            Ok(Box::new(BusEnd { out, input, _bus: bus }))
        })
    };
    Ok((end("/ping", "/pong"), end("/pong", "/ping")))
}

struct IceoryxEnd {
    publisher: Publisher<ipc::Service, NavState, ()>,
    subscriber: Subscriber<ipc::Service, NavState, ()>,
}

impl End for IceoryxEnd {
    fn send(&mut self, sequence: u64) {
        if let Ok(loan) = self.publisher.loan_uninit() {
            let _silence_tells = loan.write_payload(sample(sequence)).send();
        }
    }

    fn receive(&mut self) -> u64 {
        poll(|| self.subscriber.receive().ok().flatten().map(|sample| sample.payload().stamp_ns))
    }
}

pub(super) fn iceoryx_way(prefix: &str) -> Result<(Opener, Opener)> {
    let end = |out: &'static str, input: &'static str| -> Opener {
        let prefix = prefix.to_owned();
        Box::new(move || {
            let refused = |what: &dyn std::fmt::Debug| miette!("iceoryx2 refuses: {what:?}");
            let mut config = Config::default();
            config.global.prefix = FileName::new(prefix.as_bytes()).map_err(|e| refused(&e))?;
            let node = NodeBuilder::new().config(&config).create::<ipc::Service>().map_err(|e| refused(&e))?;
            let service = |name: &str| {
                let name = ServiceName::new(name).map_err(|e| refused(&e))?;
                node.service_builder(&name).publish_subscribe::<NavState>().open_or_create().map_err(|e| refused(&e))
            };
            let publisher = service(out)?.publisher_builder().create().map_err(|e| refused(&e))?;
            let subscriber = service(input)?.subscriber_builder().create().map_err(|e| refused(&e))?;
            Ok(Box::new(IceoryxEnd { publisher, subscriber }))
        })
    };
    Ok((end("ping", "pong"), end("pong", "ping")))
}

/// A sample in memory that two cores share, and its number, which is written last.
struct Line {
    words: [AtomicU64; WORDS],
    number: AtomicU64,
}

impl Line {
    fn new() -> Arc<Self> {
        Arc::new(Self { words: std::array::from_fn(|_| AtomicU64::new(0)), number: AtomicU64::new(0) })
    }
}

struct CacheLineEnd {
    out: Arc<Line>,
    input: Arc<Line>,
    seen: u64,
}

impl End for CacheLineEnd {
    fn send(&mut self, sequence: u64) {
        let sample = sample(sequence);
        for (word, bytes) in self.out.words.iter().zip(sample.as_bytes().chunks_exact(8)) {
            word.store(u64::from_ne_bytes(bytes.try_into().unwrap_or_default()), Ordering::Relaxed);
        }
        self.out.number.store(sequence, Ordering::Release);
    }

    fn receive(&mut self) -> u64 {
        let number = poll(|| Some(self.input.number.load(Ordering::Acquire)).filter(|number| *number != self.seen));
        self.seen = number;
        // The sample is read like any other's.
        std::hint::black_box(self.input.words.iter().map(|word| word.load(Ordering::Relaxed)).sum::<u64>());
        number
    }
}

pub(super) fn cache_line_way(_: &str) -> Result<(Opener, Opener)> {
    let (there, back) = (Line::new(), Line::new());
    let end = |out: &Arc<Line>, input: &Arc<Line>| -> Opener {
        let (out, input) = (out.clone(), input.clone());
        Box::new(move || Ok(Box::new(CacheLineEnd { out, input, seen: 0 })))
    };
    Ok((end(&there, &back), end(&back, &there)))
}

/// A datagram socket of whatever kind.
struct SocketEnd<S, R> {
    send: S,
    receive: R,
}

impl<S: FnMut(&[u8]), R: FnMut(&mut [u8]) -> usize> End for SocketEnd<S, R> {
    fn send(&mut self, sequence: u64) {
        (self.send)(sample(sequence).as_bytes());
    }

    fn receive(&mut self) -> u64 {
        let mut bytes = [0; SAMPLE_BYTES];
        let len = (self.receive)(&mut bytes);
        NavState::read_from_bytes(&bytes[..len]).map_or(0, |sample| sample.stamp_ns)
    }
}

pub(super) fn unix_way(_: &str) -> Result<(Opener, Opener)> {
    let (near, far) = UnixDatagram::pair().into_diagnostic()?;
    let end = |socket: UnixDatagram| -> Result<Opener> {
        socket.set_read_timeout(Some(PATIENCE)).into_diagnostic()?;
        Ok(socket_end(socket, UnixDatagram::send, UnixDatagram::recv))
    };
    Ok((end(near)?, end(far)?))
}

pub(super) fn udp_way(_: &str) -> Result<(Opener, Opener)> {
    let bind = || UdpSocket::bind("127.0.0.1:0").into_diagnostic();
    let (near, far) = (bind()?, bind()?);
    near.connect(far.local_addr().into_diagnostic()?).into_diagnostic()?;
    far.connect(near.local_addr().into_diagnostic()?).into_diagnostic()?;
    let end = |socket: UdpSocket| -> Result<Opener> {
        socket.set_read_timeout(Some(PATIENCE)).into_diagnostic()?;
        Ok(socket_end(socket, UdpSocket::send, UdpSocket::recv))
    };
    Ok((end(near)?, end(far)?))
}

/// One end of a pair of sockets.
fn socket_end<S: Send + Sync + 'static>(
    socket: S,
    send: fn(&S, &[u8]) -> std::io::Result<usize>,
    receive: fn(&S, &mut [u8]) -> std::io::Result<usize>,
) -> Opener {
    let socket = Arc::new(socket);
    let other = socket.clone();
    Box::new(move || {
        let send = move |bytes: &[u8]| drop(send(&socket, bytes));
        Ok(Box::new(SocketEnd { send, receive: move |bytes: &mut [u8]| receive(&other, bytes).unwrap_or(0) }))
    })
}
