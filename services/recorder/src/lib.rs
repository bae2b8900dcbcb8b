//! Records every topic to MCAP.
//!
//! The recorder takes what its deep buffers hold since its last step and writes it down. A sample that it lost (its
//! buffer overflowed because the disk or the host stalled) shows as a gap in the publisher's sequence; it counts them
//! per topic and says so in `/events`.

use fss_bus::{Batch, Bus, BusError, InputPort, InputPorts, Output, Service, Time, outputs};
use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{Event, Sample, text};
use fss_records::log::{LogError, LogWriter, Recorded};

/// All topics, as they are recorded.
pub struct AllTopics {
    topics: Vec<Box<dyn TopicInput>>,
}

/// One topic whatever its sample.
trait TopicInput {
    fn refresh(&mut self);
    fn age_ns(&self, now: Time) -> u64;
    fn add_to(&self, log: &mut LogWriter) -> Result<Recorded, LogError>;
    fn write_to(&self, log: &mut LogWriter, topic: Recorded) -> Result<(), LogError>;
    /// The name, and by how many samples the batch's sequences jump.
    fn count_gaps(&self, last: &mut u64) -> (&'static str, u64);
    /// Whether several services publish on it, so that sequences interleave.
    fn is_shared(&self) -> bool;
}

struct Input<T: Sample> {
    topic: Topic<T>,
    vehicle_topic: String,
    batch: Batch<T>,
}

impl<T: Sample> TopicInput for Input<T> {
    fn refresh(&mut self) {
        self.batch.refresh();
    }

    fn age_ns(&self, now: Time) -> u64 {
        self.batch.age_ns(now)
    }

    fn add_to(&self, log: &mut LogWriter) -> Result<Recorded, LogError> {
        log.add_topic::<T>(&self.vehicle_topic)
    }

    fn write_to(&self, log: &mut LogWriter, topic: Recorded) -> Result<(), LogError> {
        self.batch.samples().iter().try_for_each(|sample| log.write(topic, sample))
    }

    fn count_gaps(&self, last: &mut u64) -> (&'static str, u64) {
        let mut lost = 0;
        for sample in self.batch.samples() {
            let sequence = sample.header().sequence;
            // A smaller sequence is a restarted publisher, not a loss.
            if *last != 0 && sequence > *last {
                lost += sequence - *last - 1;
            }
            *last = sequence;
        }
        (self.topic.name, lost)
    }

    fn is_shared(&self) -> bool {
        self.topic.name == topic::EVENTS.name || self.topic.name == topic::HEALTH.name
    }
}

struct Opener<'a> {
    bus: &'a Bus,
    opened: Result<Vec<Box<dyn TopicInput>>, BusError>,
}

impl TopicVisitor for Opener<'_> {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _doc: &'static str) {
        let Ok(inputs) = &mut self.opened else { return };
        match Batch::open(self.bus, topic) {
            Ok(batch) => {
                let vehicle_topic = self.bus.full_name(topic.name);
                inputs.push(Box::new(Input { topic, vehicle_topic, batch }));
            }
            Err(e) => self.opened = Err(e),
        }
    }
}

impl InputPorts for AllTopics {
    const NAMES: &'static [&'static str] = topic::NAMES;

    fn open(bus: &Bus) -> Result<Self, BusError> {
        let mut opener = Opener { bus, opened: Ok(Vec::new()) };
        topic::visit(&mut opener);
        Ok(Self { topics: opener.opened? })
    }

    fn refresh(&mut self) {
        for topic in &mut self.topics {
            topic.refresh();
        }
    }

    fn ages_ns(&self, now: Time, ages: &mut [u64]) {
        for (slot, topic) in ages.iter_mut().zip(&self.topics) {
            *slot = topic.age_ns(now);
        }
    }
}

outputs! {
    /// What the recorder says.
    pub struct Outputs {
        /// Losses and failures.
        events: Output<Event> = topic::EVENTS,
    }
}

/// What the recorder has written of one topic.
#[derive(Clone, Copy, Default)]
struct Written {
    channel: Option<Recorded>,
    last_sequence: u64,
    lost: u64,
}

/// The recorder.
pub struct Recorder {
    log: Option<LogWriter>,
    written: Vec<Written>,
    failure: Option<LogError>,
}

impl Recorder {
    /// Records into `log`.
    pub fn new(log: LogWriter) -> Self {
        Self { log: Some(log), written: vec![Written::default(); topic::NAMES.len()], failure: None }
    }

    /// Samples lost since the start, all topics together.
    pub fn lost(&self) -> u64 {
        self.written.iter().map(|w| w.lost).sum()
    }

    /// Ends the log.
    ///
    /// # Errors
    /// The first failure to write, or a failure to end the file.
    pub fn finish(mut self) -> Result<(), LogError> {
        match (self.failure.take(), self.log.take()) {
            (Some(failure), _) => Err(failure),
            (None, Some(log)) => log.finish(),
            (None, None) => Ok(()),
        }
    }

    fn record(&mut self, inputs: &AllTopics, log: &mut LogWriter) -> Result<u64, LogError> {
        let mut lost_now = 0;
        for (input, written) in inputs.topics.iter().zip(&mut self.written) {
            let channel = match written.channel {
                Some(channel) => channel,
                None => *written.channel.insert(input.add_to(log)?),
            };
            input.write_to(log, channel)?;
            if !input.is_shared() {
                let (_, lost) = input.count_gaps(&mut written.last_sequence);
                written.lost += lost;
                lost_now += lost;
            }
        }
        Ok(lost_now)
    }
}

impl Service for Recorder {
    type Inputs = AllTopics;
    type Outputs = Outputs;
    const NAME: &'static str = "recorder";

    fn step(&mut self, now: Time, inputs: &AllTopics, outputs: &mut Outputs) {
        let Some(mut log) = self.log.take() else { return };
        let mut say = |severity: u8, message: &str| {
            let (service, text) = (text(Self::NAME), text(message));
            outputs.events.publish(Event { stamp_ns: now.ns(), severity, service, text, ..Event::default() });
        };
        match self.record(inputs, &mut log) {
            Ok(lost) => {
                if lost > 0 {
                    say(Event::WARNING, &format!("{lost} samples lost ({} since the start)", self.lost()));
                }
                self.log = Some(log);
            }
            Err(failure) => {
                say(Event::ERROR, &format!("recording ends: {failure}"));
                self.failure = Some(failure);
            }
        }
    }
}
