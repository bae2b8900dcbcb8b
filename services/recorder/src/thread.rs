//! The tape on a thread of its own: a disk that stalls holds up nobody.

use crate::block::Block;
use crate::tape::Tape;
use crossbeam_queue::ArrayQueue;
use fss_records::log::LogError;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How many blocks there are. At the rates of the launch file they hold the samples of half a minute.
const BLOCKS: usize = 256;
/// How often the thread looks for blocks.
const POLL: Duration = Duration::from_millis(5);
/// With no samples for so long, what is in hand goes to the operating system.
const IDLE: Duration = Duration::from_millis(500);

/// The service's end.
pub(crate) struct TapeThread {
    empty: Arc<ArrayQueue<Block>>,
    full: Arc<ArrayQueue<Block>>,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Result<(), LogError>>,
}

impl TapeThread {
    pub(crate) fn start(tape: Tape) -> Self {
        let (empty, full) = (Arc::new(ArrayQueue::new(BLOCKS)), Arc::new(ArrayQueue::new(BLOCKS)));
        while empty.push(Block::new()).is_ok() {}
        let stop = Arc::new(AtomicBool::new(false));
        let thread = {
            let (empty, full, stop) = (empty.clone(), full.clone(), stop.clone());
            std::thread::spawn(move || write(tape, &full, &empty, &stop))
        };
        Self { empty, full, stop, thread }
    }

    /// An empty block; none where the disk has fallen behind by all there are.
    pub(crate) fn take(&self) -> Option<Block> {
        self.empty.pop()
    }

    /// Hands a block over; every block has room, since there are no more of them than the queue is long.
    pub(crate) fn give(&self, block: Block) {
        let _always_fits = self.full.push(block);
    }

    /// Ends the last log when all blocks are written.
    pub(crate) fn finish(self) -> Result<(), LogError> {
        self.stop.store(true, Ordering::Release);
        self.thread.join().unwrap_or(Ok(()))
    }
}

fn write(
    mut tape: Tape,
    full: &ArrayQueue<Block>,
    empty: &ArrayQueue<Block>,
    stop: &AtomicBool,
) -> Result<(), LogError> {
    let mut last = Instant::now();
    let mut is_flushed = true;
    loop {
        // Asked before the queue is found empty: what was given before the word to stop is written.
        let stopping = stop.load(Ordering::Acquire);
        if let Some(mut block) = full.pop() {
            tape.write(&block);
            block.clear();
            let _always_fits = empty.push(block);
            (last, is_flushed) = (Instant::now(), false);
        } else if stopping {
            return tape.finish();
        } else {
            if !is_flushed && last.elapsed() >= IDLE {
                tape.flush();
                is_flushed = true;
            }
            std::thread::sleep(POLL);
        }
    }
}
