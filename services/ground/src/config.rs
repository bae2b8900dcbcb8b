//! Where to listen, and why there may be no view.

use std::io;
use std::net::SocketAddr;

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
    /// Whoever reaches the address could command.
    #[error("commands are taken from this computer alone, and {0} is reached from others")]
    Exposed(SocketAddr),
}
