//! The laboratory in real time, through its sockets and its terminal. Every wait has a generous end; none asserts a time.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::{config, key, plant, velocity};
use fss_bus::launch::Mocap;
use fss_lab::process::{Addresses, Process};
use fss_messages::TruthState;
use fss_wire::dsp3000::Decoder;
use fss_wire::link::{Command, Telemetry};
use fss_wire::valves::ValveFrame;
use fss_wire::vicon::Frame;
use std::fs::OpenOptions;
use std::io::{Read, Write};
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(20);

/// A laboratory in a thread of its own.
struct Running {
    links: Vec<SocketAddr>,
    truth: Receiver<TruthState>,
    stop: std::sync::Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Running {
    fn start(addresses: &Addresses) -> Self {
        let mut process = Process::open(&plant(), config(), addresses).unwrap();
        let links = process.links().collect();
        let stop = std::sync::Arc::new(AtomicBool::new(false));
        let (sender, truth) = mpsc::channel();
        let flag = stop.clone();
        let thread =
            thread::spawn(move || process.run(&flag, |truth| sender.send(*truth).unwrap_or(()), |_| ()).unwrap());
        Self { links, truth, stop, thread: Some(thread) }
    }

    /// Waits until the truth is as wanted.
    fn until(&self, what: &str, wanted: impl Fn(&TruthState) -> bool) -> TruthState {
        let start = Instant::now();
        loop {
            assert!(start.elapsed() < PATIENCE, "it did not come: {what}");
            let truth = self.truth.recv_timeout(PATIENCE).unwrap_or_else(|_| panic!("no truth while waiting: {what}"));
            if wanted(&truth) {
                return truth;
            }
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

/// Says the same mask every 5 ms, as the thrusters' process does, until it is dropped.
struct Driver {
    stop: std::sync::Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Driver {
    fn connect(valves: &Path, mask: u16) -> Self {
        let mut line = UnixStream::connect(valves).unwrap();
        let stop = std::sync::Arc::new(AtomicBool::new(false));
        let flag = stop.clone();
        let thread = thread::spawn(move || {
            for counter in 0.. {
                if flag.load(Ordering::Relaxed) {
                    return;
                }
                line.write_all(&ValveFrame { mask, counter }.encode()).unwrap();
                thread::sleep(Duration::from_millis(5));
            }
        });
        Self { stop, thread: Some(thread) }
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

fn addresses(folder: &Path, tracker: SocketAddr) -> Addresses {
    let any: SocketAddr = "127.0.0.1:0".parse().unwrap();
    let (gyro, valves) = (folder.join("gyro.tty"), folder.join("valves.sock"));
    Addresses { mocap: Mocap::vicon(tracker), gyro, valves, links: vec![any; 4], shared_table: None }
}

fn socket() -> UdpSocket {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    socket
}

#[test]
fn a_valve_line_that_closes_shuts_the_valves_and_another_driver_may_come() {
    let folder = tempfile::tempdir().unwrap();
    let addresses = addresses(folder.path(), socket().local_addr().unwrap());
    let running = Running::start(&addresses);
    for _ in 0..3 {
        let line = Driver::connect(&addresses.valves, 0b101);
        running.until("valves 1 and 3 open", |truth| truth.thrust_n[0] > 0.1 && truth.thrust_n[2] > 0.1);
        drop(line);
        running.until("valves shut", |truth| truth.valves == [0; 16] && truth.thrust_n == [0.0; 16]);
    }
}

#[test]
fn only_one_driver_has_the_valve_line() {
    let folder = tempfile::tempdir().unwrap();
    let addresses = addresses(folder.path(), socket().local_addr().unwrap());
    let running = Running::start(&addresses);
    let _first = Driver::connect(&addresses.valves, 1);
    running.until("valve 1 open", |truth| truth.valves[0] == 1);
    let mut second = UnixStream::connect(&addresses.valves).unwrap();
    second.set_read_timeout(Some(PATIENCE)).unwrap();
    assert_eq!(second.read(&mut [0; 1]).unwrap(), 0, "the second one is sent away");
    running.until("valve 1 stays open", |truth| truth.valves[0] == 1);
}

#[test]
fn motion_capture_arrives_by_udp_and_shows_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let tracker = socket();
    let running = Running::start(&addresses(folder.path(), tracker.local_addr().unwrap()));
    let truth = running.until("anything", |_| true);
    let mut buffer = [0; 2048];
    let mut last = 0;
    for _ in 0..20 {
        let len = tracker.recv(&mut buffer).unwrap();
        let frame = Frame::decode(&buffer[..len]).unwrap();
        assert!(frame.number() > last);
        last = frame.number();
        let tip = frame.object("end_effector").unwrap();
        assert!((tip.position_m[0] - truth.ee[0]).abs() < 0.01);
    }
}

#[test]
fn the_gyro_is_read_like_a_serial_port_and_old_lines_do_not_wait_for_the_next_reader() {
    let folder = tempfile::tempdir().unwrap();
    let addresses = addresses(folder.path(), socket().local_addr().unwrap());
    let running = Running::start(&addresses);
    let open = || OpenOptions::new().read(true).write(true).open(&addresses.gyro).unwrap();
    let read_lines = |port: &mut std::fs::File, wanted: usize| {
        let mut decoder = Decoder::new();
        let (mut lines, mut buffer) = (0, [0; 256]);
        while lines < wanted {
            let len = port.read(&mut buffer).unwrap();
            lines += buffer[..len].iter().filter(|byte| decoder.push(**byte).is_some()).count();
        }
        assert_eq!(decoder.rejected(), 0);
    };
    let mut port = open();
    port.write_all(b"R").unwrap();
    read_lines(&mut port, 10);
    let wait = || {
        for _ in 0..50 {
            running.until("half a second", |_| true);
        }
    };
    // Let lines pile up unread, close the port, and let nobody read for a while.
    wait();
    drop(port);
    wait();
    let mut port = open();
    let mut buffer = [0; 4096];
    let len = port.read(&mut buffer).unwrap();
    assert!(len < 200, "{len} bytes waited for the next reader");
    read_lines(&mut port, 3);
}

#[test]
fn a_link_is_commanded_and_answers_by_udp() {
    let folder = tempfile::tempdir().unwrap();
    let running = Running::start(&addresses(folder.path(), socket().local_addr().unwrap()));
    let computer = socket();
    let mut buffer = [0; 256];
    for sequence in 1..=5 {
        let datagram = Command { link: 2, sequence, ..velocity(0.2) }.encode(&key());
        computer.send_to(&datagram, running.links[1]).unwrap();
        let (len, from) = computer.recv_from(&mut buffer).unwrap();
        assert_eq!(from, running.links[1]);
        assert_eq!(Telemetry::decode(&buffer[..len]).unwrap().link, 2);
    }
    running.until("the joint moves", |truth| truth.q_rad[1] > 0.01);
}

#[test]
fn a_laboratory_that_ends_leaves_nothing_behind_and_a_dead_ones_remains_are_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let addresses = addresses(folder.path(), socket().local_addr().unwrap());
    // What a killed laboratory leaves: a socket that nobody serves and a link to a terminal that is gone.
    drop(std::os::unix::net::UnixListener::bind(&addresses.valves).unwrap());
    std::os::unix::fs::symlink("/dev/pts/gone", &addresses.gyro).unwrap();
    let process = Process::open(&plant(), config(), &addresses).unwrap();
    assert!(addresses.valves.exists() && addresses.gyro.exists());
    drop(process);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn what_cannot_be_opened_is_named_and_nothing_stays_behind() {
    let folder = tempfile::tempdir().unwrap();
    let free = addresses(folder.path(), socket().local_addr().unwrap());
    let refusal =
        |addresses: &Addresses| Process::open(&plant(), config(), addresses).expect_err("refused").to_string();

    let taken = socket();
    let mut busy = free.clone();
    busy.links[2] = taken.local_addr().unwrap();
    let text = refusal(&busy);
    assert!(text.contains("link 3") && text.contains(&busy.links[2].to_string()), "{text}");

    let text = refusal(&Addresses { gyro: folder.path().join("nowhere/gyro.tty"), ..free.clone() });
    assert!(text.contains("nowhere/gyro.tty") && text.contains("folder does not exist"), "{text}");
    let text = refusal(&Addresses { valves: folder.path().join("nowhere/valves.sock"), ..free.clone() });
    assert!(text.contains("nowhere/valves.sock"), "{text}");
    let text = refusal(&Addresses { links: free.links[..3].to_vec(), ..free.clone() });
    assert!(text.contains("3 link addresses") && text.contains("4 links"), "{text}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);

    let first = Process::open(&plant(), config(), &free).unwrap();
    let second = Addresses { gyro: folder.path().join("second.tty"), ..free.clone() };
    let text = refusal(&second);
    assert!(text.contains("valves.sock") && text.contains("another laboratory"), "{text}");
    drop(first);
}
