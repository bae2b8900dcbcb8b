//! Every topic as a channel, raw.

use crate::GroundError;
use crate::topics::AllTopics;
use foxglove::{ChannelBuilder, Context, PartialMetadata, RawChannel, Schema};
use fss_bus::Bus;
use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{CDR_HEADER, PACKAGE, Sample};
use std::sync::Arc;

/// The topics' channels, in the order of [`AllTopics::iter`].
pub(crate) struct Downlink {
    channels: Vec<Arc<RawChannel>>,
    record: Vec<u8>,
}

impl Downlink {
    /// Announces every topic.
    pub(crate) fn new(context: &Arc<Context>, bus: &Bus) -> Result<Self, GroundError> {
        let mut announcer = Announcer { context, bus, channels: Ok(Vec::new()) };
        topic::visit(&mut announcer);
        let mut channels = announcer.channels?;
        for topic in bus.program_topics() {
            let (name, definition) = (bus.full_name(&topic.name), &topic.definition);
            channels.push(ros_channel(context, &name, &definition.schema(), definition.text.clone())?);
        }
        Ok(Self { channels, record: Vec::with_capacity(4096) })
    }

    /// Sends what came since the last step to those who asked for it.
    pub(crate) fn send(&mut self, inputs: &AllTopics) {
        for (channel, input) in self.channels.iter().zip(inputs.iter()).filter(|(channel, _)| channel.has_sinks()) {
            input.for_each(&mut |header, sample| {
                self.record.clear();
                self.record.extend_from_slice(&CDR_HEADER);
                self.record.extend_from_slice(sample);
                channel.log_with_meta(&self.record, at(header.published_ns));
            });
        }
    }
}

/// The time that a message is logged with: as in the log, of publication, on the monotonic clock.
pub(crate) fn at(time_ns: u64) -> PartialMetadata {
    PartialMetadata { log_time: Some(time_ns) }
}

/// A channel of ROS 2 messages.
pub(crate) fn ros_channel(
    context: &Arc<Context>,
    topic: &str,
    message: &str,
    definition: String,
) -> Result<Arc<RawChannel>, GroundError> {
    let schema = Schema::new(message, "ros2msg", definition.into_bytes());
    Ok(ChannelBuilder::new(topic).context(context).message_encoding("cdr").schema(schema).build_raw()?)
}

struct Announcer<'a> {
    context: &'a Arc<Context>,
    bus: &'a Bus,
    channels: Result<Vec<Arc<RawChannel>>, GroundError>,
}

impl TopicVisitor for Announcer<'_> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        let Ok(channels) = &mut self.channels else { return };
        let (name, message) = (self.bus.full_name(topic.name), format!("{PACKAGE}/msg/{}", T::NAME));
        match ros_channel(self.context, &name, &message, T::definition()) {
            Ok(channel) => channels.push(channel),
            Err(e) => self.channels = Err(e),
        }
    }
}
