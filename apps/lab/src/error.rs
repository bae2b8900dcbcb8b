//! What can go wrong with a laboratory.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Why a laboratory cannot be set up or go on.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    /// The configuration contradicts itself or the plant.
    #[error("laboratory: {what}")]
    Config {
        /// What is wrong, with the value.
        what: String,
    },
    /// The plant cannot be simulated.
    #[error("laboratory: {0}")]
    Plant(#[from] fss_multibody::ModelError),
    /// A UDP address cannot be had.
    #[error("laboratory: {what} cannot use UDP {address}: {source}{}", hint(source))]
    Udp {
        /// The device.
        what: String,
        /// The address.
        address: SocketAddr,
        /// The system's word.
        source: io::Error,
    },
    /// A path cannot be used.
    #[error("laboratory: {what} at {}: {source}{}", path.display(), hint(source))]
    Path {
        /// What was to be done.
        what: &'static str,
        /// The path.
        path: PathBuf,
        /// The system's word.
        source: io::Error,
    },
    /// A pseudo-terminal for the gyro cannot be had.
    #[error("laboratory: the gyro's pseudo-terminal: {what}: {source}")]
    Terminal {
        /// What was to be done.
        what: &'static str,
        /// The system's word.
        source: io::Error,
    },
    /// The lines cannot be watched.
    #[error("laboratory: its lines cannot be watched: {0}")]
    Watch(io::Error),
    /// The bus cannot give the time.
    #[error(transparent)]
    Bus(#[from] fss_bus::BusError),
}

/// What to do about it, where that is known.
fn hint(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::AddrInUse => {
            " (another laboratory is running, or another program has it: stop that, or choose another)"
        }
        io::ErrorKind::AddrNotAvailable => " (no interface of this computer has this address)",
        io::ErrorKind::NotFound => " (its folder does not exist)",
        io::ErrorKind::PermissionDenied => " (this user may not)",
        _ => "",
    }
}
