//! The launch file's `[devices]`: where the devices are.

use super::Mocap;
use serde::Deserialize;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Where the devices are: the addresses at which services, or the simulated laboratory, find each other.
///
/// A path that is not absolute is taken from the folder of the run.
#[derive(Clone, Debug, Deserialize)]
#[serde(try_from = "Written")]
pub struct Devices {
    /// Motion capture.
    pub mocap: Mocap,
    /// The gyro's serial port.
    pub gyro: PathBuf,
    /// The valve line: a Unix socket of the simulated laboratory, or a GPIO chip where `valve_lines` is given.
    pub valves: PathBuf,
    /// The lines of the GPIO chip, thruster 1 first.
    pub valve_lines: Option<Vec<u32>>,
    /// UDP address from which `links` speaks.
    pub links_local: SocketAddr,
    /// UDP address of each link, joint 1 first.
    pub links: Vec<SocketAddr>,
    /// File with the key that authenticates commands to the links; without it a key is made for the run.
    pub link_key: Option<PathBuf>,
}

/// As the table is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    mocap: Option<Mocap>,
    /// Short for `mocap = { kind = "vicon", listen = ... }`, as launch files of version 0.2 have it.
    vicon: Option<SocketAddr>,
    gyro: PathBuf,
    valves: PathBuf,
    valve_lines: Option<Vec<u32>>,
    links_local: SocketAddr,
    links: Vec<SocketAddr>,
    link_key: Option<PathBuf>,
}

impl TryFrom<Written> for Devices {
    type Error = String;

    fn try_from(written: Written) -> Result<Self, String> {
        let Written { mocap, vicon, gyro, valves, valve_lines, links_local, links, link_key } = written;
        let mocap = match (mocap, vicon) {
            (Some(mocap), None) => mocap,
            (None, Some(listen)) => Mocap::vicon(listen),
            (Some(_), Some(_)) => return Err("[devices] has both mocap and vicon; remove one of the two".to_owned()),
            (None, None) => return Err("[devices.mocap] is missing: whose motion capture it is, and where".to_owned()),
        };
        if let Some(fault) = mocap.fault() {
            return Err(format!("[devices.mocap]: {fault}"));
        }
        Ok(Self { mocap, gyro, valves, valve_lines, links_local, links, link_key })
    }
}
