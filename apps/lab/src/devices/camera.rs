//! Overhead motion capture: poses of base, end-effector and target, as Tracker sends them.

use crate::config::{ActiveFaults, FaultKind, OBJECTS};
use fss_multibody::wrapped;
use fss_plant::{Instruments, Simulation};
use fss_wire::vicon::{self, MAX_DATAGRAM_LEN, Object, ViconError};

/// Heights of the markers above the granite (m): base, end-effector, target. No part of the planar motion.
const HEIGHTS_M: [f64; 3] = [0.25, 0.15, 0.25];

/// The camera system.
#[derive(Debug, Clone)]
pub(crate) struct Camera {
    has_target: bool,
    period_ns: u64,
    next_ns: u64,
    frame: u32,
    /// The datagram that is sent now, and again while the tracker is frozen.
    datagram: [u8; MAX_DATAGRAM_LEN],
    len: usize,
}

impl Camera {
    /// A camera that sends its first frame one period after `start_ns`.
    pub(crate) fn new(rate_hz: f64, has_target: bool, start_ns: u64) -> Self {
        let period_ns = (1e9 / rate_hz) as u64;
        let next_ns = start_ns + period_ns;
        Self { has_target, period_ns, next_ns, frame: 0, datagram: [0; MAX_DATAGRAM_LEN], len: 0 }
    }

    /// The datagram of the frame taken at `now_ns`, if one is due; it leaves the tracker one latency later.
    pub(crate) fn sample(
        &mut self,
        now_ns: u64,
        simulation: &Simulation,
        instruments: &mut Instruments,
        faults: ActiveFaults<'_>,
    ) -> Option<&[u8]> {
        if now_ns < self.next_ns {
            return None;
        }
        self.next_ns += self.period_ns;
        if !faults.has(&FaultKind::ViconFrozen) {
            self.frame = self.frame.wrapping_add(1);
            self.len = self.take_frame(simulation, instruments, faults).ok()?;
        }
        if faults.has(&FaultKind::ViconSilent) { None } else { self.datagram.get(..self.len) }
    }

    fn take_frame(
        &mut self,
        simulation: &Simulation,
        instruments: &mut Instruments,
        faults: ActiveFaults<'_>,
    ) -> Result<usize, ViconError> {
        let target = if self.has_target { instruments.mocap_target(simulation) } else { None };
        let has_arm = simulation.joint_count() > 0;
        let end_effector = if has_arm { instruments.mocap_end_effector(simulation) } else { None };
        let poses = [instruments.mocap_base(simulation), end_effector, target];
        let mut objects = [Object { name: "", position_m: [0.0; 3], rotation_rad: [0.0; 3] }; 3];
        let mut count = 0;
        for ((pose, name), height_m) in poses.iter().zip(OBJECTS).zip(HEIGHTS_M) {
            if let (Some([x, y, theta]), Some(object)) = (pose, objects.get_mut(count)) {
                let rotation_rad = [0.0, 0.0, wrapped(*theta)];
                *object = Object { name, position_m: [*x, *y, height_m], rotation_rad };
                spoil(object, faults);
                count += 1;
            }
        }
        vicon::encode(self.frame, objects.get(..count).unwrap_or_default(), &mut self.datagram)
    }
}

fn spoil(object: &mut Object<'_>, faults: ActiveFaults<'_>) {
    for kind in faults.kinds() {
        match kind {
            FaultKind::ViconZeros { object: name } if name == object.name => {
                (object.position_m, object.rotation_rad) = ([0.0; 3], [0.0; 3]);
            }
            FaultKind::ViconJump { object: name, x_m, y_m } if name == object.name => {
                object.position_m[0] += x_m;
                object.position_m[1] += y_m;
            }
            _ => {}
        }
    }
}
