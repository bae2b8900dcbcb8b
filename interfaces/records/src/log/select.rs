//! The samples of topics as bytes, for those who look at them in place.

use super::indexed::{Indexed, Trouble};
use super::scan::{self, Damage, Visitor};
use super::selection::{Layout, Selection, overlap};
use super::{Log, LogError};
use mcap::records::MessageHeader;
use std::sync::Arc;

/// Samples that were gathered of each topic, until there are enough of them for a block.
struct Gathering<F> {
    most_rows: usize,
    blocks: Vec<Option<(Layout, Vec<u8>)>>,
    each: F,
    has_enough: bool,
}

impl<F: FnMut(usize, &Layout, Vec<u8>) -> bool> Gathering<F> {
    /// Gives what is more than a block holds.
    fn give_full(&mut self, topic: usize) {
        let Some((layout, bytes)) = &mut self.blocks[topic] else { return };
        let full = layout.size.max(1).saturating_mul(self.most_rows);
        while bytes.len() >= full && !self.has_enough {
            let rest = bytes.split_off(full);
            self.has_enough = !(self.each)(topic, layout, std::mem::replace(bytes, rest));
        }
    }

    fn give_rest(mut self) {
        for (topic, block) in self.blocks.into_iter().enumerate() {
            let Some((layout, bytes)) = block.filter(|(_, bytes)| !bytes.is_empty() && !self.has_enough) else {
                continue;
            };
            self.has_enough = !(self.each)(topic, &layout, bytes);
        }
    }
}

/// Selects on a walk through the log.
struct Walk<'a, F> {
    selection: &'a Selection,
    gathering: Gathering<F>,
    refused: Option<(usize, String)>,
}

impl<F: FnMut(usize, &Layout, Vec<u8>) -> bool> Walk<'_, F> {
    fn add(&mut self, topic: usize, channel: &mcap::Channel<'_>, message: &[u8]) -> Result<(), String> {
        let block = &mut self.gathering.blocks[topic];
        if block.is_none() {
            *block = Some((Layout::of(channel, &self.selection.fields)?, Vec::new()));
        }
        if let Some((layout, bytes)) = block {
            layout.take(message, bytes)?;
        }
        self.gathering.give_full(topic);
        Ok(())
    }
}

impl<F: FnMut(usize, &Layout, Vec<u8>) -> bool> Visitor for Walk<'_, F> {
    fn wants(&self, first_ns: u64, last_ns: u64) -> bool {
        overlap(&self.selection.log_time_ns, first_ns, last_ns)
    }

    fn has_enough(&self) -> bool {
        self.gathering.has_enough || self.refused.is_some()
    }

    fn message(&mut self, channel: &Arc<mcap::Channel<'static>>, header: &MessageHeader, data: &[u8]) {
        if self.has_enough() || !self.selection.log_time_ns.contains(&header.log_time) {
            return;
        }
        let Some(topic) = self.selection.topics.iter().position(|topic| *topic == channel.topic) else { return };
        self.refused = self.add(topic, channel, data).err().map(|reason| (topic, reason));
    }
}

impl Log {
    /// The samples of topics with a log time in a range, one behind the other as they lie in the log: `each` is given the
    /// topic's place in `topics`, how a sample lies and a block of samples, and says whether to go on. Of a log that was ended
    /// properly only the chunks that hold these topics are read, and unpacked on all cores; another is walked through.
    ///
    /// # Errors
    /// Where the file cannot be read, or a topic's schema is none of plain samples.
    pub fn select(
        &self,
        selection: &Selection,
        each: impl FnMut(usize, &Layout, Vec<u8>) -> bool,
    ) -> Result<Damage, LogError> {
        let none = selection.topics.iter().map(|_| None).collect();
        let mut gathering = Gathering { most_rows: selection.most_rows, blocks: none, each, has_enough: false };
        let schema_error = |topic: usize, reason| {
            let topic = selection.topics[topic].clone();
            LogError::Schema { path: self.path().to_owned(), topic, reason }
        };
        let Some(summary) = scan::summary(self.path()).map_err(|e| self.file_error(e))? else {
            let mut walk = Walk { selection, gathering, refused: None };
            let damage = self.walk(&mut walk)?;
            if let Some((topic, reason)) = walk.refused {
                return Err(schema_error(topic, reason));
            }
            walk.gathering.give_rest();
            return Ok(damage);
        };
        let indexed = Indexed::new(summary, selection).map_err(|(topic, reason)| schema_error(topic, reason))?;
        for (topic, block) in gathering.blocks.iter_mut().enumerate() {
            *block = indexed.layout(topic).map(|layout| (layout.clone(), indexed.room(topic)));
        }
        let give = |gathered: &[Vec<u8>]| {
            for (topic, more) in gathered.iter().enumerate() {
                if let Some((_, bytes)) = &mut gathering.blocks[topic] {
                    bytes.extend_from_slice(more);
                }
                gathering.give_full(topic);
            }
            !gathering.has_enough
        };
        let damage = indexed.read(self.path(), give).map_err(|trouble| match trouble {
            Trouble::File(source) => self.file_error(source),
            Trouble::Refused(topic, reason) => schema_error(topic, reason),
        })?;
        gathering.give_rest();
        Ok(damage)
    }
}
