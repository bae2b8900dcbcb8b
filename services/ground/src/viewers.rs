//! The viewers (`foxglove.sdk.v1`), and what they share.

use crate::channels::{Channel, Channels};
use crate::config::GroundConfig;
use crate::frame;
use crate::outbox::Put;
use crate::uplink::{Desk, Told};
use crate::viewer::{Viewer, lock};
use crossbeam_queue::ArrayQueue;
use fss_bus::Queue;
use fss_messages::Event;
use serde_json::json;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, UNIX_EPOCH};

/// Words about viewers that wait to be said.
const WORDS: usize = 64;
/// Refusals are told no more often, whatever a page tries.
const BETWEEN_WORDS: Duration = Duration::from_secs(10);

/// All viewers.
pub(crate) struct Viewers {
    /// Pages that may come in beside this computer's own.
    pub(crate) origins: Vec<String>,
    pub(crate) channels: Channels,
    pub(crate) desk: Arc<Desk>,
    /// The name of the source.
    name: String,
    present: Mutex<Vec<Arc<Viewer>>>,
    /// Samples that slow viewers have lost and that are not told yet.
    lost: AtomicU64,
    words: Queue<(u8, String)>,
    last_word: Mutex<Option<Instant>>,
    /// What `GET /metrics` answers.
    metrics: Mutex<String>,
}

impl Viewers {
    pub(crate) fn new(config: &GroundConfig, channels: Channels, desk: Arc<Desk>) -> Self {
        Self {
            origins: config.origins.clone(),
            channels,
            desk,
            name: config.name.clone(),
            present: Mutex::default(),
            lost: AtomicU64::new(0),
            words: Arc::new(ArrayQueue::new(WORDS)),
            last_word: Mutex::default(),
            metrics: Mutex::default(),
        }
    }

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
        lock(&self.present).push(viewer.clone());
        self.say(Event::INFO, "a viewer has come".to_owned());
    }

    /// Forgets one that has gone.
    pub(crate) fn part(&self, viewer: &Arc<Viewer>) {
        lock(&self.present).retain(|other| !Arc::ptr_eq(other, viewer));
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

    /// What is answered from now on to those who ask for metrics.
    pub(crate) fn set_metrics(&self, text: String) {
        *lock(&self.metrics) = text;
    }

    /// How many samples slow viewers have lost since this was asked last.
    pub(crate) fn lost(&self) -> u64 {
        self.lost.swap(0, Ordering::Relaxed)
    }

    /// What is to be said of viewers, one after another, and how grave it is.
    pub(crate) fn next_words(&self) -> Option<(u8, String)> {
        self.words.pop()
    }

    /// Whether any viewer wants this channel.
    pub(crate) fn is_wanted(&self, channel: Channel) -> bool {
        lock(&self.present).iter().any(|viewer| viewer.wants(channel).is_some())
    }

    /// Sends a message to those who want it. Its time is that of publication, as in the log, on the monotonic clock.
    pub(crate) fn send(&self, channel: Channel, time_ns: u64, message: &[u8]) {
        for viewer in lock(&self.present).iter() {
            if viewer.give(channel, time_ns, message) == Put::Dropped {
                self.lost.fetch_add(1, Ordering::Relaxed);
                if let Some(words) = viewer.count_dropped() {
                    self.say(Event::WARNING, words);
                }
            }
        }
    }

    /// Tells those who asked for it of parameters that have changed.
    pub(crate) fn tell(&self, changed: &[Told]) {
        lock(&self.present).iter().for_each(|viewer| viewer.tell(changed));
    }

    /// Says goodbye to all.
    pub(crate) fn dismiss(&self) {
        lock(&self.present).iter().for_each(|viewer| viewer.dismiss());
    }
}
