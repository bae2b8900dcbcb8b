//! Where the target is and how it moves, from motion capture.
//!
//! Three independent Kalman filters of constant velocity (Bar-Shalom, Li and Kirubarajan 2001, section 6.2): a passive body
//! on a level table keeps its velocity, so that some seconds of motion capture tell it to hundredths of a millimetre a second.

use fss_bus::Time;
use fss_messages::MocapPose;
use std::f64::consts::TAU;

/// Standard deviations of motion capture: m, m, rad.
const NOISE: [f64; 3] = [3e-4, 3e-4, 7e-4];
/// Spectral densities of what may accelerate a body that nothing touches: m2/s3, m2/s3, rad2/s3.
const UNREST: [f64; 3] = [1e-10, 1e-10, 1e-9];
/// Of a body that the vehicle carries about.
const UNREST_HELD: [f64; 3] = [1e-4, 1e-4, 1e-3];
/// A pose so far from where it should be is another body: m, m, rad.
const GATE: [f64; 3] = [0.03, 0.03, 0.15];
/// Velocities are known when their standard deviations are below: m/s, m/s, rad/s.
const KNOWN: [f64; 3] = [3e-4, 3e-4, 1e-3];
/// A target that was not seen for so long is lost, ns.
const LOST_AFTER_NS: u64 = 1_000_000_000;

/// Position and velocity of one coordinate with their covariance.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    x: [f64; 2],
    p: [f64; 3],
}

impl Axis {
    fn predict(&mut self, dt_s: f64, unrest: f64) {
        let [pp, pv, vv] = self.p;
        self.x[0] += self.x[1] * dt_s;
        self.p = [
            pp + dt_s * (2.0 * pv + dt_s * vv) + unrest * dt_s.powi(3) / 3.0,
            pv + dt_s * vv + unrest * dt_s * dt_s / 2.0,
            vv + unrest * dt_s,
        ];
    }

    fn correct(&mut self, innovation: f64, noise: f64) {
        let [pp, pv, vv] = self.p;
        let s = pp + noise * noise;
        let (k0, k1) = (pp / s, pv / s);
        self.x[0] += k0 * innovation;
        self.x[1] += k1 * innovation;
        self.p = [pp - k0 * pp, pv - k0 * pv, vv - k1 * pv];
    }
}

/// Follows the target.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TargetTracker {
    axes: [Axis; 3],
    /// Time that the axes stand for, ns.
    at_ns: u64,
    begun: bool,
    refused: u32,
}

/// A moving body: pose and velocity, m, m, rad and per second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Motion {
    pub(crate) pose: [f64; 3],
    pub(crate) rate: [f64; 3],
}

impl TargetTracker {
    /// Takes a pose into account, of a body that floats freely or is held by the vehicle.
    pub(crate) fn update(&mut self, mocap: &MocapPose, is_held: bool) {
        if mocap.quality != MocapPose::VALID {
            return;
        }
        let pose = [mocap.x_m, mocap.y_m, mocap.theta_rad];
        if !self.begun || self.refused > 20 {
            let axis = |x| Axis { x: [x, 0.0], p: [1e-4, 0.0, 1e-2] };
            *self = Self { axes: pose.map(axis), at_ns: mocap.stamp_ns, begun: true, refused: 0 };
            return;
        }
        if mocap.stamp_ns <= self.at_ns {
            return;
        }
        let dt_s = (mocap.stamp_ns - self.at_ns) as f64 * 1e-9;
        let expected = self.motion_at(mocap.stamp_ns).pose;
        let mut innovation: [f64; 3] = std::array::from_fn(|i| pose[i] - expected[i]);
        innovation[2] -= TAU * (innovation[2] / TAU).round();
        if innovation.iter().zip(GATE).any(|(error, gate)| error.abs() > gate) {
            self.refused += 1;
            return;
        }
        self.refused = 0;
        self.at_ns = mocap.stamp_ns;
        let unrest = if is_held { UNREST_HELD } else { UNREST };
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.predict(dt_s, unrest[i]);
            axis.correct(innovation[i], NOISE[i]);
        }
    }

    /// Whether its motion is known and it was seen just now.
    pub(crate) fn is_known(&self, now: Time) -> bool {
        let known = self.axes.iter().zip(KNOWN).all(|(axis, limit)| axis.p[2] < limit * limit);
        self.begun && known && !self.is_lost(now)
    }

    /// Whether it has not been seen for too long.
    pub(crate) fn is_lost(&self, now: Time) -> bool {
        !self.begun || now.age_ns(self.at_ns) > LOST_AFTER_NS
    }

    /// Where it is at a time.
    pub(crate) fn motion(&self, now: Time) -> Motion {
        self.motion_at(now.ns())
    }

    fn motion_at(&self, ns: u64) -> Motion {
        let dt_s = ns.saturating_sub(self.at_ns) as f64 * 1e-9;
        Motion { pose: self.axes.map(|axis| axis.x[0] + axis.x[1] * dt_s), rate: self.axes.map(|axis| axis.x[1]) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_motion_of_a_drifting_body_is_known_after_some_seconds_and_an_outlier_changes_nothing() {
        let mut tracker = TargetTracker::default();
        for n in 1..=200_u64 {
            let (t_s, wobble) = (n as f64 * 0.05, if n.is_multiple_of(2) { 2e-4 } else { -2e-4 });
            let turned = 3.0 + 0.02 * t_s;
            let sample = MocapPose {
                stamp_ns: n * 50_000_000,
                x_m: 0.3 + 0.01 * t_s + wobble + if n == 150 { 1.0 } else { 0.0 },
                y_m: -0.2 - 0.004 * t_s - wobble,
                theta_rad: turned - TAU * (turned / TAU).round(),
                ..MocapPose::default()
            };
            tracker.update(&sample, false);
        }
        let now = Time::from_ns(10_100_000_000);
        let motion = tracker.motion(now);
        assert!(tracker.is_known(now));
        for (got, expected, within) in [
            (motion.rate[0], 0.01, 1e-4),
            (motion.rate[1], -0.004, 1e-4),
            (motion.rate[2], 0.02, 1e-4),
            (motion.pose[0], 0.401, 2e-4),
            (motion.pose[2], 3.202, 1e-3),
        ] {
            assert!((got - expected).abs() < within, "{got} is not {expected}");
        }
        assert!(tracker.is_lost(Time::from_ns(11_200_000_000)));
    }
}
