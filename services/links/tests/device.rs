//! The radio's thread on real sockets.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_bus::Bus;
use fss_links::device::Device;
use fss_links::{COMMAND_QUEUE, CommandDatagram, TELEMETRY_QUEUE, TelemetryDatagram};
use std::net::UdpSocket;
use std::time::{Duration, Instant};

#[test]
fn datagrams_cross_between_queues_and_sockets_and_strangers_are_not_heard() {
    let links: Vec<UdpSocket> = (0..2).map(|_| UdpSocket::bind("127.0.0.1:0").unwrap()).collect();
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    let bus = Bus::local();
    let telemetry = bus.queue::<TelemetryDatagram>(TELEMETRY_QUEUE, 64).unwrap();
    let commands = bus.queue::<CommandDatagram>(COMMAND_QUEUE, 64).unwrap();
    let addresses = links.iter().map(|link| link.local_addr().unwrap()).collect();
    let device =
        Device::start("127.0.0.1:0".parse().unwrap(), addresses, telemetry.clone(), commands.clone(), false).unwrap();

    let _ = commands.push(CommandDatagram { link: 1, bytes: [7; 60] });
    let _ = commands.push(CommandDatagram { link: 9, bytes: [9; 60] });
    let mut buffer = [0; 100];
    links[1].set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let (len, from) = links[1].recv_from(&mut buffer).unwrap();
    assert_eq!((&buffer[..len], from), (&[7; 60][..], device.local_addr()));

    stranger.send_to(b"hello", from).unwrap();
    links[0].send_to(b"telemetry", from).unwrap();
    let deadline = Instant::now() + Duration::from_secs(10);
    let received = loop {
        if let Some(datagram) = telemetry.pop() {
            break datagram;
        }
        assert!(Instant::now() < deadline, "nothing was received");
        std::thread::sleep(Duration::from_millis(1));
    };
    assert_eq!(received.bytes(), b"telemetry");
    assert!(received.received_ns > 0 && telemetry.is_empty());
    drop(device);
    UdpSocket::bind(from).expect("the port is free again");
}

#[test]
fn a_taken_port_is_an_error() {
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let bus = Bus::local();
    let telemetry = bus.queue(TELEMETRY_QUEUE, 64).unwrap();
    let commands = bus.queue(COMMAND_QUEUE, 64).unwrap();
    let error = Device::start(taken.local_addr().unwrap(), Vec::new(), telemetry, commands, false).unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::AddrInUse);
}
