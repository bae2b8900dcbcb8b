//! The samples of topics from the chunks that a log's summary names, unpacked on all cores.

use super::scan::{Damage, LONGEST_RECORD, Unpacker};
use super::selection::{Layout, Selection, overlap};
use mcap::Summary;
use mcap::records::{ChunkIndex, op};
use std::collections::HashMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::mpsc::sync_channel;
use std::thread;

/// Chunks that each core may be ahead: it bounds the memory.
const CHUNKS_AHEAD: usize = 4;
/// More cores than this find nothing to do: what they unpack is put together on one.
const MOST_CORES: usize = 16;
/// A message's channel, sequence, log time and publication time.
const MESSAGE_HEAD_LEN: usize = 2 + 4 + 8 + 8;

/// Why a log cannot be read.
pub(super) enum Trouble {
    /// The file system refused.
    File(io::Error),
    /// The topic at this place holds something else than plain samples.
    Refused(usize, String),
}

/// What a chunk holds of each topic; `None` where it is damaged.
type Gathered = Result<Option<Vec<Vec<u8>>>, Trouble>;

/// What is to be read of a log that has a summary.
pub(super) struct Indexed<'a> {
    selection: &'a Selection,
    /// Where the chunks that are wanted begin, and how long they are, in order.
    chunks: Vec<(u64, u64)>,
    /// Places in `topics` by channel.
    channels: HashMap<u16, usize>,
    layouts: Vec<Option<Layout>>,
    /// Bytes that the whole log holds of each topic.
    sizes: Vec<usize>,
}

impl<'a> Indexed<'a> {
    /// # Errors
    /// Where a topic's schema is none of plain samples.
    pub(super) fn new(summary: Summary, selection: &'a Selection) -> Result<Self, (usize, String)> {
        let topics = selection.topics.len();
        let mut new = Self {
            selection,
            chunks: Vec::new(),
            channels: HashMap::new(),
            layouts: vec![None; topics],
            sizes: vec![0; topics],
        };
        let counts = summary.stats.map(|stats| stats.channel_message_counts).unwrap_or_default();
        let mut channels: Vec<_> = summary.channels.iter().collect();
        channels.sort_by_key(|(id, _)| **id);
        for (id, channel) in channels {
            let count = counts.get(id).map_or(0, |count| *count as usize);
            let place = selection.topics.iter().position(|topic| *topic == channel.topic);
            let Some(topic) = place.filter(|_| count > 0 || counts.is_empty()) else { continue };
            if new.layouts[topic].is_none() {
                new.layouts[topic] = Some(Layout::of(channel, &selection.fields).map_err(|reason| (topic, reason))?);
            }
            new.channels.insert(*id, topic);
            new.sizes[topic] += new.layouts[topic].as_ref().map_or(0, |layout| count.saturating_mul(layout.size));
        }
        let is_wanted = |chunk: &&ChunkIndex| {
            let held = &chunk.message_index_offsets;
            overlap(&selection.log_time_ns, chunk.message_start_time, chunk.message_end_time)
                && (held.is_empty() || new.channels.keys().any(|id| held.contains_key(id)))
        };
        let wanted = summary.chunk_indexes.iter().filter(is_wanted);
        new.chunks = wanted.map(|chunk| (chunk.chunk_start_offset, chunk.chunk_length)).collect();
        new.chunks.sort_unstable();
        Ok(new)
    }

    pub(super) fn layout(&self, topic: usize) -> Option<&Layout> {
        self.layouts[topic].as_ref()
    }

    /// Room for all samples of a topic, where they are wanted at once.
    pub(super) fn room(&self, topic: usize) -> Vec<u8> {
        let mut room = Vec::new();
        if self.selection.most_rows == usize::MAX && self.selection.log_time_ns == (0..=u64::MAX) {
            // A damaged log may promise more than there is memory for: then the room grows with what comes.
            let _ = room.try_reserve_exact(self.sizes[topic]);
        }
        room
    }

    /// Gives what the chunks hold of each topic, in the order of the file, until `give` has enough.
    pub(super) fn read(&self, path: &Path, mut give: impl FnMut(&[Vec<u8>]) -> bool) -> Result<Damage, Trouble> {
        let file = &File::open(path).map_err(Trouble::File)?;
        let cores = thread::available_parallelism().map_or(1, usize::from).min(MOST_CORES);
        let mut damage = Damage::default();
        thread::scope(|scope| {
            // Each core takes each so-manieth chunk: what they hand over is in order.
            let begin = |first| {
                let (hand, ready) = sync_channel(CHUNKS_AHEAD);
                scope.spawn(move || {
                    let mut unpacker = Unpacker::new();
                    let own = self.chunks.iter().skip(first).step_by(cores);
                    own.map(|chunk| self.gather(file, *chunk, &mut unpacker)).try_for_each(|found| hand.send(found))
                });
                ready
            };
            let ready: Vec<_> = (0..cores).map(begin).collect();
            for ((_, len), core) in self.chunks.iter().zip((0..cores).cycle()) {
                match ready[core].recv() {
                    Ok(Ok(Some(gathered))) => {
                        if !give(&gathered) {
                            break;
                        }
                    }
                    Ok(Ok(None)) => {
                        damage.places += 1;
                        damage.bytes += len;
                    }
                    Ok(Err(trouble)) => return Err(trouble),
                    Err(_) => break,
                }
            }
            Ok(damage)
        })
    }

    fn gather(&self, file: &File, (start, len): (u64, u64), unpacker: &mut Unpacker) -> Gathered {
        if len > LONGEST_RECORD as u64 {
            return Ok(None);
        }
        let mut packed = vec![0; len as usize];
        file.read_exact_at(&mut packed, start).map_err(Trouble::File)?;
        let mut gathered = vec![Vec::new(); self.layouts.len()];
        let mut refused = None;
        let is_chunk = packed.first() == Some(&op::CHUNK);
        let whole = is_chunk
            && unpacker.each_record(&packed, |opcode, record| {
                if opcode != op::MESSAGE {
                    return true;
                }
                let Some((head, message)) = record.split_first_chunk::<MESSAGE_HEAD_LEN>() else { return false };
                let Some(topic) = self.channels.get(&u16::from_le_bytes([head[0], head[1]])) else { return true };
                let [_, _, _, _, _, _, time_ns @ .., _, _, _, _, _, _, _, _] = *head;
                let wanted = self.selection.log_time_ns.contains(&u64::from_le_bytes(time_ns));
                let layout = self.layouts[*topic].as_ref().filter(|_| wanted && refused.is_none());
                let taken = layout.map_or(Ok(()), |layout| layout.take(message, &mut gathered[*topic]));
                refused = refused.take().or(taken.err().map(|reason| (*topic, reason)));
                true
            });
        match refused {
            Some((topic, reason)) => Err(Trouble::Refused(topic, reason)),
            None => Ok(whole.then_some(gathered)),
        }
    }
}
