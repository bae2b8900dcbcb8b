//! One viewer: what it wants, and what waits for it in its [`Outbox`].

use crate::channels::Channel;
use crate::frame;
use crate::outbox::{Outbox, Put};
use crate::uplink::Told;
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A slow viewer is told of no more often.
const BETWEEN_COMPLAINTS: Duration = Duration::from_secs(30);
/// For the last words to a viewer.
pub(crate) const FAREWELL: Duration = Duration::from_millis(500);

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A viewer.
pub(crate) struct Viewer {
    address: SocketAddr,
    pub(crate) stream: TcpStream,
    outbox: Outbox,
    /// Its own numbers of the channels that it wants.
    pub(crate) subscriptions: Mutex<BTreeMap<u64, u32>>,
    /// The parameters of which it wants to be told.
    pub(crate) parameters: Mutex<BTreeSet<&'static str>>,
    missed: Mutex<Missed>,
}

/// Samples that it was too slow for.
#[derive(Default)]
struct Missed {
    count: u64,
    told: Option<Instant>,
}

impl Viewer {
    pub(crate) fn new(stream: TcpStream) -> io::Result<Self> {
        Ok(Self {
            address: stream.peer_addr()?,
            stream,
            outbox: Outbox::default(),
            subscriptions: Mutex::default(),
            parameters: Mutex::default(),
            missed: Mutex::default(),
        })
    }

    /// Writes what waits, until there is no more to come or it goes.
    pub(crate) fn write(&self) {
        while self.outbox.take().is_some_and(|frame| (&self.stream).write_all(&frame).is_ok()) {}
        self.outbox.leave();
        let _ = self.stream.shutdown(Shutdown::Read);
    }

    /// Ends the connection once what waits is written, or after a while.
    pub(crate) fn close(&self) {
        self.outbox.close(FAREWELL);
        // Where the viewer does not read, this ends the wait for it.
        let _ = self.stream.shutdown(Shutdown::Both);
    }

    /// What is to be said of one that missed anything, when it has gone.
    pub(crate) fn losses(&self) -> Option<String> {
        let missed = lock(&self.missed).count;
        (missed > 0)
            .then(|| format!("the slow viewer at {} has gone: {missed} of its messages were dropped", self.address))
    }

    /// Says this; one that lets too much of it wait is left.
    pub(crate) fn say(&self, frame: Vec<u8>) {
        if self.outbox.put_words(frame) == Put::Closed {
            let _ = self.stream.shutdown(Shutdown::Read);
        }
    }

    pub(crate) fn status(&self, level: u8, message: &str) {
        self.say(frame::text(&json!({ "op": "status", "level": level, "message": message })));
    }

    pub(crate) fn wants(&self, channel: Channel) -> Option<u32> {
        lock(&self.subscriptions).get(&channel.0).copied()
    }

    /// Gives it a sample where it wants the channel.
    pub(crate) fn give(&self, channel: Channel, time_ns: u64, message: &[u8]) -> Put {
        let Some(subscription) = self.wants(channel) else { return Put::Waits };
        self.outbox.put_sample(frame::sample(subscription, time_ns, message))
    }

    /// Counts a message that was dropped; now and then what is to be said of that.
    pub(crate) fn count_dropped(&self) -> Option<String> {
        let mut missed = lock(&self.missed);
        missed.count += 1;
        missed.told.is_none_or(|last| last.elapsed() >= BETWEEN_COMPLAINTS).then(|| {
            missed.told = Some(Instant::now());
            format!("the viewer at {} reads too slowly: {} of its messages dropped", self.address, missed.count)
        })
    }

    /// Tells it of those parameters that it wants to hear of.
    pub(crate) fn tell(&self, changed: &[Told]) {
        let wanted = lock(&self.parameters);
        let changed: Vec<_> = changed.iter().filter(|told| wanted.contains(told.name)).collect();
        if !changed.is_empty() {
            self.say(frame::text(&json!({ "op": "parameterValues", "parameters": changed })));
        }
    }

    /// Ends the connection, with a goodbye.
    pub(crate) fn dismiss(&self) {
        self.say(frame::close());
        let _ = self.stream.shutdown(Shutdown::Read);
    }
}
