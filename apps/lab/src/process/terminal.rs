//! The gyro's serial port: a pseudo-terminal, and a symbolic link to it at a fixed place.

use crate::LabError;
use rustix::fd::OwnedFd;
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, ioctl_tiocgptpeer, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

/// Speed of the DSP-3000's line (baud).
const BAUD: u32 = 38_400;

/// The gyro's end of the line.
#[derive(Debug)]
pub(super) struct Terminal {
    master: OwnedFd,
    /// The other end's name, to which the symbolic link points.
    name: PathBuf,
    link: PathBuf,
    is_read: bool,
}

impl Terminal {
    /// Makes a raw terminal at 38400 8N1 and puts a link to it at `link`; a link left by a dead laboratory is replaced.
    pub(super) fn open(link: &Path) -> Result<Self, LabError> {
        let failed = |what| move |errno: Errno| LabError::Terminal { what, source: errno.into() };
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).map_err(failed("open"))?;
        grantpt(&master).map_err(failed("grant"))?;
        unlockpt(&master).map_err(failed("unlock"))?;
        fcntl_setfl(&master, OFlags::RDWR | OFlags::NONBLOCK).map_err(failed("make non-blocking"))?;
        let name = ptsname(&master, Vec::new()).map_err(failed("name"))?;
        make_raw(&master).map_err(failed("set up as a serial line"))?;
        let terminal = Self {
            master,
            name: PathBuf::from(name.to_string_lossy().into_owned()),
            link: link.to_path_buf(),
            is_read: false,
        };
        terminal.publish()?;
        Ok(terminal)
    }

    fn publish(&self) -> Result<(), LabError> {
        let path = &self.link;
        let error = |what, source| LabError::Path { what, path: path.clone(), source };
        if fs::symlink_metadata(path).is_ok_and(|meta| meta.is_symlink()) {
            fs::remove_file(path).map_err(|e| error("replacing the gyro's old terminal", e))?;
        }
        symlink(&self.name, path).map_err(|e| error("publishing the gyro's terminal", e))
    }

    /// The end that is read and written.
    pub(super) fn line(&self) -> &OwnedFd {
        &self.master
    }

    /// Reads what the computer asks of the gyro, where anything came, and notices whether anybody has the line open: that
    /// nobody has is news as well, again and again.
    pub(super) fn poll(&mut self, has_news: bool, mut request: impl FnMut(u8)) {
        if !has_news {
            self.is_read = true;
            return;
        }
        let mut buffer = [0; 64];
        match rustix::io::read(&self.master, &mut buffer) {
            Ok(len) => {
                self.is_read = true;
                buffer.iter().take(len).for_each(|byte| request(*byte));
            }
            Err(Errno::AGAIN) => self.is_read = true,
            // Linux says EIO where nobody has the other end open.
            Err(_) => {
                if self.is_read {
                    self.forget();
                }
                self.is_read = false;
            }
        }
    }

    /// Sends bytes, if anybody listens; what does not fit into the line's buffer is lost.
    pub(super) fn write(&mut self, bytes: &[u8]) {
        if self.is_read {
            // A full buffer takes a part or nothing; the reader finds the next line again.
            let _lost = rustix::io::write(&self.master, bytes);
        }
    }

    /// Drops what the last reader left unread: the next one shall not take it for news.
    fn forget(&self) {
        if let Ok(peer) = ioctl_tiocgptpeer(&self.master, OpenptFlags::RDWR | OpenptFlags::NOCTTY) {
            let _ignored = tcflush(&peer, QueueSelector::IOFlush);
        }
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        // Another laboratory may have put its own link there since.
        if fs::read_link(&self.link).is_ok_and(|target| target == self.name) {
            let _ignored = fs::remove_file(&self.link);
        }
    }
}

fn make_raw(master: &OwnedFd) -> Result<(), Errno> {
    let peer = ioctl_tiocgptpeer(master, OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    let mut settings = tcgetattr(&peer)?;
    settings.make_raw();
    settings.set_speed(BAUD)?;
    tcsetattr(&peer, OptionalActions::Now, &settings)
}
