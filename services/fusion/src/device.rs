//! Threads that read the tracker's datagrams and the gyro's serial port.

use crate::{GyroPacket, MocapPacket};
use fss_bus::{Queue, realtime};
use fss_wire::dsp3000;
use fss_wire::vicon::Frame;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// How soon a device thread notices that it shall stop.
const POLL: Duration = Duration::from_millis(50);
/// Longer than any datagram of the tracker.
const DATAGRAM_LEN: usize = 2048;

/// The tracker's names of the bodies, in the order of [`MocapPacket::poses`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectNames(pub [String; 3]);

impl Default for ObjectNames {
    fn default() -> Self {
        Self(["base", "end_effector", "target"].map(str::to_owned))
    }
}

/// What a datagram that arrived at `received_ns` says of the named bodies; `None` where it is malformed.
pub fn decode_vicon(datagram: &[u8], names: &ObjectNames, received_ns: u64) -> Option<MocapPacket> {
    let frame = Frame::decode(datagram).ok()?;
    let mut packet = MocapPacket { received_ns, frame: frame.number(), poses: [None; 3] };
    for object in frame.objects() {
        if let Some(body) = names.0.iter().position(|name| name == object.name) {
            let seen = object.is_tracked();
            let pose = [object.position_m[0], object.position_m[1], object.rotation_rad[2]];
            packet.poses[body] = Some(if seen { pose } else { [0.0; 3] });
        }
    }
    Some(packet)
}

/// A reading of the gyro that arrived at `received_ns`, its sign as the plant counts.
pub fn gyro_packet(reading: dsp3000::Reading, received_ns: u64) -> GyroPacket {
    GyroPacket { received_ns, rate_rad_s: reading.value_rad, valid: reading.is_usable_rate() }
}

/// Receives motion capture until `stop` is set; as urgently as a real-time service needs it, or not.
///
/// # Errors
/// Where the address cannot be bound.
pub fn receive_vicon(
    address: SocketAddr,
    names: ObjectNames,
    queue: Queue<MocapPacket>,
    stop: Arc<AtomicBool>,
    urgent: bool,
) -> io::Result<JoinHandle<()>> {
    let socket = UdpSocket::bind(address)?;
    socket.set_read_timeout(Some(POLL))?;
    std::thread::Builder::new().name("vicon".to_owned()).spawn(move || {
        if urgent {
            realtime::enter_device();
        }
        let mut datagram = [0; DATAGRAM_LEN];
        while !stop.load(Ordering::Relaxed) {
            let Ok((len, _)) = socket.recv_from(&mut datagram) else { continue };
            let Ok(now) = realtime::now() else { return };
            if let Some(packet) = decode_vicon(&datagram[..len], &names, now.ns()) {
                // A full queue loses its oldest frame: the newest counts.
                queue.force_push(packet);
            }
        }
    })
}

/// Reads the gyro's serial port until `stop` is set, as urgently as a real-time service needs it, or not; a port that fails is opened again.
///
/// # Errors
/// Where the port cannot be opened at first.
pub fn read_gyro(
    path: &Path,
    queue: Queue<GyroPacket>,
    stop: Arc<AtomicBool>,
    urgent: bool,
) -> io::Result<JoinHandle<()>> {
    let mut port = Some(open_serial(path)?);
    let path = path.to_owned();
    std::thread::Builder::new().name("gyro".to_owned()).spawn(move || {
        if urgent {
            realtime::enter_device();
        }
        let mut decoder = dsp3000::Decoder::new();
        let mut bytes = [0; 256];
        while !stop.load(Ordering::Relaxed) {
            let Some(open) = &mut port else {
                std::thread::sleep(POLL);
                port = open_serial(&path).ok();
                continue;
            };
            let len = match open.read(&mut bytes) {
                Ok(0) => {
                    std::thread::sleep(Duration::from_millis(1));
                    continue;
                }
                Ok(len) => len,
                Err(e) if matches!(e.kind(), ErrorKind::Interrupted | ErrorKind::WouldBlock) => continue,
                Err(_) => {
                    port = None;
                    continue;
                }
            };
            let Ok(now) = realtime::now() else { return };
            for &byte in &bytes[..len] {
                if let Some(reading) = decoder.push(byte) {
                    queue.force_push(gyro_packet(reading, now.ns()));
                }
            }
        }
    })
}

/// Opens a serial port raw at 38400 baud, 8 data bits, no parity, 1 stop bit, without handshake; a read returns within
/// 0.1 s. Opening waits for no carrier, and the port does not become the process's terminal.
fn open_serial(path: &Path) -> io::Result<File> {
    use rustix::fs::{Mode, OFlags, fcntl_setfl, open};
    use rustix::termios::{ControlModes, OptionalActions, SpecialCodeIndex, tcgetattr, tcsetattr};
    let port = open(path, OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC, Mode::empty())?;
    let mut settings = tcgetattr(&port)?;
    settings.make_raw();
    settings.control_modes.insert(ControlModes::CLOCAL | ControlModes::CREAD);
    settings.control_modes.remove(ControlModes::CSTOPB | ControlModes::PARENB | ControlModes::CRTSCTS);
    settings.set_speed(38_400)?;
    settings.special_codes[SpecialCodeIndex::VMIN] = 0;
    settings.special_codes[SpecialCodeIndex::VTIME] = 1;
    tcsetattr(&port, OptionalActions::Now, &settings)?;
    fcntl_setfl(&port, OFlags::empty())?;
    Ok(File::from(port))
}
