//! What a log holds, and the samples of topics as bytes, for those who look at them in place.

use super::scan::{self, Damage, Visitor};
use super::table::definition_of;
use super::{Log, LogError};
use fss_messages::{CDR_HEADER, Definition};
use mcap::records::{AttachmentHeader, MessageHeader, Metadata};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;
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

/// Gathers blocks of samples.
struct Select<'a, F> {
    topics: &'a [String],
    log_time_ns: RangeInclusive<u64>,
    most_rows: usize,
    blocks: Vec<Option<Block>>,
    each: F,
    refused: Option<(usize, String)>,
    has_enough: bool,
}

struct Block {
    definition: Definition,
    bytes: Vec<u8>,
    rows: usize,
}

impl<F: FnMut(usize, &Definition, Vec<u8>) -> bool> Select<'_, F> {
    fn add(&mut self, topic: usize, channel: &mcap::Channel<'_>, body: &[u8]) -> Result<(), String> {
        if self.blocks[topic].is_none() {
            let definition = definition_of(channel)?;
            self.blocks[topic] = Some(Block { definition, bytes: Vec::new(), rows: 0 });
        }
        let Some(block) = &mut self.blocks[topic] else { return Ok(()) };
        let size = block.definition.size;
        let Some(sample) = body.get(..size) else {
            return Err(format!("a {} has only {} bytes", block.definition.name, body.len()));
        };
        block.bytes.extend_from_slice(sample);
        block.rows += 1;
        if block.rows == self.most_rows {
            block.rows = 0;
            let bytes = std::mem::take(&mut block.bytes);
            self.has_enough = !(self.each)(topic, &block.definition, bytes);
        }
        Ok(())
    }
}

impl<F: FnMut(usize, &Definition, Vec<u8>) -> bool> Visitor for Select<'_, F> {
    fn wants(&self, first_ns: u64, last_ns: u64) -> bool {
        first_ns <= *self.log_time_ns.end() && last_ns >= *self.log_time_ns.start()
    }

    fn has_enough(&self) -> bool {
        self.has_enough || self.refused.is_some()
    }

    fn message(&mut self, channel: &Arc<mcap::Channel<'static>>, header: &MessageHeader, data: &[u8]) {
        if self.has_enough() || !self.log_time_ns.contains(&header.log_time) {
            return;
        }
        let Some(topic) = self.topics.iter().position(|topic| *topic == channel.topic) else { return };
        let body = data.get(CDR_HEADER.len()..).unwrap_or_default();
        self.refused = self.add(topic, channel, body).err().map(|reason| (topic, reason));
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

    /// The samples of topics with a log time in a range, ns, one behind the other as they lie in the log: `each` is given the
    /// topic's place in `topics`, its definition and a block of at most `most_rows` samples, and says whether to go on.
    ///
    /// # Errors
    /// Where the file cannot be read, or a topic's schema is none of plain samples.
    pub fn select(
        &self,
        topics: &[String],
        log_time_ns: RangeInclusive<u64>,
        most_rows: usize,
        each: impl FnMut(usize, &Definition, Vec<u8>) -> bool,
    ) -> Result<Damage, LogError> {
        let blocks = topics.iter().map(|_| None).collect();
        let mut select = Select { topics, log_time_ns, most_rows, blocks, each, refused: None, has_enough: false };
        let damage = self.walk(&mut select)?;
        if let Some((topic, reason)) = select.refused {
            return Err(LogError::Schema { path: self.path().to_owned(), topic: topics[topic].clone(), reason });
        }
        for (topic, block) in select.blocks.into_iter().enumerate() {
            let Some(block) = block.filter(|block| block.rows > 0 && !select.has_enough) else { continue };
            select.has_enough = !(select.each)(topic, &block.definition, block.bytes);
        }
        Ok(damage)
    }
}
