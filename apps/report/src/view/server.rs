//! The few words of HTTP that a page on the loopback needs: GET of what is in memory, and a stream of events.
//!
//! Only this computer can reach it. A page from elsewhere that a browser on this computer shows can still send requests here:
//! so requests must name this server as their host, which a rebound name does not, pages of other origins are refused, and no
//! answer may be read by other pages.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// A request is no longer than this, bytes.
const LONGEST_REQUEST: usize = 8192;
const MOST_HEADERS: usize = 64;
/// So many browsers' connections at once.
const MOST_CONNECTIONS: usize = 24;
/// Who does not send or take anything for so long is left.
const PATIENCE: Duration = Duration::from_secs(10);
/// A stream with nothing to say shows so often that it lives.
const KEEP_ALIVE: Duration = Duration::from_secs(2);
/// So many refused pages are told of: one that does not give up must not fill a log.
const MOST_WORDS: usize = 20;
/// So many messages are kept for those who come later: ten minutes at 30 Hz.
const HISTORY: usize = 18_000;

const SAFETY: &str = "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
    img-src 'self' data:; frame-ancestors 'none'\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
    Cross-Origin-Resource-Policy: same-origin\r\nCache-Control: no-store\r\nConnection: close\r\n";

/// What is at a path.
pub(super) struct Content {
    /// Its media type.
    pub kind: &'static str,
    /// Itself.
    pub bytes: Vec<u8>,
}

/// Messages for every browser that looks: each gets what was said before it came, and then what comes.
#[derive(Default)]
pub(super) struct Stream {
    said: Mutex<Said>,
    news: Condvar,
}

#[derive(Default)]
struct Said {
    /// How many messages have been dropped in front.
    dropped: usize,
    messages: VecDeque<Arc<str>>,
}

impl Stream {
    /// Says a message of this name.
    pub(super) fn say(&self, name: &str, json: &str) {
        let mut said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        said.messages.push_back(format!("event: {name}\ndata: {json}\n\n").into());
        if said.messages.len() > HISTORY {
            said.messages.pop_front();
            said.dropped += 1;
        }
        drop(said);
        self.news.notify_all();
    }

    /// Messages from the `next`-th on, after a wait where there are none; and which comes then.
    fn after(&self, next: usize) -> (Vec<Arc<str>>, usize) {
        let said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        let nothing = |said: &mut Said| said.dropped + said.messages.len() <= next;
        let (said, _) = self.news.wait_timeout_while(said, KEEP_ALIVE, nothing).unwrap_or_else(PoisonError::into_inner);
        let messages: Vec<_> = said.messages.iter().skip(next.saturating_sub(said.dropped)).cloned().collect();
        (messages, said.dropped + said.messages.len())
    }
}

/// The server.
pub(super) struct Server {
    listener: TcpListener,
    port: u16,
    site: Arc<Site>,
}

struct Site {
    hosts: [String; 2],
    files: BTreeMap<String, Content>,
    stream: Option<Arc<Stream>>,
    connections: AtomicUsize,
    refused: AtomicUsize,
}

impl Server {
    /// Serves `files` by their paths, and the stream at `/live`.
    ///
    /// # Errors
    /// Where the listener has no address.
    pub(super) fn new(
        listener: TcpListener,
        files: BTreeMap<String, Content>,
        stream: Option<Arc<Stream>>,
    ) -> io::Result<Self> {
        let port = listener.local_addr()?.port();
        let hosts = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
        let (connections, refused) = (AtomicUsize::new(0), AtomicUsize::new(0));
        Ok(Self { listener, port, site: Arc::new(Site { hosts, files, stream, connections, refused }) })
    }

    /// Where it listens.
    pub(super) fn port(&self) -> u16 {
        self.port
    }

    /// Serves for ever.
    pub(super) fn run(&self) {
        for connection in self.listener.incoming().flatten() {
            let site = self.site.clone();
            if site.connections.fetch_add(1, Ordering::Relaxed) >= MOST_CONNECTIONS {
                site.connections.fetch_sub(1, Ordering::Relaxed);
                let _who_is_refused_may_be_gone =
                    answer(&connection, "503 Service Unavailable", "text/plain", b"busy\n");
                continue;
            }
            std::thread::spawn(move || {
                let _who_asked_may_be_gone = site.serve(&connection);
                site.connections.fetch_sub(1, Ordering::Relaxed);
            });
        }
    }
}

/// What is wanted, or the status and the reason why not.
type Wanted = Result<String, (&'static str, &'static str)>;

impl Site {
    fn serve(&self, connection: &TcpStream) -> io::Result<()> {
        connection.set_read_timeout(Some(PATIENCE))?;
        connection.set_write_timeout(Some(PATIENCE))?;
        let path = match self.read(connection)? {
            Ok(path) => path,
            Err((status, reason)) => return answer(connection, status, "text/plain", reason.as_bytes()),
        };
        match (&self.stream, self.files.get(&path)) {
            (Some(stream), _) if path == "/live" => tell(connection, stream),
            (_, Some(content)) => answer(connection, "200 OK", content.kind, &content.bytes),
            _ => answer(connection, "404 Not Found", "text/plain", b"there is nothing here\n"),
        }
    }

    /// Reads a request; gives its path.
    fn read(&self, mut connection: &TcpStream) -> io::Result<Wanted> {
        let mut buffer = [0; LONGEST_REQUEST];
        let mut length = 0;
        loop {
            let read = connection.read(&mut buffer[length..])?;
            length += read;
            let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
            let mut request = httparse::Request::new(&mut headers);
            match request.parse(&buffer[..length]) {
                Ok(httparse::Status::Complete(_)) => return Ok(self.check(&request)),
                Ok(httparse::Status::Partial) if read == 0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(httparse::Status::Partial) if length < LONGEST_REQUEST => {}
                Ok(httparse::Status::Partial) | Err(httparse::Error::TooManyHeaders) => {
                    return Ok(Err(("431 Request Header Fields Too Large", "the request is too long\n")));
                }
                Err(_) => return Ok(Err(("400 Bad Request", "this is no request\n"))),
            }
        }
    }

    fn check(&self, request: &httparse::Request<'_, '_>) -> Wanted {
        let mut hosts = request.headers.iter().filter(|header| header.name.eq_ignore_ascii_case("host"));
        let is_ours = |host: &[u8]| self.hosts.iter().any(|ours| ours.as_bytes() == host);
        match (hosts.next(), hosts.next()) {
            (Some(host), None) if is_ours(host.value) => {}
            _ => return Err(("403 Forbidden", "this server is 127.0.0.1, by no other name\n")),
        }
        // Programs say no origin, nor do browsers of the page's own parts.
        let mut origins = request.headers.iter().filter(|header| header.name.eq_ignore_ascii_case("origin"));
        if let Some(foreign) = origins.find(|origin| !origin.value.strip_prefix(b"http://").is_some_and(is_ours)) {
            self.tell_of(foreign.value);
            return Err(("403 Forbidden", "pages of other origins may not look here\n"));
        }
        if request.method != Some("GET") {
            return Err(("405 Method Not Allowed", "nothing can be changed here\n"));
        }
        let path = request.path.unwrap_or("/");
        Ok(path.split('?').next().unwrap_or("/").to_owned())
    }

    fn tell_of(&self, origin: &[u8]) {
        if self.refused.fetch_add(1, Ordering::Relaxed) < MOST_WORDS {
            eprintln!("refused a page of {}", origin[..origin.len().min(80)].escape_ascii());
        }
    }
}

fn answer(mut connection: &TcpStream, status: &str, kind: &str, body: &[u8]) -> io::Result<()> {
    let head = format!("HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\n{SAFETY}\r\n", body.len());
    connection.write_all(head.as_bytes())?;
    connection.write_all(body)
}

/// Server-sent events, until the browser goes.
fn tell(mut connection: &TcpStream, stream: &Stream) -> io::Result<()> {
    let head = format!("HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\n{SAFETY}\r\n");
    connection.write_all(head.as_bytes())?;
    let mut next = 0;
    loop {
        let (messages, after) = stream.after(next);
        next = after;
        if messages.is_empty() {
            connection.write_all(b": nothing new\n\n")?;
            continue;
        }
        connection.write_all(messages.concat().as_bytes())?;
    }
}
