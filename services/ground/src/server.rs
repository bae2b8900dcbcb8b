//! The server of the Foxglove WebSocket protocol (`foxglove.sdk.v1`): viewers, and what they share.

use crate::channels::{Channel, Channels};
use crate::frame;
use crate::gate::Gate;
use crate::uplink::{Desk, Told};
use crate::viewer::{FAREWELL, Viewer};
use crossbeam::queue::ArrayQueue;
use fss_bus::Queue;
use fss_messages::Event;
use serde_json::json;
use std::io;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, UNIX_EPOCH};

/// Words about viewers that wait to be said.
const WORDS: usize = 64;
/// Refusals are told no more often, whatever a page tries.
const BETWEEN_WORDS: Duration = Duration::from_secs(10);

/// Where to listen, and as what.
#[derive(Clone, Debug)]
pub struct GroundConfig {
    /// The address.
    pub listen: SocketAddr,
    /// What viewers show as the name of the source.
    pub name: String,
    /// Whether viewers may tune and command; only where `listen` is on the loopback, for the protocol knows no key.
    pub commands: bool,
    /// Origins of the pages that a browser may show it to, beside pages of the viewer's own computer.
    pub origins: Vec<String>,
}

/// Why there is no view.
#[derive(Debug, thiserror::Error)]
pub enum GroundError {
    /// The address is taken, or is not this computer's.
    #[error("cannot listen at {address}: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        source: io::Error,
    },
    /// Whoever reaches the address could command.
    #[error("commands are taken from this computer alone, and {0} is reached from others")]
    Exposed(SocketAddr),
}

/// What viewers share.
pub(crate) struct Shared {
    /// Pages that may come in beside this computer's own.
    pub(crate) origins: Vec<String>,
    pub(crate) channels: Channels,
    pub(crate) desk: Arc<Desk>,
    /// The name of the source.
    name: String,
    viewers: Mutex<Vec<Arc<Viewer>>>,
    /// Samples that slow viewers have lost and that are not told yet.
    lost: AtomicU64,
    words: Queue<(u8, String)>,
    last_word: Mutex<Option<Instant>>,
    /// What `GET /metrics` answers.
    metrics: Mutex<String>,
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// Tells a viewer what there is, and counts it among those who are served.
    pub(crate) fn greet(&self, viewer: &Arc<Viewer>) {
        let session = UNIX_EPOCH.elapsed().map_or(0, |since| since.as_millis()).to_string();
        let services = self.desk.services();
        let mut capabilities = vec!["parameters", "parametersSubscribe"];
        let mut encodings = Vec::new();
        if !services.is_empty() {
            capabilities.push("services");
            encodings.push("json");
        }
        viewer.say(frame::text(&json!({
            "op": "serverInfo", "name": self.name, "capabilities": capabilities,
            "supportedEncodings": encodings, "sessionId": session,
        })));
        viewer.say(self.channels.announcement());
        if !services.is_empty() {
            viewer.say(frame::text(&json!({ "op": "advertiseServices", "services": services })));
        }
        lock(&self.viewers).push(viewer.clone());
        self.say(Event::INFO, "a viewer has come".to_owned());
    }

    /// Forgets one that has gone.
    pub(crate) fn part(&self, viewer: &Arc<Viewer>) {
        lock(&self.viewers).retain(|other| !Arc::ptr_eq(other, viewer));
        self.say(Event::INFO, "a viewer has gone".to_owned());
    }

    pub(crate) fn say(&self, severity: u8, words: String) {
        self.words.force_push((severity, words));
    }

    pub(crate) fn say_rarely(&self, severity: u8, words: String) {
        let mut last = lock(&self.last_word);
        if last.is_none_or(|last| last.elapsed() >= BETWEEN_WORDS) {
            *last = Some(Instant::now());
            self.say(severity, words);
        }
    }

    pub(crate) fn metrics(&self) -> String {
        lock(&self.metrics).clone()
    }

    pub(crate) fn count_lost(&self) {
        self.lost.fetch_add(1, Ordering::Relaxed);
    }
}

/// The server.
pub(crate) struct Server {
    gate: Gate,
    shared: Arc<Shared>,
}

impl Server {
    pub(crate) fn start(config: &GroundConfig, channels: Channels, desk: Arc<Desk>) -> Result<Self, GroundError> {
        if config.commands && !config.listen.ip().is_loopback() {
            return Err(GroundError::Exposed(config.listen));
        }
        let shared = Arc::new(Shared {
            origins: config.origins.clone(),
            channels,
            desk,
            name: config.name.clone(),
            viewers: Mutex::default(),
            lost: AtomicU64::new(0),
            words: Arc::new(ArrayQueue::new(WORDS)),
            last_word: Mutex::default(),
            metrics: Mutex::default(),
        });
        let gate = Gate::open(config.listen, shared.clone())
            .map_err(|source| GroundError::Listen { address: config.listen, source })?;
        Ok(Self { gate, shared })
    }

    pub(crate) fn port(&self) -> u16 {
        self.gate.port()
    }

    /// What is answered from now on to those who ask for metrics.
    pub(crate) fn set_metrics(&self, text: String) {
        *lock(&self.shared.metrics) = text;
    }

    /// How many samples slow viewers have lost since this was asked last.
    pub(crate) fn lost(&self) -> u64 {
        self.shared.lost.swap(0, Ordering::Relaxed)
    }

    /// What is to be said of viewers, one after another, and how grave it is.
    pub(crate) fn next_words(&self) -> Option<(u8, String)> {
        self.shared.words.pop()
    }

    /// Whether any viewer wants this channel.
    pub(crate) fn is_wanted(&self, channel: Channel) -> bool {
        lock(&self.shared.viewers).iter().any(|viewer| viewer.wants(channel).is_some())
    }

    /// Sends a message to those who want it. Its time is that of publication, as in the log, on the monotonic clock.
    pub(crate) fn send(&self, channel: Channel, time_ns: u64, message: &[u8]) {
        lock(&self.shared.viewers).iter().for_each(|viewer| viewer.give(channel, time_ns, message, &self.shared));
    }

    /// Tells those who asked for it of parameters that have changed.
    pub(crate) fn tell(&self, changed: &[Told]) {
        lock(&self.shared.viewers).iter().for_each(|viewer| viewer.tell(changed));
    }

    pub(crate) fn stop(self) {
        lock(&self.shared.viewers).iter().for_each(|viewer| viewer.dismiss());
        self.gate.wait(FAREWELL);
    }
}
