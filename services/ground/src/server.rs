//! The server of the library, behind the gate.

use crate::gate::{Gate, hidden_address};
use crate::overflow;
use crate::uplink::Uplink;
use crossbeam::queue::ArrayQueue;
use foxglove::websocket::{Parameter, ServerListener};
use foxglove::{Context, FoxgloveError, WebSocketServer, WebSocketServerHandle};
use fss_bus::{Bus, Queue};
use fss_messages::Event;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

/// Messages that wait for the gate, for each client; the gate takes them at once.
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
    /// Origins of the pages that a browser may show it to, beside pages of the viewer's own computer.
    pub origins: Vec<String>,
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
        source: io::Error,
    },
    /// The library's server does not start.
    #[error("the server does not start: {0}")]
    Server(FoxgloveError),
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
    gate: Gate,
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
        let hidden = hidden_address();
        let handle = WebSocketServer::new()
            .context(context)
            .name(&config.name)
            .bind(hidden.to_string(), 0)
            .message_backlog_size(BACKLOG)
            .parameter_handler(uplink.parameter_handler())
            .services(uplink.services(bus))
            .listener(Arc::new(Doorkeeper(words.clone())))
            .start_blocking()
            .map_err(GroundError::Server)?;
        let gate = Gate::open(config.listen, (hidden, handle.port()).into(), config.origins.clone())
            .map_err(|source| GroundError::Listen { address: config.listen, source })?;
        Ok(Self { handle, gate, words, _context: context.clone() })
    }

    pub(crate) fn port(&self) -> u16 {
        self.gate.port()
    }

    /// What is answered from now on to those who ask for metrics.
    pub(crate) fn set_metrics(&self, text: String) {
        self.gate.set_metrics(text);
    }

    /// How many samples slow viewers have lost since this was asked last.
    pub(crate) fn lost(&self) -> u64 {
        self.gate.lost()
    }

    /// What is to be said of clients, one after another, and how grave it is.
    pub(crate) fn next_words(&self) -> Option<(u8, String)> {
        let come_or_gone = || self.words.pop().map(|words| (Event::INFO, words.to_owned()));
        let refused_or_slow = || self.gate.next_words().map(|words| (Event::WARNING, words));
        refused_or_slow().or_else(come_or_gone).or_else(|| self.next_overflow())
    }

    /// The gate was kept from taking what the library had for it.
    fn next_overflow(&self) -> Option<(u8, String)> {
        let known_as = overflow::next_overflow()?;
        let viewer = self.gate.viewer_at(&known_as).map_or(known_as, |viewer| viewer.to_string());
        let words = "this process has too little of the processor: messages are lost, uncounted";
        Some((Event::WARNING, format!("{words}, for the viewer at {viewer}")))
    }

    /// Tells those who asked for it of parameters that have changed.
    pub(crate) fn tell(&self, changed: Vec<Parameter>) {
        if !changed.is_empty() {
            self.handle.publish_parameter_values(changed);
        }
    }

    pub(crate) fn stop(self) {
        self.handle.stop().wait_blocking();
        self.gate.close();
    }
}
