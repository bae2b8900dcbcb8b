//! Topics in local memory, for fast runs, replay and tests.

use fss_messages::Sample;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

/// One subscriber's samples that it has not yet taken, as bytes, one behind the other in a ring.
struct Ring {
    bytes: Box<[u8]>,
    sample_size: usize,
    first: usize,
    len: usize,
}

impl Ring {
    fn new(sample_size: usize, capacity: usize) -> Self {
        Self { bytes: vec![0; sample_size * capacity.max(1)].into_boxed_slice(), sample_size, first: 0, len: 0 }
    }

    /// Appends a sample; a full ring loses its oldest, as in shared memory.
    fn push(&mut self, sample: &[u8]) {
        let capacity = self.bytes.len() / self.sample_size;
        if self.len == capacity {
            self.first = (self.first + 1) % capacity;
            self.len -= 1;
        }
        let at = (self.first + self.len) % capacity * self.sample_size;
        self.bytes[at..at + self.sample_size].copy_from_slice(sample);
        self.len += 1;
    }

    fn pop(&mut self) -> Option<&[u8]> {
        self.len = self.len.checked_sub(1)?;
        let at = self.first * self.sample_size;
        self.first = (self.first + 1) % (self.bytes.len() / self.sample_size);
        Some(&self.bytes[at..at + self.sample_size])
    }
}

/// A topic: what its samples are, and who takes them.
struct LocalTopic {
    type_name: String,
    sample_size: usize,
    rings: RefCell<Vec<Rc<RefCell<Ring>>>>,
}

/// The topics of one process.
#[derive(Default)]
pub(crate) struct LocalTopics {
    by_name: RefCell<BTreeMap<String, Rc<LocalTopic>>>,
}

impl LocalTopics {
    /// The topic; `None` where the name is already used with another sample.
    fn topic(&self, name: &str, type_name: &str, sample_size: usize) -> Option<Rc<LocalTopic>> {
        let mut topics = self.by_name.borrow_mut();
        let new = || LocalTopic { type_name: type_name.to_owned(), sample_size, rings: RefCell::default() };
        let topic = topics.entry(name.to_owned()).or_insert_with(|| Rc::new(new()));
        (topic.type_name == type_name && topic.sample_size == sample_size).then(|| topic.clone())
    }

    pub(crate) fn subscribe(&self, name: &str, kind: (&str, usize), capacity: usize) -> Option<LocalSubscriber> {
        let topic = self.topic(name, kind.0, kind.1)?;
        let ring = Rc::new(RefCell::new(Ring::new(kind.1, capacity)));
        topic.rings.borrow_mut().push(ring.clone());
        Some(LocalSubscriber { ring })
    }

    pub(crate) fn publisher(&self, name: &str, kind: (&str, usize)) -> Option<LocalPublisher> {
        Some(LocalPublisher { topic: self.topic(name, kind.0, kind.1)? })
    }
}

/// What a sample of this type is known by.
pub(crate) fn kind_of<T: Sample>() -> (&'static str, usize) {
    (T::TYPE_NAME, size_of::<T>())
}

pub(crate) struct LocalSubscriber {
    ring: Rc<RefCell<Ring>>,
}

impl LocalSubscriber {
    pub(crate) fn receive<T: Sample>(&self) -> Option<T> {
        self.ring.borrow_mut().pop().and_then(|bytes| T::read_from_bytes(bytes).ok())
    }

    /// Gives the next sample to `take`; false where there is none.
    pub(crate) fn receive_bytes(&self, take: impl FnOnce(&[u8])) -> bool {
        self.ring.borrow_mut().pop().map(take).is_some()
    }
}

pub(crate) struct LocalPublisher {
    topic: Rc<LocalTopic>,
}

impl LocalPublisher {
    /// Hands the sample, which is of the topic's size, to all subscribers.
    pub(crate) fn send(&self, sample: &[u8]) {
        for ring in self.topic.rings.borrow().iter() {
            ring.borrow_mut().push(sample);
        }
    }
}
