//! Ports: what a service sees of topics and devices.

use crate::local::{LocalPublisher, LocalSubscriber};
use crate::shared::SharedSample;
use crate::{Bus, BusError, Queue, Time};
use fss_messages::topic::Topic;
use fss_messages::{Header, Sample};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::ipc;

/// Where samples come from.
pub(crate) enum Source<T: Sample> {
    /// A vehicle that there is not.
    Silent,
    Local(LocalSubscriber),
    Shared(Subscriber<ipc::Service, T, ()>),
}

/// A sample in hand: its own copy, or borrowed from shared memory.
enum Held<T: Sample> {
    Own(T),
    Borrowed(SharedSample<T>),
}

impl<T: Sample> Held<T> {
    fn get(&self) -> &T {
        match self {
            Self::Own(sample) => sample,
            Self::Borrowed(sample) => sample.payload(),
        }
    }
}

impl<T: Sample> Source<T> {
    fn receive(&self) -> Option<Held<T>> {
        match self {
            Self::Silent => None,
            Self::Local(subscriber) => subscriber.receive().map(Held::Own),
            // A connection that broke because the publisher died is no sample; age tells the service.
            Self::Shared(subscriber) => subscriber.receive().ok().flatten().map(Held::Borrowed),
        }
    }
}

/// Where samples go to.
pub(crate) enum Sink<T: Sample> {
    /// A vehicle that there is not.
    Silent,
    Local(LocalPublisher),
    Shared(Publisher<ipc::Service, T, ()>),
}

impl<T: Sample> Sink<T> {
    /// Whether it was sent.
    fn send(&self, sample: &T) -> bool {
        match self {
            Self::Silent => true,
            Self::Local(publisher) => {
                publisher.send(sample.as_bytes());
                true
            }
            Self::Shared(publisher) => match publisher.loan_uninit() {
                Ok(loan) => loan.write_payload(*sample).send().is_ok(),
                Err(_) => false,
            },
        }
    }

    /// Lets go of readers that are gone. With a sample that goes without saying; a publisher that seldom sends would keep
    /// the shared memory of every reader that died meanwhile.
    fn let_go(&self) {
        if let Self::Shared(publisher) = self {
            // What cannot be let go of now is let go of with the next step.
            let _ = publisher.update_connections();
        }
    }
}

/// What a port had for a step, as the step's record names it ([`Step`](fss_messages::Step)).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Taken {
    /// Sequence of the newest sample, 0 for none; of a device, how many messages came.
    pub input: u64,
    /// How many samples came since the step before, at most 255; of a port that keeps the newest only and of a device, 1 where
    /// something came.
    pub fresh: u8,
}

/// Is shown what each port of a service stands for.
pub trait PortVisitor {
    /// A port of a topic.
    fn topic<T: Sample>(&mut self, topic: Topic<T>);
    /// A port of the device queue of this name.
    fn device(&mut self, queue: &'static str);
}

/// An input of a service: a topic or a device.
pub trait InputPort: Sized {
    /// What names it: a topic, or a device queue's name.
    type Address;
    /// Opens it.
    ///
    /// # Errors
    /// Where the bus refuses.
    fn open(bus: &Bus, address: Self::Address) -> Result<Self, BusError>;
    /// Takes what has come since the last step.
    fn refresh(&mut self);
    /// Age of the newest sample by its stamp, ns; `u64::MAX` where nothing was ever received.
    fn age_ns(&self, now: Time) -> u64;
    /// What the last [`Self::refresh`] left in hand.
    fn taken(&self) -> Taken;
    /// Shows what it stands for.
    fn visit(address: Self::Address, visitor: &mut impl PortVisitor);
}

/// The newest sample of a topic; it stays until a newer one comes, so look at its age.
pub struct Latest<T: Sample> {
    source: Source<T>,
    held: Option<Held<T>>,
    fresh: bool,
}

impl<T: Sample> Latest<T> {
    /// The newest sample, however old.
    pub fn get(&self) -> Option<&T> {
        self.held.as_ref().map(Held::get)
    }

    /// The newest sample if it is not older than `max_age_ns` by its stamp.
    pub fn within(&self, now: Time, max_age_ns: u64) -> Option<&T> {
        self.get().filter(|sample| now.age_ns(sample.header().stamp_ns) <= max_age_ns)
    }

    /// The newest sample if it came since the last step.
    pub fn fresh(&self) -> Option<&T> {
        if self.fresh { self.get() } else { None }
    }
}

impl<T: Sample> InputPort for Latest<T> {
    type Address = Topic<T>;

    fn open(bus: &Bus, topic: Topic<T>) -> Result<Self, BusError> {
        // A buffer of one overflows to the newest sample, so that one look is enough.
        Ok(Self { source: bus.source(topic, 1)?, held: None, fresh: false })
    }

    fn refresh(&mut self) {
        let newest = self.source.receive();
        self.fresh = newest.is_some();
        if self.fresh {
            self.held = newest;
        }
    }

    fn age_ns(&self, now: Time) -> u64 {
        self.get().map_or(u64::MAX, |sample| now.age_ns(sample.header().stamp_ns))
    }

    fn taken(&self) -> Taken {
        Taken { input: self.get().map_or(0, |sample| sample.header().sequence), fresh: u8::from(self.fresh) }
    }

    fn visit(topic: Topic<T>, visitor: &mut impl PortVisitor) {
        visitor.topic(topic);
    }
}

/// All samples of a topic that came since the last step, oldest first.
pub struct Batch<T: Sample> {
    source: Source<T>,
    samples: Vec<T>,
    /// Header of the newest sample, zeros where there was none.
    newest: Header,
}

impl<T: Sample> Batch<T> {
    /// How many samples the buffer holds between two steps.
    pub const CAPACITY: usize = crate::shared::MAX_BUFFER;

    /// The samples that came since the last step.
    pub fn samples(&self) -> &[T] {
        &self.samples
    }
}

impl<T: Sample> InputPort for Batch<T> {
    type Address = Topic<T>;

    fn open(bus: &Bus, topic: Topic<T>) -> Result<Self, BusError> {
        let samples = Vec::with_capacity(Self::CAPACITY);
        Ok(Self { source: bus.source(topic, Self::CAPACITY)?, samples, newest: Header::default() })
    }

    fn refresh(&mut self) {
        self.samples.clear();
        while self.samples.len() < Self::CAPACITY
            && let Some(sample) = self.source.receive()
        {
            self.samples.push(*sample.get());
        }
        self.newest = self.samples.last().map_or(self.newest, Sample::header);
    }

    fn age_ns(&self, now: Time) -> u64 {
        if self.newest.sequence == 0 { u64::MAX } else { now.age_ns(self.newest.stamp_ns) }
    }

    fn taken(&self) -> Taken {
        Taken { input: self.newest.sequence, fresh: u8::try_from(self.samples.len()).unwrap_or(u8::MAX) }
    }

    fn visit(topic: Topic<T>, visitor: &mut impl PortVisitor) {
        visitor.topic(topic);
    }
}

/// Messages from a device's thread that came since the last step, oldest first.
pub struct Feed<T: Send + 'static> {
    queue: Queue<T>,
    messages: Vec<T>,
}

impl<T: Send + 'static> Feed<T> {
    /// How many messages may wait between two steps.
    pub const CAPACITY: usize = 64;

    /// The messages that came since the last step.
    pub fn messages(&self) -> &[T] {
        &self.messages
    }
}

impl<T: Send + 'static> InputPort for Feed<T> {
    type Address = &'static str;

    fn open(bus: &Bus, name: &'static str) -> Result<Self, BusError> {
        Ok(Self { queue: bus.queue(name, Self::CAPACITY)?, messages: Vec::with_capacity(Self::CAPACITY) })
    }

    fn refresh(&mut self) {
        self.messages.clear();
        while self.messages.len() < Self::CAPACITY
            && let Some(message) = self.queue.pop()
        {
            self.messages.push(message);
        }
    }

    fn age_ns(&self, _now: Time) -> u64 {
        0
    }

    fn taken(&self) -> Taken {
        Taken { input: self.messages.len() as u64, fresh: u8::from(!self.messages.is_empty()) }
    }

    fn visit(name: &'static str, visitor: &mut impl PortVisitor) {
        visitor.device(name);
    }
}

/// An output of a service: a topic or a device.
pub trait OutputPort: Sized {
    /// What names it: a topic, or a device queue's name.
    type Address;
    /// Opens it.
    ///
    /// # Errors
    /// Where the bus refuses.
    fn open(bus: &Bus, address: Self::Address) -> Result<Self, BusError>;
    /// Sends what the step has published; returns how many samples could not be sent.
    fn flush(&mut self, now: Time) -> u64;
    /// Shows what it stands for; nothing where that is neither a topic nor a device.
    fn visit(_address: Self::Address, _visitor: &mut impl PortVisitor) {}
}

/// Publishes to a topic. What a step publishes is sent when the step has ended.
pub struct Output<T: Sample> {
    sink: Sink<T>,
    staged: Vec<T>,
    sequence: u64,
    dropped: u64,
}

impl<T: Sample> Output<T> {
    /// How many samples one step may publish.
    pub const CAPACITY: usize = 64;

    /// Publishes a sample; the port sets its sequence and time of publication, the caller its stamp.
    pub fn publish(&mut self, sample: T) {
        if self.staged.len() < Self::CAPACITY {
            self.staged.push(sample);
        } else {
            self.dropped += 1;
        }
    }

    /// Sends a sample as it is, header and all: one that another publisher has published before. Returns whether it was
    /// sent.
    pub fn relay(&self, sample: &T) -> bool {
        self.sink.send(sample)
    }

    /// What this step has published so far.
    pub fn staged(&self) -> &[T] {
        &self.staged
    }
}

impl<T: Sample> OutputPort for Output<T> {
    type Address = Topic<T>;

    fn open(bus: &Bus, topic: Topic<T>) -> Result<Self, BusError> {
        Ok(Self { sink: bus.sink(topic)?, staged: Vec::with_capacity(Self::CAPACITY), sequence: 0, dropped: 0 })
    }

    fn flush(&mut self, now: Time) -> u64 {
        let mut dropped = std::mem::take(&mut self.dropped);
        if self.staged.is_empty() {
            self.sink.let_go();
        }
        for sample in &mut self.staged {
            self.sequence += 1;
            let stamp_ns = sample.header().stamp_ns;
            sample.set_header(Header { sequence: self.sequence, stamp_ns, published_ns: now.ns() });
            dropped += u64::from(!self.sink.send(sample));
        }
        self.staged.clear();
        dropped
    }

    fn visit(topic: Topic<T>, visitor: &mut impl PortVisitor) {
        visitor.topic(topic);
    }
}

/// Messages to a device's thread.
pub struct DeviceOutput<T: Send + 'static> {
    queue: Queue<T>,
    dropped: u64,
}

impl<T: Send + 'static> DeviceOutput<T> {
    /// Hands the message to the device's thread; a full queue loses its oldest message.
    pub fn send(&mut self, message: T) {
        self.dropped += u64::from(self.queue.force_push(message).is_some());
    }
}

impl<T: Send + 'static> OutputPort for DeviceOutput<T> {
    type Address = &'static str;

    fn open(bus: &Bus, name: &'static str) -> Result<Self, BusError> {
        Ok(Self { queue: bus.queue(name, Feed::<T>::CAPACITY)?, dropped: 0 })
    }

    fn flush(&mut self, _now: Time) -> u64 {
        std::mem::take(&mut self.dropped)
    }

    fn visit(name: &'static str, visitor: &mut impl PortVisitor) {
        visitor.device(name);
    }
}
