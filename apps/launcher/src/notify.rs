//! What systemd hears of a flight: that it is ready, that it lives, what it does (`sd_notify(3)`). Nothing where it does not ask.

use std::ffi::OsString;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::{Duration, Instant};

/// Where systemd listens; a child must not speak for the launcher.
pub(crate) const SOCKET_VARIABLE: &str = "NOTIFY_SOCKET";
/// Signs of life are so far apart; the unit's `WatchdogSec` is longer.
const PERIOD: Duration = Duration::from_secs(1);
/// Reading a long log at the end may take so long without one, microseconds.
const END_TIME_US: u64 = 600_000_000;

/// The line to systemd.
pub(crate) struct Systemd {
    line: Option<(UnixDatagram, SocketAddr)>,
    said: Option<Instant>,
}

impl Systemd {
    /// As the environment names it.
    pub(crate) fn from_environment() -> Self {
        Self::at(std::env::var_os(SOCKET_VARIABLE))
    }

    fn at(name: Option<OsString>) -> Self {
        let line = name.and_then(|name| {
            let address = match name.as_bytes() {
                [b'@', rest @ ..] => SocketAddr::from_abstract_name(rest).ok()?,
                _ => SocketAddr::from_pathname(&name).ok()?,
            };
            Some((UnixDatagram::unbound().ok()?, address))
        });
        Self { line, said: None }
    }

    /// Says that the flight lives, now and then, and once that it is ready.
    pub(crate) fn live(&mut self, is_ready: bool) {
        match self.said {
            None if is_ready => self.say("READY=1\nSTATUS=flies"),
            Some(said) if said.elapsed() >= PERIOD => self.say("WATCHDOG=1"),
            _ => return,
        }
        self.said = Some(Instant::now());
    }

    /// Says that it stops flying, and that the log is read now.
    pub(crate) fn ends(&self) {
        self.say(&format!("STATUS=has landed; reads its log\nWATCHDOG_USEC={END_TIME_US}"));
    }

    fn say(&self, words: &str) {
        if let Some((socket, address)) = &self.line {
            // Whoever asked to be told and does not listen misses it.
            let _ = socket.send_to_addr(words.as_bytes(), address);
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn systemd_hears_once_that_the_flight_is_ready_and_at_last_that_it_ends() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let listener = UnixDatagram::bind(&path).unwrap();
        listener.set_nonblocking(true).unwrap();
        let heard = || {
            let mut bytes = [0; 100];
            listener.recv(&mut bytes).ok().map(|len| String::from_utf8_lossy(&bytes[..len]).into_owned())
        };
        let mut systemd = Systemd::at(Some(path.into_os_string()));
        systemd.live(false);
        assert_eq!(heard(), None);
        systemd.live(true);
        systemd.live(true);
        assert!(heard().unwrap().starts_with("READY=1"));
        assert_eq!(heard(), None);
        systemd.ends();
        assert!(heard().unwrap().contains("WATCHDOG_USEC"));
    }
}
