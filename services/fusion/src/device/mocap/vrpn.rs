//! A client of a VRPN server, by TCP alone, or called back by the server and with reports by UDP.

use super::{DATAGRAM_LEN, Ear, wait};
use crate::device::POLL;
use fss_wire::vrpn::{self, COOKIE_LEN};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::time::{Duration, Instant};

/// How long a server may take to answer.
const ANSWER_TIME: Duration = Duration::from_secs(1);

/// Connects, listens, and connects again where the connection is lost.
pub(super) fn run(ear: &mut Ear, server: SocketAddr, is_udp: bool) {
    while !ear.is_stopped() {
        let connected = if is_udp { call_back(ear, server) } else { connect(server).map(|stream| (stream, None)) };
        if let Ok((stream, reports)) = connected {
            // It ends with an error where the connection is lost, and is made again.
            let _ = listen(ear, stream, reports.as_ref());
            ear.reader.forget();
        }
        std::thread::sleep(POLL);
    }
}

fn connect(server: SocketAddr) -> io::Result<TcpStream> {
    TcpStream::connect_timeout(&server, ANSWER_TIME)
}

/// Asks the server to connect to this computer; gives the connection, and the socket of reports.
fn call_back(ear: &Ear, server: SocketAddr) -> io::Result<(TcpStream, Option<UdpSocket>)> {
    let local = local_ip(server)?;
    let listener = TcpListener::bind((local, 0))?;
    listener.set_nonblocking(true)?;
    let question = UdpSocket::bind((local, 0))?;
    question.send_to(vrpn::call_back(local, listener.local_addr()?.port()).as_bytes(), server)?;
    let asked = Instant::now();
    while asked.elapsed() < ANSWER_TIME && !ear.is_stopped() {
        wait(&[&listener]);
        match listener.accept() {
            Ok((stream, from)) if from.ip() == server.ip() => {
                let reports = UdpSocket::bind((local, 0))?;
                reports.set_nonblocking(true)?;
                return Ok((stream, Some(reports)));
            }
            _ => {}
        }
    }
    Err(ErrorKind::TimedOut.into())
}

/// This computer's address as the server sees it.
fn local_ip(server: SocketAddr) -> io::Result<IpAddr> {
    let unspecified = if server.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
    let socket = UdpSocket::bind(unspecified)?;
    socket.connect(server)?;
    Ok(socket.local_addr()?.ip())
}

fn listen(ear: &mut Ear, mut stream: TcpStream, reports: Option<&UdpSocket>) -> io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(ANSWER_TIME))?;
    stream.write_all(&vrpn::cookie())?;
    let mut cookie = [0; COOKIE_LEN];
    stream.read_exact(&mut cookie)?;
    vrpn::check_cookie(&cookie).map_err(io::Error::other)?;
    if let Some(reports) = reports {
        let address = reports.local_addr()?;
        let mut buffer = [0; 256];
        let len = vrpn::describe_udp(address.ip(), address.port(), &mut buffer).map_err(io::Error::other)?;
        stream.write_all(buffer.get(..len).unwrap_or_default())?;
    }
    stream.set_nonblocking(true)?;
    let (mut said, mut buffer) = (Vec::new(), vec![0; DATAGRAM_LEN]);
    let nonsense = || io::Error::from(ErrorKind::InvalidData);
    while !ear.is_stopped() {
        match reports {
            Some(reports) => wait(&[&stream, reports]),
            None => wait(&[&stream]),
        }
        match stream.read(&mut buffer) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(len) => {
                said.extend_from_slice(buffer.get(..len).unwrap_or_default());
                let used = ear.hear(&said).ok_or_else(nonsense)?;
                said.drain(..used);
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
            Err(error) => return Err(error),
        }
        while let Some(Ok((len, from))) = reports.map(|reports| reports.recv_from(&mut buffer)) {
            if from.ip() == stream.peer_addr()?.ip() {
                ear.hear(buffer.get(..len).unwrap_or_default());
            }
        }
    }
    Ok(())
}
