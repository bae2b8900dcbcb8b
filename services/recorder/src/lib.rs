//! Records every topic to MCAP.
//!
//! The recorder takes what its deep buffers hold since its last step and hands it, in blocks, to the tape, which writes
//! on a thread of its own. Nothing that the disk does reaches a control loop, nor the recorder's own loop:
//!
//! - a disk that stalls fills the blocks; when none is left, samples are lost and counted;
//! - a disk that is full, or that refuses, ends the log; another is begun when there is room again;
//! - a sample that never came (the recorder's buffer overflowed because the host stalled) shows as a gap in its
//!   publisher's sequence.
//!
//! What is lost is counted by topic, said in `/events`, and written into the log's metadata (`fss-recorder`).

mod block;
mod inputs;
mod tape;
mod thread;

pub use inputs::AllTopics;
pub use tape::{Limits, Opener};

use block::Block;
use crossbeam_queue::ArrayQueue;
use fss_bus::{Bus, Output, Queue, Service, Time, outputs};
use fss_messages::{Event, topic};
use fss_records::log::LogError;
use inputs::Publishers;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tape::{Lost, Tape};
use thread::TapeThread;

const NAME: &str = "recorder";
/// How long samples wait in a block that is not full, ns.
const BLOCK_TIME_NS: u64 = 100_000_000;
/// Losses of a topic are told at most this often, ns.
const TELL_PERIOD_NS: u64 = 1_000_000_000;

outputs! {
    /// What the recorder says.
    pub struct Outputs {
        /// Losses and failures.
        events: Output<Event> = topic::EVENTS,
    }
}

enum Sink {
    /// Written at once: on a virtual clock nothing may be lost, and the same seed gives the same bytes.
    Inline(Box<Tape>, Block),
    Thread(TapeThread, Option<Block>),
}

/// The recorder.
pub struct Recorder {
    sink: Sink,
    handed_over_ns: u64,
    publishers: Vec<Publishers>,
    lost: Lost,
    names: Vec<String>,
    told: Vec<u64>,
    told_ns: u64,
    words: Queue<Event>,
}

impl Recorder {
    /// Writes in its step, and waits for the disk.
    ///
    /// # Errors
    /// Where the first log cannot be begun.
    pub fn waiting(bus: &Bus, open: Opener) -> Result<Self, LogError> {
        Self::new(bus, open, Limits::default(), |tape| Sink::Inline(Box::new(tape), Block::new()))
    }

    /// Writes on a thread of its own, and waits for nothing.
    ///
    /// # Errors
    /// Where the first log cannot be begun.
    pub fn threaded(bus: &Bus, open: Opener, limits: Limits) -> Result<Self, LogError> {
        Self::new(bus, open, limits, |tape| Sink::Thread(TapeThread::start(tape), None))
    }

    fn new(bus: &Bus, open: Opener, limits: Limits, sink: impl FnOnce(Tape) -> Sink) -> Result<Self, LogError> {
        let definitions = inputs::definitions(bus);
        let count = definitions.len();
        let names = definitions.iter().map(|definition| definition.topic.clone()).collect();
        let lost: Lost = Arc::new((0..count).map(|_| AtomicU64::new(0)).collect());
        let words = Arc::new(ArrayQueue::new(16));
        let tape = Tape::begin(open, definitions, limits, lost.clone(), words.clone())?;
        let publishers = vec![Publishers::default(); count];
        Ok(Self {
            sink: sink(tape),
            handed_over_ns: 0,
            publishers,
            lost,
            names,
            told: vec![0; count],
            told_ns: 0,
            words,
        })
    }

    /// Samples lost since the start, all topics together.
    pub fn lost(&self) -> u64 {
        self.lost.iter().map(|lost| lost.load(Ordering::Relaxed)).sum()
    }

    /// Ends the log when all that was taken is written.
    ///
    /// # Errors
    /// Where the log cannot be ended.
    pub fn finish(self) -> Result<(), LogError> {
        match self.sink {
            Sink::Inline(mut tape, block) => {
                tape.write(&block);
                tape.finish()
            }
            Sink::Thread(thread, block) => {
                if let Some(block) = block {
                    thread.give(block);
                }
                thread.finish()
            }
        }
    }

    fn tell_losses(&mut self, now: Time, events: &mut Output<Event>) {
        while let Some(event) = self.words.pop() {
            events.publish(event);
        }
        if now.ns() < self.told_ns + TELL_PERIOD_NS {
            return;
        }
        for ((name, lost), told) in self.names.iter().zip(self.lost.iter()).zip(&mut self.told) {
            let lost = lost.load(Ordering::Relaxed);
            // To tell of a lost event would lose the next.
            if lost > *told && !name.ends_with(topic::EVENTS.name) {
                let new = lost - *told;
                let words = format_args!("{name}: {new} samples lost ({lost} since the start)");
                events.publish(Event::new(now.ns(), NAME, Event::WARNING, words));
                (*told, self.told_ns) = (lost, now.ns());
            }
        }
    }
}

impl Sink {
    /// Puts a topic's samples into blocks; returns how many found no room.
    fn put(&mut self, topic: usize, input: &dyn inputs::TopicInput) -> u64 {
        let (count, mut done) = (input.len(), 0);
        while done < count {
            let room = match self {
                Self::Inline(_, block) => Some(block),
                Self::Thread(thread, block) => {
                    if block.is_none() {
                        *block = thread.take();
                    }
                    block.as_mut()
                }
            };
            let Some(block) = room else { break };
            done = input.write_to(block, topic, done);
            if done < count {
                self.hand_over();
            }
        }
        (count - done) as u64
    }

    fn hand_over(&mut self) {
        match self {
            Self::Inline(tape, block) => {
                tape.write(block);
                block.clear();
            }
            Self::Thread(thread, block) => {
                if let Some(block) = block.take_if(|block| !block.is_empty()) {
                    thread.give(block);
                }
            }
        }
    }
}

impl Service for Recorder {
    type Inputs = AllTopics;
    type Outputs = Outputs;
    const NAME: &'static str = NAME;
    const TAKES_THE_LAST: bool = true;

    fn step(&mut self, now: Time, inputs: &AllTopics, outputs: &mut Outputs) {
        for (i, input) in inputs.iter().enumerate() {
            let missing = input.count_gaps(&mut self.publishers[i]) + self.sink.put(i, input);
            if missing > 0 {
                self.lost[i].fetch_add(missing, Ordering::Relaxed);
            }
        }
        if now.ns() >= self.handed_over_ns + BLOCK_TIME_NS {
            self.sink.hand_over();
            self.handed_over_ns = now.ns();
        }
        self.tell_losses(now, &mut outputs.events);
    }
}
