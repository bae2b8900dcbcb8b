//! Overhead motion capture: poses of base, end-effector and target, as the tracker sends them.

use crate::config::{ActiveFaults, FaultKind};
use fss_multibody::wrapped;
use fss_plant::{Instruments, Simulation};
use fss_wire::mocap::{BODIES, Body, MAX_FRAME_LEN, MocapError, NAMES, Tracker};

/// Heights of the markers above the granite (m): base, end-effector, target. No part of the planar motion.
const HEIGHTS_M: [f64; BODIES] = [0.25, 0.15, 0.25];

/// The camera system.
#[derive(Debug, Clone)]
pub(crate) struct Camera {
    tracker: Tracker,
    has_target: bool,
    period_ns: u64,
    next_ns: u64,
    frame: u32,
    /// What is sent now, and again while the tracker is frozen.
    bytes: [u8; MAX_FRAME_LEN],
    len: usize,
}

impl Camera {
    /// A camera that sends its first frame one period after `start_ns`.
    pub(crate) fn new(tracker: Tracker, rate_hz: f64, has_target: bool, start_ns: u64) -> Self {
        let period_ns = (1e9 / rate_hz) as u64;
        let next_ns = start_ns + period_ns;
        Self { tracker, has_target, period_ns, next_ns, frame: 0, bytes: [0; MAX_FRAME_LEN], len: 0 }
    }

    /// The bytes of the frame taken at `now_ns`, if one is due; it leaves the tracker one latency later.
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
        if !faults.has(&FaultKind::MocapFrozen) {
            self.frame = self.frame.wrapping_add(1);
            self.len = self.take_frame(now_ns, simulation, instruments, faults).ok()?;
        }
        if faults.has(&FaultKind::MocapSilent) { None } else { self.bytes.get(..self.len) }
    }

    fn take_frame(
        &mut self,
        now_ns: u64,
        simulation: &Simulation,
        instruments: &mut Instruments,
        faults: ActiveFaults<'_>,
    ) -> Result<usize, MocapError> {
        let target = if self.has_target { instruments.mocap_target(simulation) } else { None };
        let has_arm = simulation.joint_count() > 0;
        let end_effector = if has_arm { instruments.mocap_end_effector(simulation) } else { None };
        let poses = [instruments.mocap_base(simulation), end_effector, target];
        let mut bodies = [Body { index: 0, position_m: [0.0; 3], theta_rad: 0.0, is_seen: true }; BODIES];
        let mut count = 0;
        for ((index, pose), height_m) in poses.iter().enumerate().zip(HEIGHTS_M) {
            if let (Some([x, y, theta]), Some(body)) = (pose, bodies.get_mut(count)) {
                *body = Body { index, position_m: [*x, *y, height_m], theta_rad: wrapped(*theta), is_seen: true };
                spoil(body, faults);
                count += 1;
            }
        }
        self.tracker.encode(self.frame, now_ns, bodies.get(..count).unwrap_or_default(), &mut self.bytes)
    }
}

fn spoil(body: &mut Body, faults: ActiveFaults<'_>) {
    let name = NAMES[body.index % BODIES];
    for kind in faults.kinds() {
        match kind {
            FaultKind::MocapZeros { object } if object == name => body.is_seen = false,
            FaultKind::MocapJump { object, x_m, y_m } if object == name => {
                body.position_m[0] += x_m;
                body.position_m[1] += y_m;
            }
            _ => {}
        }
    }
}
