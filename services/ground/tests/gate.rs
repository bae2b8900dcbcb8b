//! The gate as programs and browsers meet it: bytes over TCP.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_bus::Bus;
use fss_ground::{Ground, GroundConfig};
use fss_plant::Plant;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

/// A view that takes commands, and lets in one page beside those of this computer.
fn ground() -> (Ground, SocketAddr) {
    let listen = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let origins = vec!["https://app.foxglove.dev".to_owned()];
    let config = GroundConfig { listen, name: "test".to_owned(), commands: true, origins };
    (Ground::listen(&config, &Plant::default_laboratory().unwrap(), &Bus::local()).unwrap(), listen)
}

/// The first bytes that come for these.
fn answer(address: SocketAddr, request: &str) -> String {
    let mut connection = TcpStream::connect(address).unwrap();
    connection.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    connection.write_all(request.as_bytes()).unwrap();
    let mut answer = [0; 1024];
    let length = connection.read(&mut answer).unwrap();
    String::from_utf8_lossy(&answer[..length]).into_owned()
}

/// What a browser says to open a WebSocket, with these headers besides.
fn upgrade(headers: &str) -> String {
    format!(
        "GET / HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\
         Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n{headers}\r\n"
    )
}

#[test]
fn programs_and_pages_of_this_computer_come_in_and_foreign_pages_do_not() {
    let (ground, address) = ground();
    for welcome in [
        "",
        "Origin: http://localhost:8080\r\n",
        "Origin: http://127.0.0.1\r\n",
        "Origin: file://\r\n",
        "Origin: https://app.foxglove.dev\r\n",
    ] {
        let answer = answer(address, &upgrade(welcome));
        assert!(answer.starts_with("HTTP/1.1 101"), "'{welcome}' is let in: {answer}");
    }
    for foreign in [
        "Origin: https://evil.example\r\n",
        "ORIGIN: https://evil.example\r\n",
        "Origin: null\r\n",
        "Origin: https://app.foxglove.dev.evil.example\r\n",
        "Origin: http://localhost:8080\r\nOrigin: https://evil.example\r\n",
    ] {
        let answer = answer(address, &upgrade(foreign));
        assert!(answer.starts_with("HTTP/1.1 403"), "'{foreign}' is refused: {answer}");
        assert!(answer.contains("[ground] origins"), "it says what to do: {answer}");
    }
    ground.close();
}

#[test]
fn what_is_no_request_is_refused_and_others_come_in_after_it() {
    let (ground, address) = ground();
    let refused = |request: &str, status: &str| {
        let answer = answer(address, request);
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{answer}");
    };
    refused("\0\u{1}nonsense\r\n\r\n", "400");
    refused(&upgrade(&"X: y\r\n".repeat(100)), "431");
    refused(&format!("GET / HTTP/1.1\r\nX: {}", "a".repeat(8192 - 19)), "431");
    assert!(answer(address, &upgrade("")).starts_with("HTTP/1.1 101"));
    ground.close();
}

#[test]
fn a_request_that_comes_in_pieces_is_understood() {
    let (ground, address) = ground();
    let mut connection = TcpStream::connect(address).unwrap();
    connection.set_nodelay(true).unwrap();
    let request = upgrade("Origin: https://evil.example\r\n");
    for piece in request.as_bytes().chunks(40) {
        connection.write_all(piece).unwrap();
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut answer = [0; 12];
    connection.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 403");
    ground.close();
}
