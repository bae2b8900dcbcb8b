//! Hears from the server's library that it had to drop messages itself.
//!
//! It does so where the gate could not take them in time, and says so through `tracing`, at most twice a minute; it does not
//! count them. This layer passes its word on to the service, for `/events`.

use crossbeam::queue::ArrayQueue;
use std::fmt::{Debug, Write};
use std::sync::LazyLock;
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::Context;

/// What the library says begins like this; then comes the viewer's address.
const WORDS: &str = "outbox for client ";

/// Addresses of such viewers that wait to be said: one program has one `tracing`, so it has one of these.
static OVERFLOWS: LazyLock<ArrayQueue<String>> = LazyLock::new(|| ArrayQueue::new(16));

/// The layer; whoever sets up `tracing` adds it.
pub fn overflow_layer<S>() -> impl Layer<S>
where
    S: Subscriber + for<'a> tracing_subscriber::registry::LookupSpan<'a>,
{
    Overflow.with_filter(Targets::new().with_target("foxglove", Level::INFO))
}

/// The next viewer for whom messages were lost.
pub(crate) fn next_overflow() -> Option<String> {
    OVERFLOWS.pop()
}

struct Overflow;

impl<S: Subscriber> Layer<S> for Overflow {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        let mut message = Message(String::new());
        event.record(&mut message);
        if let Some(viewer) = message.0.strip_prefix(WORDS).and_then(|rest| rest.split_whitespace().next()) {
            OVERFLOWS.force_push(viewer.to_owned());
        }
    }
}

/// The text of an event.
struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        if field.name() == "message" {
            // Writing to memory does not fail.
            let _ = write!(self.0, "{value:?}");
        }
    }
}
