//! What is recorded on: one log after another.
//!
//! The tape never gives up. Where a log cannot be written (a full disk), it lets go of the file, which is readable to its
//! last whole chunk, counts what it cannot keep by topic, and begins another log when the disk has room again.

use crate::block::Block;
use fss_bus::Queue;
use fss_messages::{Event, Header};
use fss_records::log::{LogError, LogWriter, Recorded};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// How long the tape waits before it tries again to begin a log, and how often it looks at the disk's room, ns.
const RETRY_NS: u64 = 1_000_000_000;

/// Makes the log of a part, counted from 1, with its attachments.
pub type Opener = Box<dyn FnMut(u32) -> Result<LogWriter, LogError> + Send>;

/// Where a log ends and another begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of samples, before compression, after which a new log is begun; one log for all where absent.
    pub rotate_bytes: Option<u64>,
    /// Room that recording leaves on the disk: with less it pauses.
    pub keep_free_bytes: u64,
}

/// How a topic is entered in a log.
pub(crate) struct Definition {
    pub(crate) topic: String,
    /// Whether its samples' times are another host's: they enter the log at the time of those that came with them.
    pub(crate) has_own_clock: bool,
    /// What its samples are.
    pub(crate) sample: fss_messages::Definition,
}

/// Samples that could not be kept, by topic; written by the service and the tape, read by both.
pub(crate) type Lost = Arc<Vec<AtomicU64>>;

struct Part {
    log: LogWriter,
    channels: Vec<Recorded>,
    /// Samples, by topic, that have not reached the operating system yet: a failure loses them.
    pending: Vec<u64>,
}

pub(crate) struct Tape {
    open: Opener,
    definitions: Vec<Definition>,
    limits: Limits,
    part: Option<Part>,
    parts: u32,
    folder: PathBuf,
    lost: Lost,
    words: Queue<Event>,
    now_ns: u64,
    look_again_ns: u64,
    is_paused: bool,
}

impl Tape {
    /// Begins the first log; a recorder that cannot record from the start is an error.
    pub(crate) fn begin(
        open: Opener,
        definitions: Vec<Definition>,
        limits: Limits,
        lost: Lost,
        words: Queue<Event>,
    ) -> Result<Self, LogError> {
        let mut tape = Self {
            open,
            definitions,
            limits,
            part: None,
            parts: 0,
            folder: PathBuf::new(),
            lost,
            words,
            now_ns: 0,
            look_again_ns: 0,
            is_paused: false,
        };
        tape.begin_part()?;
        Ok(tape)
    }

    fn begin_part(&mut self) -> Result<(), LogError> {
        self.parts += 1;
        let mut log = (self.open)(self.parts)?;
        let add = |definition: &Definition| log.add_topic_of(&definition.topic, &definition.sample);
        let channels = self.definitions.iter().map(add).collect::<Result<_, _>>()?;
        // Schemas and channels are on the disk before the first sample is.
        log.flush()?;
        self.folder = log.path().parent().map_or_else(PathBuf::new, Path::to_owned);
        self.part = Some(Part { log, channels, pending: vec![0; self.definitions.len()] });
        Ok(())
    }

    /// Writes what a block holds; what cannot be written is counted.
    pub(crate) fn write(&mut self, block: &Block) {
        for (topic, sample) in block.iter() {
            let Some(mut header) = Header::of_sample(sample) else { continue };
            if self.definitions[topic].has_own_clock {
                header.published_ns = self.now_ns;
            }
            self.now_ns = self.now_ns.max(header.published_ns);
            self.look_after_disk();
            let Some(part) = &mut self.part else {
                self.lost[topic].fetch_add(1, Ordering::Relaxed);
                continue;
            };
            part.pending[topic] += 1;
            match part.log.write_bytes(part.channels[topic], &header, sample) {
                Ok(()) if part.log.is_flushed() => part.pending.fill(0),
                Ok(()) => {}
                Err(failure) => self.pause(format_args!("recording pauses: {failure}")),
            }
        }
    }

    /// Hands all to the operating system.
    pub(crate) fn flush(&mut self) {
        match self.part.as_mut().map(|part| (part.log.flush(), &mut part.pending)) {
            Some((Ok(()), pending)) => pending.fill(0),
            Some((Err(failure), _)) => self.pause(format_args!("recording pauses: {failure}")),
            None => {}
        }
    }

    /// Ends the last log.
    pub(crate) fn finish(mut self) -> Result<(), LogError> {
        self.end_part()
    }

    fn end_part(&mut self) -> Result<(), LogError> {
        let Some(mut part) = self.part.take() else { return Ok(()) };
        if let Err(failure) = part.log.flush() {
            self.count_lost(&part.pending);
            return Err(failure);
        }
        let mut facts = BTreeMap::from([("part".to_owned(), self.parts.to_string())]);
        for (definition, lost) in self.definitions.iter().zip(self.lost.iter()) {
            let lost = lost.load(Ordering::Relaxed);
            if lost > 0 {
                facts.insert(format!("lost {}", definition.topic), lost.to_string());
            }
        }
        part.log.metadata("fss-recorder", facts)?;
        part.log.finish()
    }

    /// Begins a new log where the old one is long enough, or where there is room again; pauses where there is none.
    fn look_after_disk(&mut self) {
        let full = |part: &Part| self.limits.rotate_bytes.is_some_and(|limit| part.log.bytes() >= limit);
        if self.part.as_ref().is_some_and(full) {
            let outcome = self.end_part().and_then(|()| self.begin_part());
            let parts = self.parts;
            match outcome {
                Ok(()) => self.say(Event::INFO, format_args!("recording goes on in part {parts}")),
                Err(failure) => self.pause(format_args!("recording pauses: {failure}")),
            }
        }
        if self.now_ns < self.look_again_ns {
            return;
        }
        self.look_again_ns = self.now_ns + RETRY_NS;
        let (is_writing, has_room) = (self.part.is_some(), self.has_room());
        if is_writing && !has_room {
            // The end of the log needs little; the room that is left is for others.
            let _ended = self.end_part();
            self.pause(format_args!("recording pauses: the disk has no room"));
        } else if !is_writing && has_room && self.begin_part().is_ok() {
            self.is_paused = false;
            let (parts, lost) = (self.parts, self.lost.iter().map(|l| l.load(Ordering::Relaxed)).sum::<u64>());
            self.say(Event::WARNING, format_args!("recording goes on in part {parts}; {lost} samples were lost"));
        }
    }

    fn has_room(&self) -> bool {
        if self.limits.keep_free_bytes == 0 {
            return true;
        }
        // A file system that cannot be asked shows by its failures.
        rustix::fs::statvfs(&self.folder).map_or(true, |fs| fs.f_bavail * fs.f_frsize >= self.limits.keep_free_bytes)
    }

    fn pause(&mut self, why: std::fmt::Arguments<'_>) {
        if let Some(part) = self.part.take() {
            self.count_lost(&part.pending);
        }
        self.look_again_ns = self.now_ns + RETRY_NS;
        if !self.is_paused {
            self.is_paused = true;
            self.say(Event::ERROR, why);
        }
    }

    fn count_lost(&self, samples: &[u64]) {
        for (lost, samples) in self.lost.iter().zip(samples) {
            lost.fetch_add(*samples, Ordering::Relaxed);
        }
    }

    fn say(&self, severity: u8, message: std::fmt::Arguments<'_>) {
        self.words.force_push(Event::new(self.now_ns, crate::NAME, severity, message));
    }
}
