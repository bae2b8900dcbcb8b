//! Making a whole log of what a broken one still holds.

use super::scan::{Damage, Visitor};
use super::{Log, LogError, LogWriter};
use mcap::Attachment;
use mcap::records::{AttachmentHeader, MessageHeader, Metadata};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// What a recovery found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recovered {
    /// Messages carried over.
    pub messages: u64,
    /// Log time of the first, ns.
    pub first_ns: u64,
    /// Log time of the last, ns.
    pub last_ns: u64,
    /// What could not be read.
    pub damage: Damage,
}

impl Log {
    /// Writes all that can be read into a new log that is whole, attachments and facts included.
    ///
    /// # Errors
    /// Where this log cannot be read or the new one not be written.
    pub fn recover_to(&self, path: &Path) -> Result<Recovered, LogError> {
        let mut log = LogWriter::create(path)?;
        let mut copy = Copy { log: &mut log, channels: BTreeMap::new(), found: None, outcome: Ok(()) };
        let damage = self.walk(&mut copy)?;
        let found = copy.found.unwrap_or_default();
        copy.outcome?;
        let recovered = Recovered { damage, ..found };
        log.metadata(
            "fss-recover",
            BTreeMap::from([
                ("from".to_owned(), self.path().display().to_string()),
                ("messages".to_owned(), recovered.messages.to_string()),
                ("damaged_places".to_owned(), damage.places.to_string()),
                ("damaged_bytes".to_owned(), damage.bytes.to_string()),
                ("cut_off_bytes".to_owned(), damage.cut_off_bytes.to_string()),
            ]),
        )?;
        log.finish()?;
        Ok(recovered)
    }
}

struct Copy<'a> {
    log: &'a mut LogWriter,
    channels: BTreeMap<u16, u16>,
    found: Option<Recovered>,
    outcome: Result<(), LogError>,
}

impl Copy<'_> {
    fn try_to(&mut self, write: impl FnOnce(&mut Self) -> Result<(), LogError>) {
        if self.outcome.is_ok() {
            self.outcome = write(self);
        }
    }
}

impl Visitor for Copy<'_> {
    fn message(&mut self, channel: &Arc<mcap::Channel<'static>>, header: &MessageHeader, data: &[u8]) {
        self.try_to(|copy| {
            let known = copy.channels.get(&channel.id).copied();
            let id = known.map_or_else(|| copy.log.add_channel_like(channel), Ok)?;
            copy.channels.insert(channel.id, id);
            copy.log.write_message(&MessageHeader { channel_id: id, ..*header }, data)?;
            let time_ns = header.log_time;
            let found =
                copy.found.get_or_insert(Recovered { first_ns: time_ns, last_ns: time_ns, ..Recovered::default() });
            found.messages += 1;
            found.first_ns = found.first_ns.min(time_ns);
            found.last_ns = found.last_ns.max(time_ns);
            Ok(())
        });
    }

    fn attachment(&mut self, header: &AttachmentHeader, data: &[u8]) {
        self.try_to(|copy| {
            copy.log.attach_record(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name.clone(),
                media_type: header.media_type.clone(),
                data: Cow::Borrowed(data),
            })
        });
    }

    fn metadata(&mut self, metadata: &Metadata) {
        self.try_to(|copy| copy.log.metadata(&metadata.name, metadata.metadata.clone()));
    }
}
