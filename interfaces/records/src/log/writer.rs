//! Writing a log.

use super::LogError;
use fss_messages::{CDR_HEADER, PACKAGE, Sample};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions, Writer};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write as _};
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

/// Writes one MCAP file.
pub struct LogWriter {
    path: PathBuf,
    mcap: Writer<BufWriter<File>>,
    chunk_start_ns: Option<u64>,
    record: Vec<u8>,
}

impl LogWriter {
    /// Begins a log; an existing file of this name is replaced.
    ///
    /// # Errors
    /// Where the file cannot be made.
    pub fn create(path: &Path) -> Result<Self, LogError> {
        let file = File::create(path).map_err(|source| LogError::File { path: path.to_owned(), source })?;
        let mcap = WriteOptions::new()
            .profile("ros2")
            .library(concat!("fss ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_level(COMPRESSION_LEVEL)
            .chunk_size(Some(CHUNK_BYTES))
            .create(BufWriter::new(file))
            .map_err(|source| LogError::Mcap { path: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), mcap, chunk_start_ns: None, record: Vec::with_capacity(4096) })
    }

    /// Adds a topic of samples `T`.
    ///
    /// # Errors
    /// Where the file refuses.
    pub fn add_topic<T: Sample>(&mut self, topic: &str) -> Result<Recorded, LogError> {
        let name = format!("{PACKAGE}/msg/{}", T::NAME);
        let schema = self
            .mcap
            .add_schema(&name, "ros2msg", T::definition().as_bytes())
            .map_err(|e| mcap_error(&self.path, e))?;
        let metadata = BTreeMap::from([("layout_hash".to_owned(), format!("{:016x}", T::HASH))]);
        let id = self.mcap.add_channel(schema, topic, "cdr", &metadata).map_err(|e| mcap_error(&self.path, e))?;
        Ok(Recorded(id))
    }

    /// Records one sample.
    ///
    /// # Errors
    /// Where the file refuses.
    pub fn write<T: Sample>(&mut self, topic: Recorded, sample: &T) -> Result<(), LogError> {
        let header = sample.header();
        self.record.clear();
        self.record.extend_from_slice(&CDR_HEADER);
        self.record.extend_from_slice(sample.as_bytes());
        let start_ns = *self.chunk_start_ns.get_or_insert(header.published_ns);
        let header = MessageHeader {
            channel_id: topic.0,
            sequence: header.sequence as u32, // the format's field is 32 bits wide; the sample holds all of it
            log_time: header.published_ns,
            publish_time: header.published_ns,
        };
        self.mcap.write_to_known_channel(&header, &self.record).map_err(|e| mcap_error(&self.path, e))?;
        if header.log_time.saturating_sub(start_ns) >= CHUNK_SPAN_NS {
            self.flush()?;
        }
        Ok(())
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
        let attachment = Attachment {
            log_time: 0,
            create_time: 0,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: Cow::Borrowed(text.as_bytes()),
        };
        self.mcap.attach(&attachment).map_err(|e| mcap_error(&self.path, e))
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
