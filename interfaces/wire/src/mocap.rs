//! Motion capture, whoever made it: three rigid bodies, the axes and units in which cameras see them, and their protocol.
//!
//! A [`Tracker`] says how a motion capture system is set up. The laboratory speaks as it with [`Tracker::encode`]; a
//! service listens with a [`Reader`]. In between lie the bytes of [`vicon`], [`natnet`] or [`vrpn`].
//!
//! Poses are planar, in the table frame: x m, y m, heading rad. A tracker's own axes may be others ([`Axes`]): cameras
//! whose y points up show the table's (x, y, z) as (x, z, -y).

use crate::{natnet, vicon, vrpn};

/// Bodies of one stack: base, end-effector, target.
pub const BODIES: usize = 3;

/// What they are called where nobody says otherwise.
pub const NAMES: [&str; BODIES] = ["base", "end_effector", "target"];

/// A buffer of this many bytes holds a frame of any protocol.
pub const MAX_FRAME_LEN: usize = 1472;

/// Why a frame cannot be read or written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MocapError {
    /// VICON.
    #[error(transparent)]
    Vicon(#[from] vicon::ViconError),
    /// NatNet.
    #[error(transparent)]
    Natnet(#[from] natnet::NatnetError),
    /// VRPN.
    #[error(transparent)]
    Vrpn(#[from] vrpn::VrpnError),
}

/// Which of the tracker's axes are the table's x, y and z (up); each with its sign.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes([(usize, f64); 3]);

/// Why axes are none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AxesError {
    /// Not the name of an axis.
    #[error("'{0}' is no axis: x, y or z, with or without a minus")]
    Name(String),
    /// An axis is there twice, or the frame is left-handed.
    #[error("the three axes are no right-handed frame")]
    Handed,
}

impl Default for Axes {
    /// Those of the table.
    fn default() -> Self {
        Self([(0, 1.0), (1, 1.0), (2, 1.0)])
    }
}

impl Axes {
    /// From the tracker's axes that point along the table's x, y and up, such as `["x", "-z", "y"]`.
    pub fn parse(names: &[String; 3]) -> Result<Self, AxesError> {
        let mut axes = [(0, 0.0); 3];
        for (axis, name) in axes.iter_mut().zip(names) {
            let (sign, letter) = name.strip_prefix('-').map_or((1.0, name.as_str()), |letter| (-1.0, letter));
            let index = ["x", "y", "z"].iter().position(|known| *known == letter);
            *axis = (index.ok_or_else(|| AxesError::Name(name.clone()))?, sign);
        }
        let [(i, a), (j, b), (k, c)] = axes;
        // The sign of the permutation of three different indices.
        let parity = match (i, j, k) {
            (0, 1, 2) | (1, 2, 0) | (2, 0, 1) => 1.0,
            (0, 2, 1) | (2, 1, 0) | (1, 0, 2) => -1.0,
            _ => return Err(AxesError::Handed),
        };
        if a * b * c * parity > 0.0 { Ok(Self(axes)) } else { Err(AxesError::Handed) }
    }

    fn to_table(self, v: [f64; 3]) -> [f64; 3] {
        self.0.map(|(index, sign)| sign * v[index])
    }

    fn to_tracker(self, v: [f64; 3]) -> [f64; 3] {
        let mut turned = [0.0; 3];
        for ((index, sign), value) in self.0.into_iter().zip(v) {
            turned[index] = sign * value;
        }
        turned
    }
}

/// How a motion capture system speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Protocol {
    /// VICON Tracker's UDP object stream.
    Vicon,
    /// OptiTrack's NatNet.
    Natnet {
        /// Of the bit stream.
        version: natnet::Version,
        /// Streaming ids of the bodies.
        ids: [u32; BODIES],
    },
    /// VRPN.
    Vrpn,
}

/// A motion capture system as it is set up.
#[derive(Debug, Clone, PartialEq)]
pub struct Tracker {
    /// How it speaks.
    pub protocol: Protocol,
    /// What it calls base, end-effector and target.
    pub names: [String; BODIES],
    /// Its axes.
    pub axes: Axes,
    /// Its unit of length, m.
    pub unit_m: f64,
}

impl Default for Tracker {
    /// VICON Tracker with the table's axes.
    fn default() -> Self {
        Self { protocol: Protocol::Vicon, names: NAMES.map(str::to_owned), axes: Axes::default(), unit_m: 1.0 }
    }
}

/// A body as cameras see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// Which: 0 base, 1 end-effector, 2 target.
    pub index: usize,
    /// Position in the table frame, m.
    pub position_m: [f64; 3],
    /// Rotation about the vertical, rad.
    pub theta_rad: f64,
    /// Whether the cameras see it; one that they have lost has no pose.
    pub is_seen: bool,
}

/// What arrived of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sighting {
    /// The tracker's number of the frame, or its time in microseconds: it increases, and wraps around.
    pub number: u32,
    /// x m, y m, heading rad; `None` for a body that is not named, zeros for one that is not seen.
    pub poses: [Option<[f64; 3]>; BODIES],
}

impl Tracker {
    /// Writes a frame as the tracker sends it; `time_ns` is the tracker's own clock.
    pub fn encode(&self, number: u32, time_ns: u64, bodies: &[Body], buffer: &mut [u8]) -> Result<usize, MocapError> {
        match self.protocol {
            Protocol::Vicon => self.encode_vicon(number, bodies, buffer),
            Protocol::Natnet { version, ids } => {
                let of = |body: &Body| {
                    let (position, rotation) = self.to_tracker(body);
                    natnet::RigidBody { id: ids[body.index % BODIES], position, rotation, is_tracked: body.is_seen }
                };
                let rigid: [natnet::RigidBody; BODIES] =
                    std::array::from_fn(|i| bodies.get(i).map_or_else(natnet::RigidBody::default, of));
                let rigid = rigid.get(..bodies.len()).ok_or(natnet::NatnetError::Full)?;
                Ok(natnet::encode_frame(version, number, time_ns, rigid, buffer)?)
            }
            Protocol::Vrpn => {
                let mut len = 0;
                // A server says nothing of a body that it does not see.
                for body in bodies.iter().filter(|body| body.is_seen) {
                    let (position, rotation) = self.to_tracker(body);
                    let report = vrpn::Report { sensor: 0, position, rotation };
                    let rest = buffer.get_mut(len..).unwrap_or_default();
                    len += vrpn::encode_report(body.index as i32, number, time_ns, &report, rest)?;
                }
                Ok(len)
            }
        }
    }

    /// What a VRPN server says when somebody has connected; nothing for the others.
    pub fn introduction(&self) -> Vec<u8> {
        match self.protocol {
            Protocol::Vrpn => vrpn::introduction(&self.names),
            Protocol::Vicon | Protocol::Natnet { .. } => Vec::new(),
        }
    }

    fn encode_vicon(&self, number: u32, bodies: &[Body], buffer: &mut [u8]) -> Result<usize, MocapError> {
        let mut objects = [vicon::Object { name: "", position_m: [0.0; 3], rotation_rad: [0.0; 3] }; BODIES];
        for (object, body) in objects.iter_mut().zip(bodies) {
            object.name = &self.names[body.index % BODIES];
            if body.is_seen {
                (object.position_m, object.rotation_rad) = (body.position_m, [0.0, 0.0, body.theta_rad]);
            }
        }
        Ok(vicon::encode(number, objects.get(..bodies.len()).unwrap_or_default(), buffer)?)
    }

    /// Position in the tracker's unit and rotation as a quaternion x, y, z, w, in its axes.
    fn to_tracker(&self, body: &Body) -> ([f64; 3], [f64; 4]) {
        let position = self.axes.to_tracker(body.position_m).map(|m| m / self.unit_m);
        let (sin, cos) = (body.theta_rad / 2.0).sin_cos();
        let [x, y, z] = self.axes.to_tracker([0.0, 0.0, sin]);
        (position, [x, y, z, cos])
    }

    /// x m, y m, heading rad in the table frame; zeros where it is no pose.
    fn to_table(&self, position: [f64; 3], [x, y, z, w]: [f64; 4]) -> [f64; 3] {
        let [x_m, y_m, _] = self.axes.to_table(position).map(|units| units * self.unit_m);
        let [x, y, z] = self.axes.to_table([x, y, z]);
        let pose = [x_m, y_m, (2.0 * (w * z + x * y)).atan2(w * w + x * x - y * y - z * z)];
        if pose.iter().all(|value| value.is_finite()) { pose } else { [0.0; 3] }
    }
}

/// Listens to a tracker.
#[derive(Debug, Clone)]
pub struct Reader {
    tracker: Tracker,
    directory: vrpn::Directory,
}

impl Reader {
    /// One that has heard nothing yet.
    pub fn new(tracker: Tracker) -> Self {
        let directory = vrpn::Directory::new(&tracker.names);
        Self { tracker, directory }
    }

    /// The tracker that it listens to.
    pub fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// A NatNet server has said which version it speaks.
    pub fn set_natnet_version(&mut self, new: natnet::Version) {
        if let Protocol::Natnet { version, .. } = &mut self.tracker.protocol {
            *version = new;
        }
    }

    /// A VRPN connection was lost: the next one's numbers mean something else.
    pub fn forget(&mut self) {
        self.directory = vrpn::Directory::new(&self.tracker.names);
    }

    /// Takes what arrived, one datagram or a piece of a stream, and hands each sighting to `each`. Gives how many bytes were
    /// used: a message whose end is missing stays for the next time.
    pub fn read(&mut self, bytes: &[u8], mut each: impl FnMut(Sighting)) -> Result<usize, MocapError> {
        match self.tracker.protocol {
            Protocol::Vicon => each(self.read_vicon(&vicon::Frame::decode(bytes)?)),
            Protocol::Natnet { version, ids } => {
                if let Some(frame) = natnet::Frame::decode(bytes, version)? {
                    each(self.read_natnet(&frame, &ids));
                }
            }
            Protocol::Vrpn => {
                let mut used = 0;
                while let Some((message, len)) = vrpn::Message::decode(bytes.get(used..).unwrap_or_default())? {
                    used += len;
                    if let Some((body, report)) = self.directory.take(&message) {
                        let mut sighting = Sighting { number: message.time_us(), ..Sighting::default() };
                        sighting.poses[body] = Some(self.tracker.to_table(report.position, report.rotation));
                        each(sighting);
                    }
                }
                return Ok(used);
            }
        }
        Ok(bytes.len())
    }

    fn read_vicon(&self, frame: &vicon::Frame<'_>) -> Sighting {
        let mut sighting = Sighting { number: frame.number(), ..Sighting::default() };
        for object in frame.objects() {
            if let Some(body) = self.tracker.names.iter().position(|name| name == object.name) {
                let pose = [object.position_m[0], object.position_m[1], object.rotation_rad[2]];
                sighting.poses[body] = Some(if object.is_tracked() { pose } else { [0.0; 3] });
            }
        }
        sighting
    }

    fn read_natnet(&self, frame: &natnet::Frame<'_>, ids: &[u32; BODIES]) -> Sighting {
        let mut sighting = Sighting { number: frame.number(), ..Sighting::default() };
        for rigid in frame.rigid_bodies() {
            if let Some(body) = ids.iter().position(|id| *id == rigid.id) {
                let pose = self.tracker.to_table(rigid.position, rigid.rotation);
                sighting.poses[body] = Some(if rigid.is_tracked { pose } else { [0.0; 3] });
            }
        }
        sighting
    }
}
