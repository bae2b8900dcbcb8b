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
        self.0.push(described(topic.name, &Definition::of::<T>()));
    }
}

fn described(name: &str, definition: &Definition) -> LiveTopic {
    (name.to_owned(), definition.type_name(), definition.size, fields(&definition.fields))
}

/// Every topic of a running stack: those that this build knows, and those of the stack's own services.
#[pyfunction]
pub(crate) fn live_topics(py: Python<'_>, bus: &str) -> PyResult<Vec<LiveTopic>> {
    let mut topics = Topics(Vec::new());
    topic::visit(&mut topics);
    let guests = py.detach(|| top::guests(bus)).map_err(|report| from_report(&report))?;
    Ok(topics.0.into_iter().chain(guests.iter().map(|topic| described(&topic.name, &topic.definition))).collect())
}

/// Prefix of the one stack that runs on this computer.
#[pyfunction]
pub(crate) fn running_stack(py: Python<'_>) -> PyResult<String> {
    py.detach(top::only_stack).map_err(|report| from_report(&report))
}
