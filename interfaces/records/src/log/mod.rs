//! Logs: one MCAP file a run, readable by the tools people already use.
//!
//! A message is [`fss_messages::CDR_HEADER`] and the sample's bytes as they lay in shared memory; its schema is the ROS 2
//! definition (`ros2msg`), its encoding `cdr`, the file's profile `ros2`. Log time and publication time are the
//! sample's `published_ns` on the monotonic clock; the metadata record `fss` ties that clock to the calendar.
//! Plant, mission and launch file are attachments.

mod contents;
mod indexed;
mod reader;
mod recover;
mod scan;
mod select;
mod selection;
mod table;
mod writer;

pub use contents::{Contents, Topic};
pub use reader::{Collect, Gap, LOG_FILE, Log, Samples, TopicInfo};
pub use recover::Recovered;
pub use scan::Damage;
pub use selection::{Layout, Selection};
pub use table::definition_of;
pub use writer::{LogWriter, Recorded, Storage};

use std::path::PathBuf;

/// Why a log could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file system refused.
    #[error("{path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file's content is not what it should be, or could not be written.
    #[error("{path}: {source}", path = path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// What the MCAP library said.
        source: mcap::McapError,
    },
    /// A table could not be written.
    #[error(transparent)]
    Table(crate::table::TableError),
    /// A topic's messages are no plain samples.
    #[error("{path}: topic {topic} cannot be read: {reason}", path = path.display())]
    Schema {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// What its schema has that no plain sample has.
        reason: String,
    },
    /// A topic holds another sample, or another version of it.
    #[error("{path}: topic {topic} does not hold this build's {sample}: {reason}", path = path.display())]
    Sample {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// The sample that was asked for.
        sample: &'static str,
        /// What differs.
        reason: String,
    },
}
