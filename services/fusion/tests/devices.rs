//! The device threads: what comes over the network and the serial line reaches the queues, and what cannot be opened says so.
#![allow(clippy::unwrap_used)]

use fss_bus::launch::Mocap;
use fss_bus::{Bus, InputPort, Latest, Queue, Runner, Time, realtime};
use fss_fusion::device::{gyro_packet, read_gyro, receive_mocap};
use fss_fusion::{Fusion, FusionConfig, GYRO_QUEUE, GyroPacket, MOCAP_QUEUE, MocapPacket};
use fss_messages::{GyroRate, topic};
use fss_plant::Plant;
use fss_wire::dsp3000::{Line, Reading};
use fss_wire::vicon::{self, Object};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The next message; fails where none comes for 10 s.
fn next<T>(queue: &Queue<T>) -> T {
    for _ in 0..10_000 {
        if let Some(message) = queue.pop() {
            return message;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("nothing arrived");
}

/// A free port of this computer.
fn free_address() -> SocketAddr {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

fn datagram(frame: u32, name: &str, x_m: f64) -> Vec<u8> {
    let object = Object { name, position_m: [x_m, 0.2, 0.25], rotation_rad: [0.0, 0.0, 0.3] };
    let mut bytes = [0; vicon::MAX_DATAGRAM_LEN];
    let len = vicon::encode(frame, &[object], &mut bytes).unwrap();
    bytes[..len].to_vec()
}

#[test]
fn motion_capture_arrives_by_name_and_nonsense_does_not() {
    let queue: Queue<MocapPacket> = Bus::local().queue(MOCAP_QUEUE, 64).unwrap();
    let (address, stop) = (free_address(), Arc::new(AtomicBool::new(false)));
    let thread = receive_mocap(&Mocap::vicon(address), queue.clone(), stop.clone(), false).unwrap();
    let tracker = UdpSocket::bind("127.0.0.1:0").unwrap();
    let before_ns = realtime::now().unwrap().ns();
    for bytes in [b"nonsense".to_vec(), Vec::new(), datagram(7, "base", 0.1), datagram(8, "wand", 0.1)] {
        tracker.send_to(&bytes, address).unwrap();
    }
    let base = next(&queue);
    assert_eq!((base.frame, base.poses[1]), (7, None));
    let pose = base.poses[0].unwrap();
    assert!((pose[0] - 0.1).abs() < 1e-9 && (pose[1] - 0.2).abs() < 1e-9 && (pose[2] - 0.3).abs() < 1e-9);
    assert!((before_ns..realtime::now().unwrap().ns()).contains(&base.received_ns), "stamped on receipt");
    assert_eq!(next(&queue).poses, [None; 3], "a body without a role");
    stop.store(true, Ordering::Relaxed);
    thread.join().unwrap();
}

#[test]
fn a_busy_port_is_refused() {
    let held = UdpSocket::bind("127.0.0.1:0").unwrap();
    let queue = Bus::local().queue(MOCAP_QUEUE, 64).unwrap();
    let result = receive_mocap(&Mocap::vicon(held.local_addr().unwrap()), queue, Arc::default(), false);
    assert_eq!(result.unwrap_err().kind(), ErrorKind::AddrInUse);
}

#[test]
fn the_gyros_lines_arrive_from_a_serial_port() {
    let unit = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&unit).unwrap();
    unlockpt(&unit).unwrap();
    let path = PathBuf::from(ptsname(&unit, Vec::new()).unwrap().into_string().unwrap());
    let queue: Queue<GyroPacket> = Bus::local().queue(GYRO_QUEUE, 64).unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let thread = read_gyro(&path, queue.clone(), stop.clone(), false).unwrap();
    let line = |value_rad, valid| Line::encode(Reading { value_rad, valid });
    let said = [
        b"cut off\r\n".as_slice(),
        line(0.1, true).as_bytes(),
        line(7.0, true).as_bytes(),
        line(0.1, false).as_bytes(),
    ]
    .concat();
    rustix::io::write(&unit, &said).unwrap();
    let (good, too_fast, faulty) = (next(&queue), next(&queue), next(&queue));
    assert!((good.rate_rad_s - 0.1).abs() < 1e-6 && good.valid);
    assert!(!too_fast.valid, "beyond its linear range the unit is wrong, whatever it says");
    assert!(!faulty.valid);
    stop.store(true, Ordering::Relaxed);
    thread.join().unwrap();
}

#[test]
fn a_reading_is_stamped_when_its_line_began_whatever_its_sign() {
    const BEGAN_NS: u64 = 1_000_000_000;
    for value_rad in [0.1, -0.1] {
        let bus = Bus::local();
        let config = FusionConfig::from_plant(&Plant::default_laboratory().unwrap());
        let mut runner = Runner::new(Fusion::new(config), &bus).unwrap();
        let mut rate = Latest::<GyroRate>::open(&bus, topic::GYRO).unwrap();
        let reading = Reading { value_rad, valid: true };
        let line_ns = Line::encode(reading).as_bytes().len() as u64 * 10 * 1_000_000_000 / 38_400;
        let queue: Queue<GyroPacket> = bus.queue(GYRO_QUEUE, 64).unwrap();
        queue.force_push(gyro_packet(reading, BEGAN_NS + line_ns));
        let now = Time::from_ns(BEGAN_NS + 2 * line_ns);
        runner.step(now);
        runner.flush(now);
        rate.refresh();
        let error_ns = rate.get().unwrap().stamp_ns.abs_diff(BEGAN_NS);
        assert!(error_ns < 1000, "{value_rad} rad/s: {error_ns} ns off");
    }
}

#[test]
fn a_gyro_that_is_not_there_or_is_no_serial_port_is_refused() {
    let open = |path: &Path| read_gyro(path, Bus::local().queue(GYRO_QUEUE, 64).unwrap(), Arc::default(), false);
    assert_eq!(open(Path::new("/dev/no-such-gyro")).unwrap_err().kind(), ErrorKind::NotFound);
    assert!(open(Path::new("/dev/null")).is_err());
}
