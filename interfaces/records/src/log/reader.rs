//! Reading a log, also one that was cut off or damaged.

use super::LogError;
use super::scan::{self, Damage, Scan, Visitor};
use fss_messages::{CDR_HEADER, Sample};
use mcap::records::{AttachmentHeader, MessageHeader, Metadata};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A log on disk. Each question walks through the file and holds one chunk of it in memory, so a log may be of any size.
pub struct Log {
    path: PathBuf,
}

/// What a log holds of one topic.
#[derive(Clone, Debug, PartialEq)]
pub struct TopicInfo {
    /// The topic's name.
    pub topic: String,
    /// The schema's name.
    pub schema: String,
    /// How many messages.
    pub count: u64,
    /// Log time of the first message, ns.
    pub first_ns: u64,
    /// Log time of the last message, ns.
    pub last_ns: u64,
}

impl TopicInfo {
    /// Messages a second between the first and the last; `None` with fewer than two.
    pub fn rate_hz(&self) -> Option<f64> {
        let span_s = (self.last_ns - self.first_ns) as f64 * 1e-9;
        (self.count > 1 && span_s > 0.0).then(|| (self.count - 1) as f64 / span_s)
    }
}

/// Samples that are missing from a topic, by the sequence of its publisher.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gap {
    /// Last sequence before the gap.
    pub after: u64,
    /// First sequence behind it; smaller than `after` where the publisher was restarted.
    pub before: u64,
}

/// Something that takes the messages of one topic.
pub trait Collect {
    /// The topic.
    fn topic(&self) -> &str;
    /// Takes one message; refuses it with the sample's name and what is wrong.
    ///
    /// # Errors
    /// Where the message is not what the topic should hold.
    fn take(&mut self, channel: &mcap::Channel<'_>, body: &[u8]) -> Result<(), (&'static str, String)>;
}

/// The samples of one topic.
pub struct Samples<T> {
    topic: String,
    /// In the order of the log.
    pub samples: Vec<T>,
}

impl<T: Sample> Samples<T> {
    /// None yet.
    pub fn of(topic: &str) -> Self {
        Self { topic: topic.to_owned(), samples: Vec::new() }
    }
}

impl<T: Sample> Collect for Samples<T> {
    fn topic(&self) -> &str {
        &self.topic
    }

    fn take(&mut self, channel: &mcap::Channel<'_>, body: &[u8]) -> Result<(), (&'static str, String)> {
        // One hash a message would be waste: it is the channel's, so the first message decides.
        let hash_is_ours = || channel.metadata.get("layout_hash").is_none_or(|h| *h == format!("{:016x}", T::HASH));
        match T::read_from_bytes(body) {
            Ok(sample) if !self.samples.is_empty() || hash_is_ours() => {
                self.samples.push(sample);
                Ok(())
            }
            _ => {
                let found = channel.schema.as_ref().map_or("no schema", |schema| schema.name.as_str());
                Err((T::NAME, format!("it holds {} bytes of {found}", body.len())))
            }
        }
    }
}

/// The log in a run's folder.
pub const LOG_FILE: &str = "run.mcap";

impl Log {
    /// Opens a log, or that of a run's folder.
    ///
    /// # Errors
    /// Where the file cannot be read or is no MCAP file.
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let path = if path.is_dir() { path.join(LOG_FILE) } else { path.to_owned() };
        let log = Self { path };
        if scan::has_magic(&log.path).map_err(|e| log.file_error(e))? {
            Ok(log)
        } else {
            Err(LogError::Mcap { path: log.path, source: mcap::McapError::BadMagic })
        }
    }

    /// The log's own path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the log was ended properly; if not, its end was cut off when its recorder died.
    pub fn is_complete(&self) -> bool {
        scan::summary(&self.path).is_ok_and(|summary| summary.is_some())
    }

    /// Every message that the file holds whole, in its order: channel, log time in ns, sample's bytes. Says what was
    /// unreadable.
    ///
    /// # Errors
    /// Where the file cannot be read.
    pub fn for_each(&self, visit: impl FnMut(&Arc<mcap::Channel<'static>>, u64, &[u8])) -> Result<Damage, LogError> {
        self.walk(&mut EachMessage(visit))
    }

    pub(super) fn walk<V: Visitor>(&self, visitor: &mut V) -> Result<Damage, LogError> {
        Scan::open(&self.path).and_then(|scan| scan.run(visitor)).map_err(|e| self.file_error(e))
    }

    /// All samples of a topic.
    ///
    /// # Errors
    /// Where the topic holds another sample or another version of it.
    pub fn samples<T: Sample>(&self, topic: &str) -> Result<Vec<T>, LogError> {
        let mut samples = Samples::of(topic);
        self.collect(&mut [&mut samples])?;
        Ok(samples.samples)
    }

    /// The samples of several topics in one pass over the log.
    ///
    /// # Errors
    /// Where a topic holds another sample or another version of it.
    pub fn collect(&self, topics: &mut [&mut dyn Collect]) -> Result<(), LogError> {
        let mut refused = None;
        self.for_each(|channel, _, body| {
            for topic in topics.iter_mut().filter(|t| t.topic() == channel.topic) {
                if let Err((sample, reason)) = topic.take(channel, body) {
                    refused = Some((topic.topic().to_owned(), sample, reason));
                }
            }
        })?;
        match refused {
            Some((topic, sample, reason)) => Err(LogError::Sample { path: self.path.clone(), topic, sample, reason }),
            None => Ok(()),
        }
    }

    /// What the log holds, topic by topic.
    ///
    /// # Errors
    /// Where the file cannot be read.
    pub fn topics(&self) -> Result<Vec<TopicInfo>, LogError> {
        self.survey().map(|(topics, _)| topics)
    }

    /// What the log holds, topic by topic, and what of it cannot be read.
    ///
    /// # Errors
    /// Where the file cannot be read.
    pub fn survey(&self) -> Result<(Vec<TopicInfo>, Damage), LogError> {
        let mut topics = BTreeMap::<String, TopicInfo>::new();
        let damage = self.for_each(|channel, log_time, _| {
            if !topics.contains_key(&channel.topic) {
                let schema = channel.schema.as_ref().map_or(String::new(), |schema| schema.name.clone());
                let (topic, count) = (channel.topic.clone(), 0);
                let new = TopicInfo { topic, schema, count, first_ns: log_time, last_ns: log_time };
                topics.insert(channel.topic.clone(), new);
            }
            let Some(topic) = topics.get_mut(&channel.topic) else { return };
            topic.count += 1;
            topic.first_ns = topic.first_ns.min(log_time);
            topic.last_ns = topic.last_ns.max(log_time);
        })?;
        Ok((topics.into_values().collect(), damage))
    }

    /// The attachment of this name, as text.
    ///
    /// # Errors
    /// Where the file cannot be read.
    pub fn attachment(&self, name: &str) -> Result<Option<String>, LogError> {
        let mut wanted = Wanted { name, attachment: None, metadata: None };
        self.walk(&mut wanted)?;
        Ok(wanted.attachment)
    }

    /// The facts recorded under this name; the last of several.
    ///
    /// # Errors
    /// Where the file cannot be read.
    pub fn metadata(&self, name: &str) -> Result<Option<BTreeMap<String, String>>, LogError> {
        let mut wanted = Wanted { name, attachment: None, metadata: None };
        self.walk(&mut wanted)?;
        Ok(wanted.metadata)
    }

    /// Gaps in the sequence of a topic that has one publisher.
    ///
    /// # Errors
    /// Where the topic holds another sample or another version of it.
    pub fn gaps<T: Sample>(&self, topic: &str) -> Result<Vec<Gap>, LogError> {
        let samples = self.samples::<T>(topic)?;
        let sequence = |sample: &T| sample.header().sequence;
        Ok(samples
            .windows(2)
            .map(|pair| Gap { after: sequence(&pair[0]), before: sequence(&pair[1]) })
            .filter(|gap| gap.before != gap.after + 1)
            .collect())
    }

    pub(super) fn file_error(&self, source: std::io::Error) -> LogError {
        LogError::File { path: self.path.clone(), source }
    }
}

struct EachMessage<F>(F);

impl<F: FnMut(&Arc<mcap::Channel<'static>>, u64, &[u8])> Visitor for EachMessage<F> {
    fn message(&mut self, channel: &Arc<mcap::Channel<'static>>, header: &MessageHeader, data: &[u8]) {
        (self.0)(channel, header.log_time, data.get(CDR_HEADER.len()..).unwrap_or_default());
    }
}

/// Looks for what stands outside the chunks.
struct Wanted<'a> {
    name: &'a str,
    attachment: Option<String>,
    metadata: Option<BTreeMap<String, String>>,
}

impl Visitor for Wanted<'_> {
    const MESSAGES: bool = false;

    fn attachment(&mut self, header: &AttachmentHeader, data: &[u8]) {
        if header.name == self.name {
            self.attachment = Some(String::from_utf8_lossy(data).into_owned());
        }
    }

    fn metadata(&mut self, metadata: &Metadata) {
        if metadata.name == self.name {
            self.metadata = Some(metadata.metadata.clone());
        }
    }
}
