//! Reading a log, also one that was cut off.

use super::LogError;
use fss_messages::{CDR_HEADER, Sample};
use mcap::MessageStream;
use mcap::read::Options;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A log in memory.
pub struct Log {
    path: PathBuf,
    bytes: Vec<u8>,
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

impl Log {
    /// Reads a log's bytes.
    ///
    /// # Errors
    /// Where the file cannot be read or is no MCAP file.
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let bytes = std::fs::read(path).map_err(|source| LogError::File { path: path.to_owned(), source })?;
        let log = Self { path: path.to_owned(), bytes };
        log.messages()?;
        Ok(log)
    }

    /// The log's own path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the log was ended properly; if not, its end was cut off when its recorder died.
    pub fn is_complete(&self) -> bool {
        mcap::read::footer(&self.bytes).is_ok()
    }

    fn messages(&self) -> Result<MessageStream<'_>, LogError> {
        MessageStream::new_with_options(&self.bytes, Options::IgnoreEndMagic.into()).map_err(|e| self.error(e))
    }

    /// Every message in the order of the file, up to where the file is whole: topic, log time in ns, sample's bytes.
    ///
    /// # Errors
    /// Where the file is no MCAP file.
    pub fn for_each(&self, mut visit: impl FnMut(&Arc<mcap::Channel<'_>>, u64, &[u8])) -> Result<(), LogError> {
        for message in self.messages()? {
            let Ok(message) = message else { break }; // cut off here
            let body = message.data.get(CDR_HEADER.len()..).unwrap_or_default();
            visit(&message.channel, message.log_time, body);
        }
        Ok(())
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
    /// Where the file is no MCAP file.
    pub fn topics(&self) -> Result<Vec<TopicInfo>, LogError> {
        let mut topics = BTreeMap::<String, TopicInfo>::new();
        self.for_each(|channel, log_time, _| {
            let schema = channel.schema.as_ref().map_or(String::new(), |schema| schema.name.clone());
            let topic = topics.entry(channel.topic.clone()).or_insert_with(|| TopicInfo {
                topic: channel.topic.clone(),
                schema,
                count: 0,
                first_ns: log_time,
                last_ns: log_time,
            });
            topic.count += 1;
            topic.first_ns = topic.first_ns.min(log_time);
            topic.last_ns = topic.last_ns.max(log_time);
        })?;
        Ok(topics.into_values().collect())
    }

    /// The attachment of this name, as text.
    ///
    /// # Errors
    /// Where the log is cut off or has none of this name.
    pub fn attachment(&self, name: &str) -> Result<Option<String>, LogError> {
        let Some(summary) = mcap::Summary::read(&self.bytes).map_err(|e| self.error(e))? else { return Ok(None) };
        let Some(index) = summary.attachment_indexes.iter().find(|index| index.name == name) else { return Ok(None) };
        let attachment = mcap::read::attachment(&self.bytes, index).map_err(|e| self.error(e))?;
        Ok(Some(String::from_utf8_lossy(&attachment.data).into_owned()))
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

    fn error(&self, source: mcap::McapError) -> LogError {
        LogError::Mcap { path: self.path.clone(), source }
    }
}
