//! What a running stack's topics are, for those who read them in shared memory.

use crate::error::from_report;
use crate::log::{FieldTuple, fields};
use fss_messages::topic::{self, Topic, TopicVisitor};
use fss_messages::{Definition, Sample};
use fss_report::top;
use pyo3::prelude::*;

/// Topic, name of its type in shared memory, bytes of a sample, fields.
type LiveTopic = (String, String, usize, Vec<FieldTuple>);

struct Topics(Vec<LiveTopic>);

impl TopicVisitor for Topics {
    fn visit<T: Sample>(&mut self, topic: Topic<T>, _: &'static str) {
        let definition = Definition::of::<T>();
        self.0.push((topic.name.to_owned(), definition.type_name(), definition.size, fields(&definition.fields)));
    }
}

/// Every topic that this build knows.
#[pyfunction]
pub(crate) fn live_topics() -> Vec<LiveTopic> {
    let mut topics = Topics(Vec::new());
    topic::visit(&mut topics);
    topics.0
}

/// Prefix of the one stack that runs on this computer.
#[pyfunction]
pub(crate) fn running_stack(py: Python<'_>) -> PyResult<String> {
    py.detach(top::only_stack).map_err(|report| from_report(&report))
}
