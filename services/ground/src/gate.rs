//! The gate before the server: which pages of a browser may come in.
//!
//! A browser lets any page open a WebSocket to this computer, and only tells in `Origin` whose page it is. The server's library
//! does not look at that, and has no hook for one who would. So the gate listens at the address of the launch file, reads the
//! request, and passes on what it lets in. The library listens at an address of the loopback that is drawn anew at each
//! start, one of 2^38: no page finds it.
//!
//! What a viewer does not fetch waits here too ([`Outbox`]), for the library does not count what it drops.

mod frame;
mod origin;
mod outbox;

use crossbeam::queue::ArrayQueue;
use frame::{read_answer, read_frame};
use fss_bus::Queue;
use origin::Verdict;
use outbox::{Outbox, Put};
use rustix::net::sockopt::set_socket_send_buffer_size;
use std::collections::BTreeMap;
use std::hash::{BuildHasher, RandomState};
use std::io::{self, BufReader, Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A request is no longer than this, bytes.
const LONGEST_REQUEST: usize = 8192;
/// So many connections at once.
const MOST_CONNECTIONS: usize = 32;
/// Who has not said a whole request after so long is left.
const PATIENCE: Duration = Duration::from_secs(10);
/// Refusals are told no more often, whatever a page tries.
const BETWEEN_WORDS: Duration = Duration::from_secs(10);
/// What the kernel holds for a viewer, bytes: what waits longer waits where it is counted.
const IN_THE_KERNEL: usize = 1 << 18;
/// A slow viewer is told of no more often.
const BETWEEN_COMPLAINTS: Duration = Duration::from_secs(30);
/// Words that wait to be said.
const WORDS: usize = 64;
/// For the last words to viewers.
const FAREWELL: Duration = Duration::from_millis(500);

/// An address of the loopback that nobody guesses.
pub(crate) fn hidden_address() -> Ipv4Addr {
    // Keyed by the system's randomness.
    let [a, b, c, ..] = RandomState::new().hash_one(()).to_le_bytes();
    Ipv4Addr::new(127, a, b, c.clamp(1, 254))
}

/// What listens.
pub(crate) struct Gate {
    port: u16,
    shared: Arc<Shared>,
}

struct Shared {
    /// Pages that may come in beside this computer's own.
    origins: Vec<String>,
    /// Where the library listens.
    behind: SocketAddr,
    connections: AtomicUsize,
    /// Viewers' addresses, by those under which the library knows them.
    viewers: Mutex<BTreeMap<SocketAddr, SocketAddr>>,
    /// Samples that slow viewers have lost and that are not told yet.
    lost: AtomicU64,
    words: Queue<String>,
    /// What `GET /metrics` answers.
    metrics: Mutex<String>,
    last_word: Mutex<Option<Instant>>,
}

impl Gate {
    /// Listens, and lets in to what listens `behind`; the thread that does so ends with the process.
    pub(crate) fn open(listen: SocketAddr, behind: SocketAddr, origins: Vec<String>) -> io::Result<Self> {
        let listener = TcpListener::bind(listen)?;
        let port = listener.local_addr()?.port();
        let shared = Arc::new(Shared {
            origins,
            behind,
            connections: AtomicUsize::new(0),
            viewers: Mutex::default(),
            lost: AtomicU64::new(0),
            words: Arc::new(ArrayQueue::new(WORDS)),
            metrics: Mutex::default(),
            last_word: Mutex::default(),
        });
        let admits = shared.clone();
        std::thread::Builder::new().name("gate".to_owned()).spawn(move || admit(&listener, &admits))?;
        Ok(Self { port, shared })
    }

    pub(crate) fn port(&self) -> u16 {
        self.port
    }

    /// What is answered from now on to those who ask for metrics.
    pub(crate) fn set_metrics(&self, text: String) {
        *lock(&self.shared.metrics) = text;
    }

    /// How many samples slow viewers have lost since this was asked last.
    pub(crate) fn lost(&self) -> u64 {
        self.shared.lost.swap(0, Ordering::Relaxed)
    }

    /// What is to be said of those who were refused or are slow, one after another.
    pub(crate) fn next_words(&self) -> Option<String> {
        self.shared.words.pop()
    }

    /// Where the viewer is whom the library knows under this address.
    pub(crate) fn viewer_at(&self, address: &str) -> Option<SocketAddr> {
        address.parse().ok().and_then(|address| lock(&self.shared.viewers).get(&address).copied())
    }

    /// Waits a little for viewers to have heard the library's goodbye.
    pub(crate) fn close(self) {
        let begun = Instant::now();
        while self.shared.connections.load(Ordering::Relaxed) > 0 && begun.elapsed() < FAREWELL {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn admit(listener: &TcpListener, shared: &Arc<Shared>) {
    for connection in listener.incoming().flatten() {
        let shared = shared.clone();
        if shared.connections.fetch_add(1, Ordering::Relaxed) >= MOST_CONNECTIONS {
            shared.connections.fetch_sub(1, Ordering::Relaxed);
            continue;
        }
        std::thread::spawn(move || {
            let _who_came_may_be_gone = shared.serve(&connection);
            shared.connections.fetch_sub(1, Ordering::Relaxed);
        });
    }
}

impl Shared {
    fn serve(&self, outside: &TcpStream) -> io::Result<()> {
        let (request, verdict) = self.read(outside)?;
        if let Verdict::Foreign(origin) = &verdict {
            self.say_rarely(format!("a page of {origin} is refused: [ground] origins does not name it"));
        }
        match verdict.refusal() {
            Some((status, why)) => refuse(outside, status, &why),
            None if request.starts_with(b"GET /metrics ") => self.show_metrics(outside),
            None => self.pass_on(outside, &request),
        }
    }

    /// Answers in Prometheus' text format.
    fn show_metrics(&self, mut outside: &TcpStream) -> io::Result<()> {
        let text = lock(&self.metrics).clone();
        let head =
            "HTTP/1.1 200 OK\r\nContent-Type: text/plain; version=0.0.4\r\nConnection: close\r\nContent-Length: ";
        write!(outside, "{head}{}\r\n\r\n{text}", text.len())
    }

    /// Reads the request, and what may have come behind it already.
    fn read(&self, mut connection: &TcpStream) -> io::Result<(Vec<u8>, Verdict)> {
        let begun = Instant::now();
        let mut request = vec![0; LONGEST_REQUEST];
        let mut length = 0;
        loop {
            let left = PATIENCE.checked_sub(begun.elapsed()).ok_or(io::ErrorKind::TimedOut)?;
            connection.set_read_timeout(Some(left.max(Duration::from_millis(1))))?;
            let read = match connection.read(&mut request[length..]) {
                Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
                read => read?,
            };
            length += read;
            match origin::judge(&request[..length], &self.origins) {
                None if length == LONGEST_REQUEST => return Ok((request, Verdict::TooLong)),
                None if read == 0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                None => {}
                Some(verdict) => {
                    request.truncate(length);
                    return Ok((request, verdict));
                }
            }
        }
    }

    /// Says to the library what the viewer says, and the other way, until one of them goes.
    fn pass_on(&self, outside: &TcpStream, request: &[u8]) -> io::Result<()> {
        let mut inside = TcpStream::connect(self.behind)?;
        set_socket_send_buffer_size(outside, IN_THE_KERNEL)?;
        inside.set_nodelay(true)?;
        outside.set_nodelay(true)?;
        outside.set_read_timeout(None)?;
        inside.write_all(request)?;
        let known_as = inside.local_addr()?;
        let viewer = outside.peer_addr()?;
        lock(&self.viewers).insert(known_as, viewer);
        std::thread::scope(|threads| {
            threads.spawn(|| {
                let _one_of_them_has_gone = io::copy(&mut &*outside, &mut &inside);
                // The library may still have a word to say.
                let _ = inside.shutdown(Shutdown::Write);
            });
            let _one_of_them_has_gone = self.deliver(&inside, outside, viewer);
            let _ = (inside.shutdown(Shutdown::Both), outside.shutdown(Shutdown::Both));
        });
        lock(&self.viewers).remove(&known_as);
        Ok(())
    }

    /// What the library says, to the viewer, as fast as that reads.
    fn deliver(&self, inside: &TcpStream, outside: &TcpStream, viewer: SocketAddr) -> io::Result<()> {
        let mut from = BufReader::new(inside);
        let answer = read_answer(&mut from)?;
        (&*outside).write_all(&answer)?;
        if !answer.starts_with(b"HTTP/1.1 101") {
            return io::copy(&mut from, &mut &*outside).map(drop);
        }
        let outbox = Outbox::default();
        std::thread::scope(|threads| {
            threads.spawn(|| {
                while outbox.take().is_some_and(|frame| (&*outside).write_all(&frame).is_ok()) {}
                outbox.leave();
                let _ = inside.shutdown(Shutdown::Both);
            });
            self.fill(&outbox, &mut from, viewer);
            outbox.close(FAREWELL);
            // Where the viewer does not read, this ends the wait for it.
            let _ = outside.shutdown(Shutdown::Both);
        });
        Ok(())
    }

    /// Takes all that the library says, until it or the viewer goes, and tells of what had to be dropped.
    fn fill(&self, outbox: &Outbox, from: &mut BufReader<&TcpStream>, viewer: SocketAddr) {
        let (mut dropped, mut complained) = (0_u64, None::<Instant>);
        while let Ok(frame) = read_frame(from) {
            match outbox.put(frame) {
                Put::Waits => {}
                Put::Closed => break,
                Put::Dropped => {
                    dropped += 1;
                    self.lost.fetch_add(1, Ordering::Relaxed);
                    if complained.is_none_or(|last| last.elapsed() >= BETWEEN_COMPLAINTS) {
                        complained = Some(Instant::now());
                        let words =
                            format!("the viewer at {viewer} reads too slowly: {dropped} of its messages dropped");
                        self.words.force_push(words);
                    }
                }
            }
        }
        if dropped > 0 {
            self.words
                .force_push(format!("the slow viewer at {viewer} has gone: {dropped} of its messages were dropped"));
        }
    }

    fn say_rarely(&self, words: String) {
        let mut last = lock(&self.last_word);
        if last.is_none_or(|last| last.elapsed() >= BETWEEN_WORDS) {
            *last = Some(Instant::now());
            self.words.force_push(words);
        }
    }
}

fn refuse(mut connection: &TcpStream, status: &str, why: &str) -> io::Result<()> {
    let head = format!("HTTP/1.1 {status}\r\nContent-Type: text/plain\r\nContent-Length: {}\r\n", why.len());
    connection.write_all(format!("{head}Connection: close\r\n\r\n{why}").as_bytes())
}
