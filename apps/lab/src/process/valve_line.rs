//! The valve line: a Unix socket in place of a GPIO request and the valve box behind it.
//!
//! The box has a watchdog of its own, as the real one must have: where the driver is alive but says nothing (its process
//! is frozen), no pull-down helps. Together with the `thrusters` service's dead-man of 45 ms its [`WATCHDOG_NS`] shuts
//! every valve within 100 ms of the last command.

use super::arrivals::{Arrivals, Line};
use crate::LabError;
use fss_bus::Time;
use fss_wire::valves::Decoder;
use std::fs::{self, Permissions};
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// Time after the last frame at which the valve box shuts all valves, ns: seven frames are missing then.
const WATCHDOG_NS: u64 = 35_000_000;

/// All valves shut: the state of lines that nobody drives.
const SHUT: u16 = 0;

/// The laboratory's end of the valve line. One driver at a time has the lines, as with GPIO.
#[derive(Debug)]
pub(super) struct ValveLine {
    listener: UnixListener,
    path: PathBuf,
    driver: Option<(UnixStream, Decoder)>,
    /// The last frame and when it came.
    last: (u16, Time),
    /// When it was looked for frames.
    looked: Option<Time>,
}

impl ValveLine {
    /// Listens at `path`; a socket left by a dead laboratory is replaced, that of a living one is an error.
    pub(super) fn open(path: &Path, arrivals: &Arrivals) -> Result<Self, LabError> {
        let error = |what| move |source| LabError::Path { what, path: path.to_path_buf(), source };
        if fs::symlink_metadata(path).is_ok_and(|meta| meta.file_type().is_socket()) {
            if UnixStream::connect(path).is_ok() {
                return Err(error("opening the valve line")(io::Error::from(ErrorKind::AddrInUse)));
            }
            fs::remove_file(path).map_err(error("replacing an old valve line"))?;
        }
        let listener = UnixListener::bind(path).map_err(error("opening the valve line"))?;
        let line =
            Self { listener, path: path.to_path_buf(), driver: None, last: (SHUT, Time::default()), looked: None };
        line.listener.set_nonblocking(true).map_err(error("opening the valve line"))?;
        arrivals.watch(&line.listener, Line::Drivers).map_err(error("watching the valve line"))?;
        fs::set_permissions(path, Permissions::from_mode(0o600)).map_err(error("protecting the valve line"))?;
        Ok(line)
    }

    /// The mask of the last frame since the last call; shut where the driver has gone or is silent; `None` without news.
    ///
    /// A real box goes on counting while the host does not run this laboratory. Where it was not looked for longer than the
    /// watchdog waits, frames that have come meanwhile do not tell when: they open nothing, the next one does.
    pub(super) fn poll(&mut self, now: Time, arrivals: &Arrivals) -> Option<u16> {
        let stood_still = self.looked.replace(now).is_some_and(|before| now.age_ns(before.ns()) > WATCHDOG_NS);
        if let Some(mask) = self.news(arrivals).map(|mask| if stood_still { SHUT } else { mask }) {
            self.last = (mask, now);
            return Some(mask);
        }
        let (mask, at) = self.last;
        (mask != SHUT && now.age_ns(at.ns()) > WATCHDOG_NS).then(|| {
            self.last = (SHUT, now);
            SHUT
        })
    }

    fn news(&mut self, arrivals: &Arrivals) -> Option<u16> {
        let mut news = if arrivals.came_on(Line::Valves) { self.read() } else { None };
        if !arrivals.came_on(Line::Drivers) {
            return news;
        }
        while let Ok((stream, _)) = self.listener.accept() {
            // Who comes while the lines are taken is sent away.
            if self.driver.is_none()
                && stream.set_nonblocking(true).is_ok()
                && arrivals.watch(&stream, Line::Valves).is_ok()
            {
                self.driver = Some((stream, Decoder::new()));
                news = self.read().or(news);
            }
        }
        news
    }

    fn read(&mut self) -> Option<u16> {
        let (stream, decoder) = self.driver.as_mut()?;
        let mut news = None;
        let mut buffer = [0; 512];
        loop {
            match stream.read(&mut buffer) {
                Ok(len) if len > 0 => {
                    for frame in buffer.iter().take(len).filter_map(|byte| decoder.push(*byte)) {
                        news = Some(frame.mask);
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return news,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Ok(_) | Err(_) => {
                    self.driver = None;
                    return Some(SHUT);
                }
            }
        }
    }
}

impl Drop for ValveLine {
    fn drop(&mut self) {
        let _ignored = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::expect_used)]
mod tests {
    use super::*;
    use fss_wire::valves::ValveFrame;
    use std::io::Write;

    #[test]
    fn frames_that_waited_while_the_host_stood_still_open_no_valve() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("valves.sock");
        let mut arrivals = Arrivals::new().unwrap();
        let mut line = ValveLine::open(&path, &arrivals).unwrap();
        let mut driver = UnixStream::connect(&path).unwrap();
        let at_ms = |ms: u64| Time::from_ns(1_000_000_000 + ms * 1_000_000);
        let mut counter = 0;
        let mut send = |mask| {
            counter += 1;
            driver.write_all(&ValveFrame { mask, counter }.encode()).unwrap();
        };
        let mut poll = |now| {
            arrivals.look();
            line.poll(now, &arrivals)
        };
        poll(at_ms(0));
        send(0b11);
        assert_eq!(poll(at_ms(1)), Some(0b11));
        send(0b11);
        assert_eq!(poll(at_ms(201)), Some(SHUT));
        send(0b11);
        assert_eq!(poll(at_ms(202)), Some(0b11));
        assert_eq!(poll(at_ms(220)), None);
        assert_eq!(poll(at_ms(238)), Some(SHUT));
    }
}
