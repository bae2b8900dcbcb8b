//! Every topic as a channel, raw.

use crate::channels::{Channel, Channels};
use crate::topics::AllTopics;
use crate::viewers::Viewers;
use fss_bus::Bus;
use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{CDR_HEADER, PACKAGE, Sample};

/// The topics' channels, in the order of [`AllTopics::iter`].
pub(crate) struct Downlink {
    channels: Vec<Channel>,
    record: Vec<u8>,
}

impl Downlink {
    /// Announces every topic.
    pub(crate) fn new(channels: &mut Channels, bus: &Bus) -> Self {
        let mut announcer = Announcer { channels, bus, topics: Vec::new() };
        topic::visit(&mut announcer);
        let mut topics = announcer.topics;
        for topic in bus.program_topics() {
            let (name, definition) = (bus.full_name(&topic.name), &topic.definition);
            topics.push(channels.ros(&name, &definition.schema(), &definition.text));
        }
        Self { channels: topics, record: Vec::with_capacity(4096) }
    }

    /// Sends what came since the last step to those who asked for it.
    pub(crate) fn send(&mut self, inputs: &AllTopics, viewers: &Viewers) {
        for (channel, input) in
            self.channels.iter().zip(inputs.iter()).filter(|(channel, _)| viewers.is_wanted(**channel))
        {
            input.for_each(&mut |header, sample| {
                self.record.clear();
                self.record.extend_from_slice(&CDR_HEADER);
                self.record.extend_from_slice(sample);
                viewers.send(*channel, header.published_ns, &self.record);
            });
        }
    }
}

struct Announcer<'a> {
    channels: &'a mut Channels,
    bus: &'a Bus,
    topics: Vec<Channel>,
}

impl TopicVisitor for Announcer<'_> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        let (name, message) = (self.bus.full_name(topic.name), format!("{PACKAGE}/msg/{}", T::NAME));
        self.topics.push(self.channels.ros(&name, &message, &T::definition()));
    }
}
