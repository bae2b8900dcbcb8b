//! Threads that listen to motion capture and read the gyro's serial port.

mod mocap;

pub use mocap::{packet, receive_mocap};

use crate::GyroPacket;
use fss_bus::{Queue, realtime};
use fss_wire::dsp3000;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// How soon a device thread notices that it shall stop.
const POLL: Duration = Duration::from_millis(50);
/// A reading of the gyro that arrived at `received_ns`, its sign as the plant counts.
pub fn gyro_packet(reading: dsp3000::Reading, received_ns: u64) -> GyroPacket {
    GyroPacket { received_ns, rate_rad_s: reading.value_rad, valid: reading.is_usable_rate() }
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
