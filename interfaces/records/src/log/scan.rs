//! Walking through a log's records, a chunk at a time, also of a log that was cut off or damaged.
//!
//! A record is an opcode, a length and a body. Of a chunk nothing is handed out before its checksum was found right, so
//! that a damaged one costs itself and no more. Where the lengths themselves are damaged, the walk goes on at the next
//! place at which a chunk's header fits its own length.

use mcap::parse_record;
use mcap::read::ChannelAccumulator;
use mcap::records::{AttachmentHeader, ChunkIndex, MessageHeader, Metadata, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions, SummaryReadEvent, SummaryReader};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

/// Opcode and length in front of each record.
const FRAME_LEN: u64 = 9;
/// No chunk of ours is larger, compressed or not; a length beyond it is damage.
pub(super) const LONGEST_RECORD: usize = 64 << 20;
/// What stands in a chunk's body before the name of its compression: two times, size, checksum, the name's length.
const CHUNK_HEAD_LEN: u64 = 8 + 8 + 8 + 4 + 4;
/// No compression has a longer name.
const LONGEST_NAME: u64 = 16;
/// How much is searched at once for the next chunk.
const SEARCH_LEN: usize = 1 << 20;
/// What is read ahead: little, as most of a file is passed over or read at once.
const BUFFER_LEN: usize = 1 << 12;
/// The longest header of a chunk.
const CHUNK_HEADER_LEN: usize = (FRAME_LEN + CHUNK_HEAD_LEN + LONGEST_NAME + 8) as usize;

/// Takes what a log holds, in the order of the file.
pub(super) trait Visitor {
    /// Whether chunks must be unpacked at all.
    const MESSAGES: bool = true;
    /// Whether a chunk of messages from `first_ns` to `last_ns` of log time is wanted.
    fn wants(&self, _first_ns: u64, _last_ns: u64) -> bool {
        true
    }
    /// Whether there is enough: the walk ends.
    fn has_enough(&self) -> bool {
        false
    }
    /// A message of a channel.
    fn message(&mut self, _channel: &Arc<mcap::Channel<'static>>, _header: &MessageHeader, _data: &[u8]) {}
    /// An attached file.
    fn attachment(&mut self, _header: &AttachmentHeader, _data: &[u8]) {}
    /// Facts under a name.
    fn metadata(&mut self, _metadata: &Metadata) {}
}

/// What a walk could not read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// Places in the middle of the file where something was unreadable.
    pub places: u64,
    /// Bytes there.
    pub bytes: u64,
    /// Bytes of an unfinished record at the end.
    pub cut_off_bytes: u64,
}

/// A log's file on its way past a visitor.
pub(super) struct Scan {
    file: BufReader<File>,
    at: u64,
    /// Up to here lengths were confirmed by what they belong to: a search for the next chunk begins here.
    confirmed: u64,
    end: u64,
    channels: ChannelAccumulator<'static>,
    /// Where a summary says that each chunk ends with its indexes, by where it begins. With a summary channels are known
    /// from there, so that a chunk may be passed over.
    ends: Option<HashMap<u64, u64>>,
    record: Vec<u8>,
    unpacker: Unpacker,
    damage: Damage,
}

/// What follows in the file.
enum Next {
    Record { opcode: u8, len: u64 },
    Damaged,
    End,
}

/// What a record turned out to be.
enum Found {
    /// Its content agrees with its length.
    Whole,
    /// It was passed over; nothing confirms its length.
    Plausible,
    /// Its content is damaged, its length right.
    Damaged,
    /// Its length is damaged: the way is lost.
    Lost,
}

impl Found {
    fn whole_if(whole: bool) -> Self {
        if whole { Self::Whole } else { Self::Damaged }
    }
}

/// Whether the file starts as an MCAP file does.
pub(super) fn has_magic(path: &Path) -> io::Result<bool> {
    let mut magic = [0; mcap::MAGIC.len()];
    match File::open(path)?.read_exact(&mut magic) {
        Ok(()) => Ok(magic == mcap::MAGIC),
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        Err(e) => Err(e),
    }
}

/// The summary at the end of a log that was ended properly.
pub(super) fn summary(path: &Path) -> io::Result<Option<mcap::Summary>> {
    let mut file = File::open(path)?;
    let mut reader = SummaryReader::new();
    while let Some(event) = reader.next_event() {
        match event {
            Ok(SummaryReadEvent::ReadRequest(len)) => {
                let n = file.read(reader.insert(len.min(LONGEST_RECORD)))?;
                reader.notify_read(n);
            }
            // A seek before the start of the file comes from a damaged or missing footer.
            Ok(SummaryReadEvent::SeekRequest(to)) => match file.seek(to) {
                Ok(at) => reader.notify_seeked(at),
                Err(_) => return Ok(None),
            },
            Err(_) => return Ok(None),
        }
    }
    Ok(reader.finish())
}

/// Unpacks chunks.
pub(super) struct Unpacker(LinearReader);

impl Unpacker {
    pub(super) fn new() -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LONGEST_RECORD);
        Self(LinearReader::new_with_options(options))
    }

    /// Gives the records, opcode and body, of a chunk that stands here with its opcode and length; nothing comes from one
    /// whose checksum is wrong. False where the chunk is damaged or `each` says so.
    pub(super) fn each_record(&mut self, chunk: &[u8], mut each: impl FnMut(u8, &[u8]) -> bool) -> bool {
        self.0.insert(chunk.len())[..chunk.len()].copy_from_slice(chunk);
        self.0.notify_read(chunk.len());
        let mut whole = true;
        loop {
            match self.0.next_event() {
                Some(Ok(LinearReadEvent::Record { opcode, data })) => whole &= each(opcode, data),
                Some(Ok(LinearReadEvent::ReadRequest(_))) => return whole,
                Some(Err(_)) | None => {
                    *self = Self::new();
                    return false;
                }
            }
        }
    }
}

impl Scan {
    /// From behind the file's magic.
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        // Channels are told once, in the first chunk: a summary has them again where that chunk is damaged.
        let summary = summary(path)?;
        let ends = summary.as_ref().map(|summary| summary.chunk_indexes.iter().map(end_of).collect());
        let channels = summary.map_or_else(ChannelAccumulator::default, |s| ChannelAccumulator::from_summary(&s));
        let file = File::open(path)?;
        let end = file.metadata()?.len();
        let mut file = BufReader::with_capacity(BUFFER_LEN, file);
        let at = (mcap::MAGIC.len() as u64).min(end);
        file.seek(SeekFrom::Start(at))?;
        Ok(Self {
            file,
            at,
            confirmed: at,
            end,
            channels,
            ends,
            record: Vec::new(),
            unpacker: Unpacker::new(),
            damage: Damage::default(),
        })
    }

    /// Shows everything to the visitor, up to the summary or to the end.
    pub(super) fn run<V: Visitor>(mut self, visitor: &mut V) -> io::Result<Damage> {
        loop {
            let found = match self.next()? {
                _ if visitor.has_enough() => return Ok(self.damage),
                Next::End | Next::Record { opcode: op::DATA_END, .. } => return Ok(self.damage),
                Next::Record { opcode, len } => {
                    let found = self.record(opcode, len, visitor)?;
                    if !matches!(found, Found::Lost) {
                        let end = self.at + FRAME_LEN + len;
                        let indexed = self.ends.as_ref().and_then(|ends| ends.get(&self.at).copied());
                        self.go_to(indexed.filter(|to| (end..=self.end).contains(to)).unwrap_or(end))?;
                        if !matches!(found, Found::Plausible) {
                            self.confirmed = self.at;
                        }
                    }
                    if matches!(found, Found::Damaged) {
                        self.damage.places += 1;
                        self.damage.bytes += FRAME_LEN + len;
                    }
                    found
                }
                Next::Damaged => Found::Lost,
            };
            if matches!(found, Found::Lost) {
                let Some(at) = self.next_chunk()? else {
                    self.damage.cut_off_bytes = self.end - self.confirmed;
                    return Ok(self.damage);
                };
                self.damage.places += 1;
                self.damage.bytes += at - self.confirmed;
                self.go_to(at)?;
            }
        }
    }

    fn go_to(&mut self, at: u64) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(at))?;
        self.at = at;
        Ok(())
    }

    /// Reads a frame; the file stands behind it then.
    fn next(&mut self) -> io::Result<Next> {
        if self.at == self.end {
            return Ok(Next::End);
        }
        let mut frame = [0; FRAME_LEN as usize];
        if self.end - self.at < FRAME_LEN {
            return Ok(Next::Damaged);
        }
        self.file.read_exact(&mut frame)?;
        let [opcode, len @ ..] = frame;
        let len = u64::from_le_bytes(len);
        let fits = len <= self.end - self.at - FRAME_LEN && len <= LONGEST_RECORD as u64;
        let known = (op::HEADER..=op::DATA_END).contains(&opcode);
        Ok(if fits && known { Next::Record { opcode, len } } else { Next::Damaged })
    }

    fn record<V: Visitor>(&mut self, opcode: u8, len: u64, visitor: &mut V) -> io::Result<Found> {
        let wanted = match opcode {
            op::CHUNK | op::ATTACHMENT | op::METADATA | op::SCHEMA | op::CHANNEL => true,
            op::MESSAGE => V::MESSAGES,
            _ => false,
        };
        if !wanted {
            return Ok(Found::Plausible);
        }
        if opcode == op::CHUNK && (!V::MESSAGES || self.ends.is_some()) {
            let mut header = [0; CHUNK_HEADER_LEN];
            let header = &mut header[..CHUNK_HEADER_LEN.min((FRAME_LEN + len) as usize)];
            self.file.seek(SeekFrom::Start(self.at))?;
            self.file.read_exact(header)?;
            let fits = is_chunk_header(header, self.end - self.at);
            let time = |at| number(header, FRAME_LEN + at, 8).unwrap_or_default();
            if !fits || !V::MESSAGES || !visitor.wants(time(0), time(8)) {
                return Ok(if fits { Found::Whole } else { Found::Lost });
            }
        }
        // The frame stays in front of the body: a chunk is unpacked with it.
        self.record.resize((FRAME_LEN + len) as usize, 0);
        self.file.seek(SeekFrom::Start(self.at))?;
        self.file.read_exact(&mut self.record)?;
        let body = &self.record[FRAME_LEN as usize..];
        Ok(match opcode {
            op::CHUNK if !is_chunk_header(&self.record, self.end - self.at) => Found::Lost,
            op::CHUNK => {
                let Self { unpacker, record, channels, .. } = self;
                Found::whole_if(unpacker.each_record(record, |opcode, data| take(channels, opcode, data, visitor)))
            }
            op::ATTACHMENT if !is_attachment(body) => Found::Lost,
            op::ATTACHMENT => Found::whole_if(take(&mut self.channels, opcode, body, visitor)),
            _ if take(&mut self.channels, opcode, body, visitor) => Found::Plausible,
            _ => Found::Lost,
        })
    }

    /// Where behind the confirmed part the next chunk begins whose header agrees with its length.
    fn next_chunk(&mut self) -> io::Result<Option<u64>> {
        let mut from = self.confirmed;
        let mut window = vec![0; SEARCH_LEN];
        while from < self.end {
            let len = (self.end - from).min(SEARCH_LEN as u64) as usize;
            self.file.seek(SeekFrom::Start(from))?;
            self.file.read_exact(&mut window[..len])?;
            for i in 0..len {
                let room = self.end - from - i as u64;
                if window[i] == op::CHUNK && is_chunk_header(&window[i..len], room) {
                    return Ok(Some(from + i as u64));
                }
            }
            if from + len as u64 == self.end {
                return Ok(None);
            }
            from += (len - CHUNK_HEADER_LEN) as u64; // a header may lie across the border
        }
        Ok(None)
    }
}

/// Hands one record to the visitor or to the channels; false where it is damaged.
fn take<V: Visitor>(channels: &mut ChannelAccumulator<'static>, opcode: u8, data: &[u8], visitor: &mut V) -> bool {
    match parse_record(opcode, data) {
        Ok(Record::Message { header, data }) => match channels.get(header.channel_id) {
            Some(channel) => visitor.message(&channel, &header, &data),
            None => return false,
        },
        Ok(Record::Schema { header, data }) => return channels.add_schema_from_slice(header, &data).is_ok(),
        Ok(Record::Channel(channel)) => return channels.add_channel(channel).is_ok(),
        Ok(Record::Attachment { header, data, .. }) => visitor.attachment(&header, &data),
        Ok(Record::Metadata(metadata)) => visitor.metadata(&metadata),
        Ok(_) => {}
        Err(_) => return false,
    }
    true
}

/// Where a chunk begins, and where it ends with the indexes behind it.
fn end_of(chunk: &ChunkIndex) -> (u64, u64) {
    let start = chunk.chunk_start_offset;
    (start, start.saturating_add(chunk.chunk_length).saturating_add(chunk.message_index_length))
}

/// The little-endian number of `size` bytes at `at`.
fn number(bytes: &[u8], at: u64, size: usize) -> Option<u64> {
    let at = usize::try_from(at).ok()?;
    let mut word = [0; 8];
    word[..size].copy_from_slice(bytes.get(at..at.checked_add(size)?)?);
    Some(u64::from_le_bytes(word))
}

/// Whether a chunk may begin here: the length of the whole must be that of its header and its content.
fn is_chunk_header(bytes: &[u8], room: u64) -> bool {
    let fits = || {
        let len = number(bytes, 1, 8)?;
        let name_len = number(bytes, FRAME_LEN + CHUNK_HEAD_LEN - 4, 4).filter(|len| *len <= LONGEST_NAME)?;
        let content = number(bytes, FRAME_LEN + CHUNK_HEAD_LEN + name_len, 8)?;
        Some(len == (CHUNK_HEAD_LEN + name_len + 8).checked_add(content)? && len <= room.checked_sub(FRAME_LEN)?)
    };
    fits() == Some(true)
}

/// Whether an attachment's length is that of its names, its content and its checksum; the library takes it for granted.
fn is_attachment(body: &[u8]) -> bool {
    let fits = || {
        let name_len = number(body, 16, 4)?;
        let media_len = number(body, 20 + name_len, 4)?;
        let content = number(body, 24 + name_len + media_len, 8)?;
        Some(body.len() as u64 == (32 + name_len + media_len + 4).checked_add(content)?)
    };
    fits() == Some(true)
}
