//! What can go wrong with the bus.

/// Why a port could not be opened or a loop not be run.
#[derive(Debug, thiserror::Error)]
pub enum BusError {
    /// Shared memory refused a node.
    #[error("cannot join the shared-memory bus as '{node}': {reason}")]
    Node {
        /// The node's name.
        node: String,
        /// What iceoryx2 said.
        reason: String,
    },
    /// A topic could not be opened, mostly because another build with another layout of its sample runs.
    #[error("cannot open topic '{topic}' ({sample}): {reason}; do all processes of the stack come from one build?")]
    Topic {
        /// The topic's full name.
        topic: String,
        /// The sample's name.
        sample: String,
        /// What iceoryx2 said.
        reason: String,
    },
    /// A topic has all the readers that it may have.
    #[error(
        "topic '{0}' has all the readers that it may have; give the launch file [shared_memory] readers = N with a larger N"
    )]
    Readers(String),
    /// A service that is a program of its own does not step.
    #[error("service '{service}' on the virtual clock: {reason}")]
    Lockstep {
        /// The service.
        service: String,
        /// Why not.
        reason: String,
    },
    /// One device queue was opened with two types.
    #[error("the device queue '{0}' is opened with two different message types")]
    Queue(String),
    /// The latency histograms could not be made.
    #[error("cannot make the latency histograms: {0}")]
    Histogram(#[from] hdrhistogram::CreationError),
    /// The operating system refused something that the loop cannot do without.
    #[error("{what}: {source}")]
    System {
        /// What was tried.
        what: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
}
