//! One rest of the arm, and the frames that wait to be counted into it.

use crate::mean::Mean;
use crate::{MovementBand, SETTLE_NS};
use core::f64::consts::{PI, TAU};
use fss_messages::{MAX_LINKS, MocapPose, Posture};

/// Frames that wait for a report: more than come between two of them.
const CAPACITY: usize = 128;
/// A frame that lies this many standard deviations from those before is a spike of motion capture.
const SPIKE: f64 = 8.0;
/// So many frames tell what a standard deviation is.
const KNOWN_FRAMES: u32 = 15;

/// The end-effector seen from the base, of one frame.
#[derive(Clone, Copy, Debug, Default)]
struct Frame {
    stamp_ns: u64,
    tip: [f64; 3],
}

/// Frames that no report has yet called still.
#[derive(Clone, Debug)]
pub(crate) struct Frames {
    waiting: [Frame; CAPACITY],
    count: usize,
}

impl Default for Frames {
    fn default() -> Self {
        Self { waiting: [Frame::default(); CAPACITY], count: 0 }
    }
}

impl Frames {
    /// Takes the end-effector as seen from the base, where both poses are good and of one frame.
    pub(crate) fn take(&mut self, base: &MocapPose, tip: &MocapPose) {
        let good = base.quality == MocapPose::VALID && tip.quality == MocapPose::VALID;
        if !good || base.frame != tip.frame || base.stamp_ns != tip.stamp_ns {
            return;
        }
        if self.count == CAPACITY {
            self.waiting.copy_within(1.., 0);
            self.count -= 1;
        }
        self.waiting[self.count] = Frame { stamp_ns: tip.stamp_ns, tip: relative(base, tip) };
        self.count += 1;
    }

    /// None waits any more.
    pub(crate) fn forget(&mut self) {
        self.count = 0;
    }

    /// None up to this time waits any more.
    pub(crate) fn forget_until(&mut self, stamp_ns: u64) {
        let gone = self.waiting[..self.count].iter().take_while(|frame| frame.stamp_ns <= stamp_ns).count();
        self.waiting.copy_within(gone..self.count, 0);
        self.count -= gone;
    }
}

/// A pose in the frame of the base.
fn relative(base: &MocapPose, pose: &MocapPose) -> [f64; 3] {
    let (sin, cos) = base.theta_rad.sin_cos();
    let (dx, dy) = (pose.x_m - base.x_m, pose.y_m - base.y_m);
    [dx * cos + dy * sin, dy * cos - dx * sin, pose.theta_rad - base.theta_rad]
}

/// The arm at one place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rest {
    since_ns: u64,
    /// When the last report was measured, ns.
    pub(crate) reported_ns: u64,
    /// 0 while it is no posture yet.
    pub(crate) number: u32,
    /// Angles of the last report, rad.
    last_rad: [f64; MAX_LINKS],
    q_rad: Mean<MAX_LINKS>,
    tip: Mean<3>,
}

impl Rest {
    /// With the first report at this place.
    pub(crate) fn begin(since_ns: u64, q_rad: &[f64; MAX_LINKS]) -> Self {
        let (q, tip) = (Mean::default(), Mean::default());
        Self { since_ns, reported_ns: since_ns, number: 0, last_rad: *q_rad, q_rad: q, tip }
    }

    /// Whether the joints are still there.
    pub(crate) fn holds(&self, q_rad: &[f64], band: MovementBand) -> bool {
        q_rad.iter().zip(&self.last_rad).all(|(q, last)| (q - last).abs() <= band.0)
    }

    /// Counts a report, measured from `report_ns` on, and the frames before it.
    pub(crate) fn take(&mut self, frames: &mut Frames, report_ns: u64, q_rad: &[f64; MAX_LINKS]) {
        let settled_ns = self.since_ns + SETTLE_NS;
        self.last_rad = *q_rad;
        for frame in &frames.waiting[..frames.count] {
            if (settled_ns..=report_ns).contains(&frame.stamp_ns) {
                self.add(frame.tip);
            }
        }
        frames.forget_until(report_ns);
        if report_ns >= settled_ns {
            self.q_rad.add(q_rad);
        }
    }

    fn add(&mut self, mut tip: [f64; 3]) {
        let (mean, std) = (&self.tip.value, self.tip.std());
        if self.tip.count > 0 {
            tip[2] = mean[2] + (tip[2] - mean[2] + PI).rem_euclid(TAU) - PI;
        } else {
            tip[2] = (tip[2] + PI).rem_euclid(TAU) - PI;
        }
        let spike = tip.iter().zip(mean).zip(&std).any(|((x, mean), std)| (x - mean).abs() > SPIKE * std);
        if !(spike && self.tip.count >= KNOWN_FRAMES) {
            self.tip.add(&tip);
        }
    }

    pub(crate) fn reports(&self) -> u32 {
        self.q_rad.count
    }

    pub(crate) fn frames(&self) -> u32 {
        self.tip.count
    }

    /// As seen so far.
    pub(crate) fn posture(&self, stamp_ns: u64) -> Posture {
        Posture {
            stamp_ns,
            since_ns: self.since_ns,
            q_rad: self.q_rad.value,
            tip: self.tip.value,
            scatter: self.tip.std(),
            reports: self.reports(),
            frames: self.frames(),
            number: self.number,
            ..Posture::default()
        }
    }
}
