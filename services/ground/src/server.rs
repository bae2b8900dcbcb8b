//! The listening end.

use crate::uplink::Uplink;
use crossbeam::queue::ArrayQueue;
use foxglove::websocket::{Parameter, ServerListener};
use foxglove::{Context, FoxgloveError, WebSocketServer, WebSocketServerHandle};
use fss_bus::{Bus, Queue};
use std::net::SocketAddr;
use std::sync::Arc;

/// Messages that wait for one client; when there are more, its oldest are dropped.
const BACKLOG: usize = 2048;
/// Words about clients that wait to be said.
const WORDS: usize = 64;

/// Where to listen, and as what.
#[derive(Clone, Debug)]
pub struct GroundConfig {
    /// The address.
    pub listen: SocketAddr,
    /// What viewers show as the name of the source.
    pub name: String,
    /// Whether viewers may tune and command; only where `listen` is on the loopback, for the protocol knows no key.
    pub commands: bool,
}

/// Why there is no view.
#[derive(Debug, thiserror::Error)]
pub enum GroundError {
    /// The address is taken, or is not this computer's.
    #[error("cannot listen at {address}: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        source: FoxgloveError,
    },
    /// Whoever reaches the address could command.
    #[error("commands are taken from this computer alone, and {0} is reached from others")]
    Exposed(SocketAddr),
    /// A channel is refused.
    #[error("a channel is refused: {0}")]
    Channel(#[from] FoxgloveError),
}

/// Tells who comes and goes.
struct Doorkeeper(Queue<&'static str>);

impl ServerListener for Doorkeeper {
    fn on_client_connect(&self) {
        self.0.force_push("a viewer has come");
    }

    fn on_client_disconnect(&self) {
        self.0.force_push("a viewer has gone");
    }
}

/// The server.
pub(crate) struct Server {
    handle: WebSocketServerHandle,
    words: Queue<&'static str>,
    /// Joins channels and viewers for as long as it lives.
    _context: Arc<Context>,
}

impl Server {
    pub(crate) fn start(
        config: &GroundConfig,
        context: &Arc<Context>,
        uplink: &Uplink,
        bus: &Bus,
    ) -> Result<Self, GroundError> {
        if config.commands && !config.listen.ip().is_loopback() {
            return Err(GroundError::Exposed(config.listen));
        }
        let words = Arc::new(ArrayQueue::new(WORDS));
        let handle = WebSocketServer::new()
            .context(context)
            .name(&config.name)
            .bind(config.listen.ip().to_string(), config.listen.port())
            .message_backlog_size(BACKLOG)
            .parameter_handler(uplink.parameter_handler())
            .services(uplink.services(bus))
            .listener(Arc::new(Doorkeeper(words.clone())))
            .start_blocking()
            .map_err(|source| GroundError::Listen { address: config.listen, source })?;
        Ok(Self { handle, words, _context: context.clone() })
    }

    pub(crate) fn port(&self) -> u16 {
        self.handle.port()
    }

    /// What is to be said of clients, one after another.
    pub(crate) fn next_words(&self) -> Option<&'static str> {
        self.words.pop()
    }

    /// Tells those who asked for it of parameters that have changed.
    pub(crate) fn tell(&self, changed: Vec<Parameter>) {
        if !changed.is_empty() {
            self.handle.publish_parameter_values(changed);
        }
    }

    pub(crate) fn stop(self) {
        self.handle.stop().wait_blocking();
    }
}
