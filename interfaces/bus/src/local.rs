//! Topics in local memory, for fast runs, replay and tests.

use fss_messages::Sample;
use std::any::Any;
use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

/// One subscriber's samples that it has not yet taken, at most `capacity`.
struct Buffer<T> {
    samples: VecDeque<T>,
    capacity: usize,
}

type Subscribers<T> = Rc<RefCell<Vec<Rc<RefCell<Buffer<T>>>>>>;

/// The topics of one process.
#[derive(Default)]
pub(crate) struct LocalTopics {
    by_name: RefCell<BTreeMap<String, Box<dyn Any>>>,
}

impl LocalTopics {
    /// The subscribers of a topic; `None` where the name is already used with another sample.
    fn subscribers<T: Sample>(&self, name: &str) -> Option<Subscribers<T>> {
        let mut topics = self.by_name.borrow_mut();
        let topic = topics.entry(name.to_owned()).or_insert_with(|| Box::new(Subscribers::<T>::default()));
        topic.downcast_ref::<Subscribers<T>>().cloned()
    }

    pub(crate) fn subscribe<T: Sample>(&self, name: &str, capacity: usize) -> Option<LocalSubscriber<T>> {
        let buffer = Rc::new(RefCell::new(Buffer { samples: VecDeque::with_capacity(capacity), capacity }));
        self.subscribers(name)?.borrow_mut().push(buffer.clone());
        Some(LocalSubscriber { buffer })
    }

    pub(crate) fn publisher<T: Sample>(&self, name: &str) -> Option<LocalPublisher<T>> {
        Some(LocalPublisher { subscribers: self.subscribers(name)? })
    }
}

pub(crate) struct LocalSubscriber<T> {
    buffer: Rc<RefCell<Buffer<T>>>,
}

impl<T: Sample> LocalSubscriber<T> {
    pub(crate) fn receive(&self) -> Option<T> {
        self.buffer.borrow_mut().samples.pop_front()
    }
}

pub(crate) struct LocalPublisher<T> {
    subscribers: Subscribers<T>,
}

impl<T: Sample> LocalPublisher<T> {
    /// Hands the sample to all subscribers; a full buffer loses its oldest sample, as in shared memory.
    pub(crate) fn send(&self, sample: T) {
        for subscriber in self.subscribers.borrow().iter() {
            let mut buffer = subscriber.borrow_mut();
            if buffer.samples.len() == buffer.capacity {
                buffer.samples.pop_front();
            }
            buffer.samples.push_back(sample);
        }
    }
}
