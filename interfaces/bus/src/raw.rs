//! Topics whose samples this program knows by their definition only: what programs written elsewhere bring along.

use crate::local::{LocalPublisher, LocalSubscriber};
use crate::shared::{RawPublisher, RawSubscriber};
use crate::{Bus, BusError, Time};
use fss_messages::topic::{Owner, Topic};
use fss_messages::{Definition, Header, Sample};
use iceoryx2::port::update_connections::UpdateConnections;

/// A topic as a program describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawTopic {
    /// ROS style name, without the vehicle's.
    pub name: String,
    /// Whose it is.
    pub owner: Owner,
    /// What its samples are.
    pub definition: Definition,
}

impl RawTopic {
    /// Of a topic that this program knows.
    pub fn of<T: Sample>(topic: Topic<T>) -> Self {
        Self { name: topic.name.to_owned(), owner: topic.owner, definition: Definition::of::<T>() }
    }
}

enum RawSource {
    /// A vehicle that there is not.
    Silent,
    Local(LocalSubscriber),
    Shared(RawSubscriber),
}

/// All samples of a topic that came since the last look, oldest first, as bytes.
pub struct RawBatch {
    source: RawSource,
    size: usize,
    bytes: Vec<u8>,
    newest: Option<Header>,
}

impl RawBatch {
    /// Opens it with room for `capacity` samples between two looks.
    ///
    /// # Errors
    /// Where the bus refuses.
    pub fn open(bus: &Bus, topic: &RawTopic, capacity: usize) -> Result<Self, BusError> {
        let size = topic.definition.size;
        let source = bus.open_raw(
            topic,
            RawSource::Silent,
            |local, name, kind| local.subscribe(name, kind, capacity).map(RawSource::Local),
            |shared, name, kind, readers| shared.subscribe_raw(name, kind, capacity, readers).map(RawSource::Shared),
        )?;
        Ok(Self { source, size, bytes: Vec::with_capacity(size * capacity), newest: None })
    }

    /// Takes what has come since the last look.
    pub fn refresh(&mut self) {
        self.bytes.clear();
        while self.bytes.len() + self.size <= self.bytes.capacity() && self.receive() {}
        self.newest = self.samples().last().and_then(Header::of_sample).or(self.newest);
    }

    fn receive(&mut self) -> bool {
        let bytes = &mut self.bytes;
        match &self.source {
            RawSource::Silent => false,
            RawSource::Local(subscriber) => subscriber.receive_bytes(|sample| bytes.extend_from_slice(sample)),
            // A connection that broke because the publisher died is no sample.
            RawSource::Shared(subscriber) => match subscriber.receive() {
                Ok(Some(sample)) => {
                    crate::shared::append(bytes, sample.payload());
                    true
                }
                _ => false,
            },
        }
    }

    /// Age of the newest sample by its stamp, ns; `u64::MAX` where nothing was ever received.
    pub fn age_ns(&self, now: Time) -> u64 {
        self.newest.map_or(u64::MAX, |header| now.age_ns(header.stamp_ns))
    }

    /// The samples that came.
    pub fn samples(&self) -> impl ExactSizeIterator<Item = &[u8]> {
        self.bytes.chunks_exact(self.size)
    }
}

enum RawSink {
    /// A vehicle that there is not.
    Silent,
    Local(LocalPublisher),
    Shared(RawPublisher),
}

/// Hands on samples of a topic as they are, header and all.
pub struct RawOutput {
    sink: RawSink,
    size: usize,
}

impl RawOutput {
    /// Opens it.
    ///
    /// # Errors
    /// Where the bus refuses.
    pub fn open(bus: &Bus, topic: &RawTopic) -> Result<Self, BusError> {
        let sink = bus.open_raw(
            topic,
            RawSink::Silent,
            |local, name, kind| local.publisher(name, kind).map(RawSink::Local),
            |shared, name, kind, readers| shared.publisher_raw(name, kind, readers).map(RawSink::Shared),
        )?;
        Ok(Self { sink, size: topic.definition.size })
    }

    /// Sends a sample; false where it could not be sent, or is not of the topic's size.
    pub fn relay(&self, sample: &[u8]) -> bool {
        match &self.sink {
            _ if sample.len() != self.size => false,
            RawSink::Silent => true,
            RawSink::Local(publisher) => {
                publisher.send(sample);
                true
            }
            RawSink::Shared(publisher) => crate::shared::send_bytes(publisher, sample),
        }
    }

    /// Lets go of readers that are gone, where nothing is sent: a publisher that seldom sends would keep the shared memory of every
    /// reader that died meanwhile.
    pub(crate) fn let_go(&self) {
        if let RawSink::Shared(publisher) = &self.sink {
            // What cannot be let go of now is let go of with the next step.
            let _ = publisher.update_connections();
        }
    }
}
