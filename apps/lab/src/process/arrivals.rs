//! On which lines something has come: one question to the system for all of them, where a read of each would be eight.

use crate::LabError;
use rustix::event::{Timespec, epoll};
use rustix::fd::{AsFd, OwnedFd};
use std::io;
use std::mem::MaybeUninit;

/// Most lines that one look tells of; the system begins with the others at the next.
const MAX_LINES_PER_LOOK: usize = 32;

/// A line of the laboratory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Line {
    /// Where a driver of the valves comes in.
    Drivers,
    /// What the driver says.
    Valves,
    Gyro,
    SharedTable,
    /// Those who ask the tracker.
    Tracker,
    /// Of a link, from 0.
    Link(usize),
}

impl Line {
    /// Lines that share the last bit are read in vain at times, which is harmless.
    fn bit(self) -> u64 {
        match self {
            Line::Drivers => 1,
            Line::Valves => 1 << 1,
            Line::Gyro => 1 << 2,
            Line::SharedTable => 1 << 3,
            Line::Tracker => 1 << 4,
            Line::Link(link) => 1 << link.saturating_add(5).min(63),
        }
    }
}

/// The lines that are watched, and on which of them something came.
#[derive(Debug)]
pub(super) struct Arrivals {
    epoll: OwnedFd,
    came: u64,
}

impl Arrivals {
    pub(super) fn new() -> Result<Self, LabError> {
        let epoll = epoll::create(epoll::CreateFlags::CLOEXEC).map_err(|errno| LabError::Watch(errno.into()))?;
        Ok(Self { epoll, came: 0 })
    }

    /// Watches what `line` is read from, until that is closed; several may be the same line.
    pub(super) fn watch(&self, source: impl AsFd, line: Line) -> io::Result<()> {
        let data = epoll::EventData::new_u64(line.bit());
        Ok(epoll::add(&self.epoll, source, data, epoll::EventFlags::IN)?)
    }

    /// Looks, and does not wait.
    pub(super) fn look(&mut self) {
        let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
        let mut events = [MaybeUninit::uninit(); MAX_LINES_PER_LOOK];
        self.came = match epoll::wait(&self.epoll, &mut events, Some(&at_once)) {
            Ok((events, _)) => events.iter().fold(0, |came, event| came | event.data.u64()),
            // Nothing known: all are read.
            Err(_) => u64::MAX,
        };
    }

    /// Whether there is something to read on a line, its end among it, since the last look.
    pub(super) fn came_on(&self, line: Line) -> bool {
        self.came & line.bit() != 0
    }
}
