//! The launch file's `[devices.mocap]`: whose motion capture it is, and how it is set up.

use fss_wire::mocap::{Axes, BODIES, NAMES, Protocol, Tracker};
use fss_wire::natnet::{self, Version};
use fss_wire::vrpn;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4};

/// Where motion capture comes from, and how it is set up.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Mocap {
    /// VICON Tracker's UDP object stream.
    Vicon(Vicon),
    /// OptiTrack's NatNet.
    Natnet(Natnet),
    /// A VRPN server.
    Vrpn(Vrpn),
}

/// VICON Tracker's UDP object stream.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vicon {
    /// UDP address at which it arrives.
    pub listen: SocketAddr,
    /// What Tracker calls the bodies.
    #[serde(default)]
    pub names: Names,
}

/// OptiTrack's NatNet.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Natnet {
    /// The UDP address at which Motive answers, usually port 1510.
    pub server: SocketAddr,
    /// This computer's address on the cameras' network.
    #[serde(default = "loopback")]
    pub local: IpAddr,
    /// The group and port of multicast, Motive's own is 239.255.42.99:1511; absent: unicast.
    #[serde(default)]
    pub multicast: Option<SocketAddrV4>,
    /// Of the bit stream, until Motive has said which.
    #[serde(default = "newest", deserialize_with = "version")]
    pub version: Version,
    /// Streaming ids of the bodies.
    #[serde(default)]
    pub ids: Ids,
    /// The tracker's axes that point along the table's x, y and up.
    #[serde(default, deserialize_with = "axes")]
    pub axes: Axes,
    /// The tracker's unit of length.
    #[serde(default)]
    pub unit: Unit,
}

/// A VRPN server.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vrpn {
    /// Its address, usually port 3883.
    pub server: SocketAddr,
    /// How poses come.
    #[serde(default)]
    pub transport: Transport,
    /// The server's names of the bodies.
    #[serde(default)]
    pub names: Names,
    /// The tracker's axes that point along the table's x, y and up.
    #[serde(default, deserialize_with = "axes")]
    pub axes: Axes,
    /// The tracker's unit of length.
    #[serde(default)]
    pub unit: Unit,
}

/// How a VRPN server's poses come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Transport {
    /// All over one connection to the server.
    #[default]
    Tcp,
    /// By datagrams; the server calls back to arrange it.
    Udp,
}

/// What a tracker calls the bodies.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Names {
    base: String,
    end_effector: String,
    target: String,
}

impl Default for Names {
    fn default() -> Self {
        let [base, end_effector, target] = NAMES.map(str::to_owned);
        Self { base, end_effector, target }
    }
}

/// Streaming ids of the bodies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ids {
    base: u32,
    end_effector: u32,
    target: u32,
}

impl Default for Ids {
    fn default() -> Self {
        Self { base: 1, end_effector: 2, target: 3 }
    }
}

impl Ids {
    /// Base, end-effector, target.
    pub fn in_order(self) -> [u32; BODIES] {
        [self.base, self.end_effector, self.target]
    }
}

/// A unit of length.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
pub enum Unit {
    /// Metres.
    #[default]
    #[serde(rename = "m")]
    Metre,
    /// Millimetres.
    #[serde(rename = "mm")]
    Millimetre,
}

impl Unit {
    fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Millimetre => 1e-3,
        }
    }
}

fn loopback() -> IpAddr {
    Ipv4Addr::LOCALHOST.into()
}

fn newest() -> Version {
    Version::NEWEST
}

fn version<'de, D: Deserializer<'de>>(from: D) -> Result<Version, D::Error> {
    let text = String::deserialize(from)?;
    Version::parse(&text).ok_or_else(|| D::Error::custom(format!("'{text}' is no NatNet version: \"3.1\" or \"4.1\"")))
}

fn axes<'de, D: Deserializer<'de>>(from: D) -> Result<Axes, D::Error> {
    let names = <[String; 3]>::deserialize(from)?;
    Axes::parse(&names)
        .map_err(|e| D::Error::custom(format!("axes: {e}; those of cameras whose y is up: [\"x\", \"-z\", \"y\"]")))
}

impl Mocap {
    /// VICON Tracker with the names that fss gives the bodies.
    pub fn vicon(listen: SocketAddr) -> Self {
        Self::Vicon(Vicon { listen, names: Names::default() })
    }

    /// The tracker as it is set up, for those who speak or hear its protocol.
    pub fn tracker(&self) -> Tracker {
        let names = |n: &Names| [n.base.clone(), n.end_effector.clone(), n.target.clone()];
        match self {
            Self::Vicon(vicon) => Tracker { names: names(&vicon.names), ..Tracker::default() },
            Self::Natnet(natnet) => {
                let protocol = Protocol::Natnet { version: natnet.version, ids: natnet.ids.in_order() };
                Tracker { protocol, names: names(&Names::default()), axes: natnet.axes, unit_m: natnet.unit.metres() }
            }
            Self::Vrpn(vrpn) => Tracker {
                protocol: Protocol::Vrpn,
                names: names(&vrpn.names),
                axes: vrpn.axes,
                unit_m: vrpn.unit.metres(),
            },
        }
    }

    /// What makes no sense, if anything.
    pub(super) fn fault(&self) -> Option<String> {
        let names = self.tracker().names;
        let is_double = (0..BODIES).any(|i| names[..i].contains(&names[i]));
        match self {
            _ if is_double => Some("two bodies have one name".to_owned()),
            Self::Vicon(vicon) => {
                let long = |name: &&String| name.len() > fss_wire::vicon::NAME_LEN;
                [&vicon.names.base, &vicon.names.end_effector, &vicon.names.target]
                    .into_iter()
                    .find(long)
                    .map(|name| format!("'{name}' is longer than Tracker's {} bytes", fss_wire::vicon::NAME_LEN))
            }
            Self::Natnet(natnet) => {
                let Ids { base, end_effector, target } = natnet.ids;
                match natnet.multicast {
                    _ if base == end_effector || base == target || end_effector == target => {
                        Some("two bodies have one streaming id".to_owned())
                    }
                    Some(group) if !group.ip().is_multicast() => Some(format!(
                        "{} is no multicast group; Motive's own is {}:{}",
                        group.ip(),
                        Ipv4Addr::from(natnet::MULTICAST_GROUP),
                        natnet::DATA_PORT
                    )),
                    _ => None,
                }
            }
            Self::Vrpn(vrpn) => {
                (vrpn.server.port() == 0).then(|| format!("a VRPN server has a port, usually {}", vrpn::PORT))
            }
        }
    }
}

impl fmt::Display for Mocap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Vicon(vicon) => write!(f, "VICON at {}", vicon.listen),
            Self::Natnet(natnet) => write!(f, "NatNet from {}, as {}", natnet.server, natnet.local),
            Self::Vrpn(vrpn) => write!(f, "VRPN from {}", vrpn.server),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::launch::Launch;

    const LAB: &str = include_str!("../../../../deploy/etc/launch/lab.toml");
    const VICON: &str = "{ kind = \"vicon\", listen = \"127.0.0.1:51001\" }";

    fn with(mocap: &str) -> Result<Mocap, String> {
        let text = LAB.replace(VICON, mocap);
        assert_ne!(text, LAB);
        Launch::of_run(&text).map(|launch| launch.devices.mocap).map_err(|e| e.message)
    }

    #[test]
    fn the_launch_files_that_come_with_fss_name_their_motion_capture() {
        for text in [
            LAB,
            include_str!("../../../../deploy/etc/launch/vehicle.toml"),
            include_str!("../../../../deploy/etc/launch/chaser.toml"),
            include_str!("../../../../deploy/etc/launch/target.toml"),
        ] {
            let launch = Launch::of_run(text).unwrap();
            assert!(matches!(launch.devices.mocap, Mocap::Vicon(_)));
        }
    }

    #[test]
    fn each_kind_has_keys_of_its_own() {
        let natnet = with(
            "{ kind = \"natnet\", server = \"10.0.0.1:1510\", local = \"10.0.0.2\", version = \"3.1\", ids = { base = 7 }, axes = [\"x\", \"-z\", \"y\"] }",
        );
        let tracker = natnet.unwrap().tracker();
        let version = Version { major: 3, minor: 1 };
        assert_eq!(tracker.protocol, Protocol::Natnet { version, ids: [7, 2, 3] });
        let vrpn = with(
            "{ kind = \"vrpn\", server = \"10.0.0.1:3883\", transport = \"udp\", unit = \"mm\", names = { target = \"Client\" } }",
        );
        let tracker = vrpn.unwrap().tracker();
        assert_eq!((tracker.protocol, tracker.unit_m, tracker.names[2].as_str()), (Protocol::Vrpn, 1e-3, "Client"));
        for (mocap, why) in [
            ("{ kind = \"phasespace\" }", "natnet"),
            ("{ kind = \"vrpn\", listen = \"10.0.0.1:3883\" }", "listen"),
            ("{ kind = \"natnet\", server = \"10.0.0.1:1510\", axes = [\"x\", \"z\", \"y\"] }", "right-handed"),
            ("{ kind = \"natnet\", server = \"10.0.0.1:1510\", version = \"2.9\" }", "'2.9'"),
            ("{ kind = \"natnet\", server = \"10.0.0.1:1510\", ids = { base = 2 } }", "streaming id"),
        ] {
            let refused = with(mocap).unwrap_err();
            assert!(refused.contains(why), "{mocap}: {refused}");
        }
    }
}
