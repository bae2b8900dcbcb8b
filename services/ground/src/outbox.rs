//! What waits for one viewer.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// Samples that wait; when there are more, the oldest is dropped.
const MOST_SAMPLES: usize = 2048;
/// Words that wait (channels, answers). They are not dropped: a viewer that lets more wait does not read at all.
const MOST_WORDS: usize = 2048;

#[derive(Default)]
pub(crate) struct Outbox {
    waiting: Mutex<Waiting>,
    news: Condvar,
}

#[derive(Default)]
struct Waiting {
    words: VecDeque<Vec<u8>>,
    samples: VecDeque<Vec<u8>>,
    /// Nothing more may come.
    is_closed: bool,
    /// Nobody takes any more.
    is_left: bool,
}

/// What became of a frame, or of another in its place.
#[derive(Debug, PartialEq)]
pub(crate) enum Put {
    Waits,
    /// It waits, and the oldest sample was dropped for it.
    Dropped,
    /// The viewer has gone, or does not read.
    Closed,
}

impl Outbox {
    /// A sample that may be dropped, or another in its place.
    pub(crate) fn put_sample(&self, frame: Vec<u8>) -> Put {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        if waiting.is_closed {
            return Put::Closed;
        }
        let is_full = waiting.samples.len() >= MOST_SAMPLES;
        if is_full {
            waiting.samples.pop_front();
        }
        waiting.samples.push_back(frame);
        drop(waiting);
        self.news.notify_all();
        if is_full { Put::Dropped } else { Put::Waits }
    }

    /// What must be heard.
    pub(crate) fn put_words(&self, frame: Vec<u8>) -> Put {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        if waiting.is_closed || waiting.words.len() >= MOST_WORDS {
            return Put::Closed;
        }
        waiting.words.push_back(frame);
        drop(waiting);
        self.news.notify_all();
        Put::Waits
    }

    /// The next frame, words first, as soon as there is one; nothing when no more will come.
    pub(crate) fn take(&self) -> Option<Vec<u8>> {
        let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let nothing = |waiting: &mut Waiting| waiting.is_empty() && !waiting.is_closed;
        let mut waiting = self.news.wait_while(waiting, nothing).unwrap_or_else(PoisonError::into_inner);
        let frame = waiting.words.pop_front().or_else(|| waiting.samples.pop_front());
        drop(waiting);
        self.news.notify_all();
        frame
    }

    /// Takes no more, and waits at most so long until all is taken and said.
    pub(crate) fn close(&self, patience: Duration) {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.is_closed = true;
        self.news.notify_all();
        let is_said = |waiting: &mut Waiting| !waiting.is_left;
        let _whether_it_took_too_long = self.news.wait_timeout_while(waiting, patience, is_said);
    }

    /// Who takes says that it takes no more.
    pub(crate) fn leave(&self) {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        *waiting = Waiting { is_closed: true, is_left: true, ..Waiting::default() };
        drop(waiting);
        self.news.notify_all();
    }
}

impl Waiting {
    fn is_empty(&self) -> bool {
        self.words.is_empty() && self.samples.is_empty()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn the_oldest_samples_are_dropped_one_by_one_and_no_word_is() {
        let outbox = Outbox::default();
        let frame = |number: usize| number.to_le_bytes().to_vec();
        assert_eq!(outbox.put_words(frame(7)), Put::Waits);
        let dropped = (0..MOST_SAMPLES + 5).filter(|i| outbox.put_sample(frame(*i)) == Put::Dropped).count();
        assert_eq!(dropped, 5);
        outbox.close(Duration::ZERO);
        assert_eq!(outbox.put_sample(frame(8)), Put::Closed);
        let taken: Vec<usize> =
            std::iter::from_fn(|| outbox.take()).map(|bytes| usize::from_le_bytes(bytes.try_into().unwrap())).collect();
        let wanted: Vec<usize> = std::iter::once(7).chain(5..MOST_SAMPLES + 5).collect();
        assert_eq!(taken, wanted);
    }
}
