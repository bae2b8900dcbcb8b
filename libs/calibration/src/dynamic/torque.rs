//! Torque sensors: the equations of motion without accelerations.
//!
//! The sensor of joint `i` reads `d/dt p_i - dT/dq_i`, `p` the generalized momentum and `T` the kinetic energy of arm and
//! base. Slow telemetry shows no acceleration worth the name. Multiplied by a bump `phi` that begins and ends flat, and
//! integrated by parts, none is needed: `int phi tau dt = -int phi' p_i dt - int phi dT/dq_i dt` (modulating functions,
//! Shinbrot, Trans. ASME 79, 1957).

use fss_experiments::measured::Joints;
use std::iter::Sum;
use std::ops::Mul;

/// Instants of one bump.
const LENGTH: usize = 12;

/// One bump.
#[derive(Clone, Debug)]
pub(super) struct Window {
    /// First and last instant.
    pub(super) first: usize,
    pub(super) last: usize,
    /// `int phi tau dt` as measured, N m s, one a joint.
    pub(super) measured: Vec<f64>,
    /// `int phi dt`, s: what a bias of 1 N m adds.
    pub(super) weight: f64,
    /// Angular momentum meanwhile, N m s.
    pub(super) spin: f64,
}

impl Window {
    /// Sums `value(instant, phi, phi')` by the trapezoid rule.
    pub(super) fn sum<T>(&self, t_s: &[f64], value: impl Fn(usize, f64, f64) -> T) -> T
    where
        T: Sum + Mul<f64, Output = T>,
    {
        let (start, span) = (t_s[self.first], t_s[self.last] - t_s[self.first]);
        let at = |k: usize| {
            let s = (t_s[k] - start) / span;
            let phi = 16.0 * (s * (1.0 - s)).powi(2);
            let phi_dot = 32.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / span;
            value(k, phi, phi_dot)
        };
        // The bump is zero at both ends, so that the trapezoid rule needs the instants between them only.
        (self.first + 1..self.last).map(|k| at(k) * (0.5 * (t_s[k + 1] - t_s[k - 1]))).sum()
    }
}

/// The bumps, one after another, where the torques of all joints were measured.
pub(super) fn windows(joints: &Joints, t_s: &[f64], delay_s: f64, links: usize) -> Vec<Window> {
    if joints.torque_nm.len() < links {
        return Vec::new();
    }
    let torques = |joint: usize| t_s.iter().map(|t| torque_at(joints, joint, t + delay_s)).collect();
    let torques: Vec<Vec<Option<f64>>> = (0..links).map(torques).collect();
    let mut all = Vec::new();
    for first in (0..t_s.len().saturating_sub(LENGTH)).step_by(LENGTH) {
        let last = first + LENGTH;
        if torques.iter().any(|of_joint| of_joint[first..=last].contains(&None)) {
            continue;
        }
        let mut window = Window { first, last, measured: Vec::new(), weight: 0.0, spin: 0.0 };
        window.measured =
            torques.iter().map(|of_joint| window.sum(t_s, |k, phi, _| phi * of_joint[k].unwrap_or_default())).collect();
        window.weight = window.sum(t_s, |_, phi, _| phi);
        all.push(window);
    }
    all
}

/// Linear between reports of the joint.
fn torque_at(joints: &Joints, joint: usize, t_s: f64) -> Option<f64> {
    let values = &joints.torque_nm[joint];
    let known = |k: &usize| values[*k].is_finite();
    let after = joints.t_s.partition_point(|t| *t < t_s - 1e-6);
    let b = (after..joints.t_s.len()).find(known)?;
    if (joints.t_s[b] - t_s).abs() <= 1e-6 {
        return Some(values[b]);
    }
    let a = (0..after).rev().find(known)?;
    let share = (t_s - joints.t_s[a]) / (joints.t_s[b] - joints.t_s[a]);
    (joints.t_s[b] - joints.t_s[a] < 0.5).then(|| values[a] + share * (values[b] - values[a]))
}
