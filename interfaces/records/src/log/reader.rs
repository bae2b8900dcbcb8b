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
        let hash = format!("{:016x}", T::HASH);
        let mut samples = Vec::new();
        let mut refused = None;
        self.for_each(|channel, _, body| {
            if channel.topic != topic {
                return;
            }
            let same_layout = channel.metadata.get("layout_hash").is_none_or(|h| *h == hash);
            match T::read_from_bytes(body) {
                Ok(sample) if same_layout => samples.push(sample),
                _ => {
                    let found = channel.schema.as_ref().map_or("no schema", |schema| schema.name.as_str());
                    refused = Some(format!("it holds {} bytes of {found}", body.len()));
                }
            }
        })?;
        match refused {
            Some(reason) => {
                Err(LogError::Sample { path: self.path.clone(), topic: topic.to_owned(), sample: T::NAME, reason })
            }
            None => Ok(samples),
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
