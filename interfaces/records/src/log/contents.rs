//! What a log holds.

use super::scan::{self, Damage, Visitor};
use super::{Log, LogError};
use mcap::records::{AttachmentHeader, MessageHeader, Metadata};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What a log holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Contents {
    /// Topics by name.
    pub topics: BTreeMap<String, Topic>,
    /// Log time of the first message, ns.
    pub first_ns: u64,
    /// Log time of the last message, ns.
    pub last_ns: u64,
    /// Attached files by name.
    pub attachments: BTreeMap<String, Vec<u8>>,
    /// Facts by the name they were recorded under.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// Whether the log was ended properly.
    pub is_complete: bool,
    /// What could not be read; of a log that was ended properly only what stands outside its chunks.
    pub damage: Damage,
}

/// A topic of a log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Topic {
    /// The schema's name.
    pub schema: String,
    /// The message's definition.
    pub definition: String,
    /// How many messages.
    pub count: u64,
}

impl Contents {
    fn topic(&mut self, channel: &mcap::Channel<'_>) -> &mut Topic {
        self.topics.entry(channel.topic.clone()).or_insert_with(|| match &channel.schema {
            Some(s) => {
                Topic { schema: s.name.clone(), definition: String::from_utf8_lossy(&s.data).into_owned(), count: 0 }
            }
            None => Topic::default(),
        })
    }
}

/// Collects what stands outside the chunks and, where `MESSAGES` says so, counts what is in them.
struct Survey<const MESSAGES: bool>(Contents);

impl<const MESSAGES: bool> Visitor for Survey<MESSAGES> {
    const MESSAGES: bool = MESSAGES;

    fn message(&mut self, channel: &Arc<mcap::Channel<'static>>, header: &MessageHeader, _: &[u8]) {
        let contents = &mut self.0;
        let is_first = contents.topics.is_empty();
        contents.first_ns = if is_first { header.log_time } else { contents.first_ns.min(header.log_time) };
        contents.last_ns = contents.last_ns.max(header.log_time);
        contents.topic(channel).count += 1;
    }

    fn attachment(&mut self, header: &AttachmentHeader, data: &[u8]) {
        self.0.attachments.insert(header.name.clone(), data.to_vec());
    }

    fn metadata(&mut self, metadata: &Metadata) {
        self.0.metadata.insert(metadata.name.clone(), metadata.metadata.clone());
    }
}

impl Log {
    /// What the log holds. A log that was ended properly tells it at its end; another is walked through.
    ///
    /// # Errors
    /// Where the file cannot be read.
    pub fn contents(&self) -> Result<Contents, LogError> {
        let summary = scan::summary(self.path()).map_err(|e| self.file_error(e))?;
        let Some((summary, stats)) = summary.and_then(|mut s| s.stats.take().map(|stats| (s, stats))) else {
            let mut survey = Survey::<true>(Contents::default());
            let damage = self.walk(&mut survey)?;
            return Ok(Contents { damage, ..survey.0 });
        };
        let mut survey = Survey::<false>(Contents::default());
        let damage = self.walk(&mut survey)?;
        let mut contents = survey.0;
        for (id, channel) in &summary.channels {
            contents.topic(channel).count += stats.channel_message_counts.get(id).copied().unwrap_or(0);
        }
        contents.topics.retain(|_, topic| topic.count > 0);
        let (first_ns, last_ns) = (stats.message_start_time, stats.message_end_time);
        Ok(Contents { first_ns, last_ns, is_complete: true, damage, ..contents })
    }
}
