//! The gate before the viewers: who may come in.
//!
//! A browser lets any page open a WebSocket to this computer, and only tells in `Origin` whose page it is. So requests are
//! read here, and pages of other origins than the launch file names are refused. There is no other socket.

use crate::origin::{self, Verdict};
use crate::session;
use crate::viewers::Viewers;
use fss_messages::Event;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// A request is no longer than this, bytes.
const LONGEST_REQUEST: usize = 8192;
/// So many connections at once.
const MOST_CONNECTIONS: usize = 32;
/// Who has not said a whole request after so long is left.
const PATIENCE: Duration = Duration::from_secs(10);

/// What listens.
pub(crate) struct Gate {
    port: u16,
    connections: Arc<AtomicUsize>,
}

impl Gate {
    /// Listens, and lets in; the thread that does so ends with the process.
    pub(crate) fn open(listen: SocketAddr, viewers: Arc<Viewers>) -> io::Result<Self> {
        let listener = TcpListener::bind(listen)?;
        let port = listener.local_addr()?.port();
        let connections = Arc::new(AtomicUsize::new(0));
        let counted = connections.clone();
        let admit = move || admit(&listener, &viewers, &counted);
        std::thread::Builder::new().name("gate".to_owned()).spawn(admit)?;
        Ok(Self { port, connections })
    }

    pub(crate) fn port(&self) -> u16 {
        self.port
    }

    /// Waits at most so long until all have gone.
    pub(crate) fn wait(&self, patience: Duration) {
        let begun = Instant::now();
        while self.connections.load(Ordering::Relaxed) > 0 && begun.elapsed() < patience {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

fn admit(listener: &TcpListener, viewers: &Arc<Viewers>, connections: &Arc<AtomicUsize>) {
    for connection in listener.incoming().flatten() {
        if connections.fetch_add(1, Ordering::Relaxed) >= MOST_CONNECTIONS {
            connections.fetch_sub(1, Ordering::Relaxed);
            continue;
        }
        let (viewers, connections) = (viewers.clone(), connections.clone());
        std::thread::spawn(move || {
            let _who_came_may_be_gone = receive(connection, &viewers);
            connections.fetch_sub(1, Ordering::Relaxed);
        });
    }
}

fn receive(connection: TcpStream, viewers: &Viewers) -> io::Result<()> {
    let (request, verdict) = read(&connection, &viewers.origins)?;
    if let Verdict::Foreign(origin) = &verdict {
        let words = format!("a page of {origin} is refused: [ground] origins does not name it");
        viewers.say_rarely(Event::WARNING, words);
    }
    match verdict {
        Verdict::Welcome { accept, length } => {
            (&connection).write_all(accept.as_bytes())?;
            session::serve(connection, request[length..].to_vec(), viewers)
        }
        Verdict::Metrics => show(&connection, &viewers.metrics()),
        refused => {
            let (status, why) = refused.refusal();
            refuse(&connection, status, &why)
        }
    }
}

/// Answers in Prometheus' text format.
fn show(mut connection: &TcpStream, metrics: &str) -> io::Result<()> {
    let head = "HTTP/1.1 200 OK\r\nContent-Type: text/plain; version=0.0.4\r\nConnection: close\r\nContent-Length: ";
    write!(connection, "{head}{}\r\n\r\n{metrics}", metrics.len())
}

/// Reads the request, and what may have come behind it already.
fn read(mut connection: &TcpStream, origins: &[String]) -> io::Result<(Vec<u8>, Verdict)> {
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
        match origin::judge(&request[..length], origins) {
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

fn refuse(mut connection: &TcpStream, status: &str, why: &str) -> io::Result<()> {
    let head = format!("HTTP/1.1 {status}\r\nContent-Type: text/plain\r\nContent-Length: {}\r\n", why.len());
    connection.write_all(format!("{head}Connection: close\r\n\r\n{why}").as_bytes())
}
