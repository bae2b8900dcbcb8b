//! Writing a log.

use super::LogError;
use fss_messages::{CDR_HEADER, Definition, Header, Sample};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions, Writer};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

/// A chunk is closed at the latest when its samples span this much time, so that a killed recorder loses less than it.
const CHUNK_SPAN_NS: u64 = 500_000_000;
/// A chunk is closed at the latest when it holds this much.
const CHUNK_BYTES: u64 = 1 << 20;
/// Fast compression: the recorder must keep up on a computer that flies.
const COMPRESSION_LEVEL: u32 = 1;

/// A topic that a [`LogWriter`] records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recorded(u16);

/// Where a log's bytes go: a file, or what a test puts in its place.
pub trait Storage: Write + Seek + Send {}

impl<T: Write + Seek + Send> Storage for T {}

/// Writes one MCAP file, always at its end: a writer that was killed leaves whole chunks and a part of one.
pub struct LogWriter {
    path: PathBuf,
    mcap: Writer<BufWriter<Box<dyn Storage>>>,
    chunk_start_ns: Option<u64>,
    record: Vec<u8>,
    bytes: u64,
}

impl LogWriter {
    /// Begins a log; an existing file of this name is replaced.
    ///
    /// # Errors
    /// Where the file cannot be made.
    pub fn create(path: &Path) -> Result<Self, LogError> {
        let file = File::create(path).map_err(|source| LogError::File { path: path.to_owned(), source })?;
        Self::to(path, Box::new(file))
    }

    /// Begins a log on a storage that is known by the name `path`.
    ///
    /// # Errors
    /// Where the storage refuses.
    pub fn to(path: &Path, storage: Box<dyn Storage>) -> Result<Self, LogError> {
        let mcap = WriteOptions::new()
            .profile("ros2")
            .library(concat!("fss ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_level(COMPRESSION_LEVEL)
            // Helper threads, which the library would start anew for each chunk, cost more than they help.
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .create(BufWriter::new(storage))
            .map_err(|source| LogError::Mcap { path: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), mcap, chunk_start_ns: None, record: Vec::with_capacity(4096), bytes: 0 })
    }

    /// Adds a topic of samples `T`.
    ///
    /// # Errors
    /// Where the file refuses.
    pub fn add_topic<T: Sample>(&mut self, topic: &str) -> Result<Recorded, LogError> {
        self.add_topic_of(topic, &Definition::of::<T>())
    }

    /// Adds a topic of samples that are known by their definition.
    ///
    /// # Errors
    /// Where the file refuses.
    pub fn add_topic_of(&mut self, topic: &str, definition: &Definition) -> Result<Recorded, LogError> {
        let schema = self
            .mcap
            .add_schema(&definition.schema(), "ros2msg", definition.text.as_bytes())
            .map_err(|e| mcap_error(&self.path, e))?;
        let metadata = BTreeMap::from([("layout_hash".to_owned(), format!("{:016x}", definition.hash))]);
        let id = self.mcap.add_channel(schema, topic, "cdr", &metadata).map_err(|e| mcap_error(&self.path, e))?;
        Ok(Recorded(id))
    }

    /// Adds a channel that is the same as that of another log.
    pub(super) fn add_channel_like(&mut self, channel: &mcap::Channel<'_>) -> Result<u16, LogError> {
        let schema = match &channel.schema {
            Some(s) => self.mcap.add_schema(&s.name, &s.encoding, &s.data).map_err(|e| mcap_error(&self.path, e))?,
            None => 0,
        };
        self.mcap
            .add_channel(schema, &channel.topic, &channel.message_encoding, &channel.metadata)
            .map_err(|e| mcap_error(&self.path, e))
    }

    /// Records one sample.
    ///
    /// # Errors
    /// Where the file refuses.
    pub fn write<T: Sample>(&mut self, topic: Recorded, sample: &T) -> Result<(), LogError> {
        self.write_bytes(topic, &sample.header(), sample.as_bytes())
    }

    /// Records the bytes of a sample with this header.
    ///
    /// # Errors
    /// Where the file refuses.
    pub fn write_bytes(&mut self, topic: Recorded, header: &Header, sample: &[u8]) -> Result<(), LogError> {
        let mut record = std::mem::take(&mut self.record);
        record.clear();
        record.extend_from_slice(&CDR_HEADER);
        record.extend_from_slice(sample);
        let header = MessageHeader {
            channel_id: topic.0,
            sequence: header.sequence as u32, // the format's field is 32 bits wide; the sample holds all of it
            log_time: header.published_ns,
            publish_time: header.published_ns,
        };
        let written = self.write_message(&header, &record);
        self.record = record;
        written
    }

    pub(super) fn write_message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), LogError> {
        let start_ns = *self.chunk_start_ns.get_or_insert(header.log_time);
        self.mcap.write_to_known_channel(header, data).map_err(|e| mcap_error(&self.path, e))?;
        self.bytes += data.len() as u64;
        if header.log_time.saturating_sub(start_ns) >= CHUNK_SPAN_NS {
            self.flush()?;
        }
        Ok(())
    }

    /// Bytes of samples written so far, before compression.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The file's name.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether all that was written has been handed to the operating system.
    pub fn is_flushed(&self) -> bool {
        self.chunk_start_ns.is_none()
    }

    /// Closes the chunk and hands everything to the operating system.
    ///
    /// # Errors
    /// Where the file refuses.
    pub fn flush(&mut self) -> Result<(), LogError> {
        self.chunk_start_ns = None;
        self.mcap.flush().map_err(|e| mcap_error(&self.path, e))
    }

    /// Attaches a file's text.
    ///
    /// # Errors
    /// Where the file refuses.
    pub fn attach(&mut self, name: &str, media_type: &str, text: &str) -> Result<(), LogError> {
        self.attach_record(&Attachment {
            log_time: 0,
            create_time: 0,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: Cow::Borrowed(text.as_bytes()),
        })
    }

    pub(super) fn attach_record(&mut self, attachment: &Attachment<'_>) -> Result<(), LogError> {
        self.mcap.attach(attachment).map_err(|e| mcap_error(&self.path, e))
    }

    /// Adds facts about the run under a name.
    ///
    /// # Errors
    /// Where the file refuses.
    pub fn metadata(&mut self, name: &str, facts: BTreeMap<String, String>) -> Result<(), LogError> {
        let metadata = Metadata { name: name.to_owned(), metadata: facts };
        self.mcap.write_metadata(&metadata).map_err(|e| mcap_error(&self.path, e))
    }

    /// Ends the log with its summary.
    ///
    /// # Errors
    /// Where the file refuses.
    pub fn finish(mut self) -> Result<(), LogError> {
        self.mcap.finish().map_err(|e| mcap_error(&self.path, e))?;
        let path = self.path;
        self.mcap.into_inner().flush().map_err(|source| LogError::File { path, source })
    }
}

fn mcap_error(path: &Path, source: mcap::McapError) -> LogError {
    LogError::Mcap { path: path.to_owned(), source }
}
