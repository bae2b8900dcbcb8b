//! Torque sensors: the equations of motion without accelerations.
//!
//! The sensor of joint `i` reads `d/dt p_i - dT/dq_i`, `p` the generalized momentum and `T` the kinetic energy of arm and
//! base. Slow telemetry shows no acceleration worth the name. Multiplied by a bump `phi` that begins and ends flat, and
//! integrated by parts, none is needed: `int phi tau dt = -int phi' p_i dt - int phi dT/dq_i dt` (modulating functions,
//! Shinbrot, Trans. ASME 79, 1957).

use crate::measured::Joints;

/// Instants of one bump.
const LENGTH: usize = 12;

/// One bump over one joint's torque.
#[derive(Clone, Debug)]
pub(super) struct Window {
    /// The joint, from 0.
    pub(super) joint: usize,
    /// First and last instant.
    pub(super) first: usize,
    pub(super) last: usize,
    /// `int phi tau dt` as measured, N m s.
    pub(super) measured: f64,
    /// `int phi dt`, s: what a bias of 1 N m adds.
    pub(super) weight: f64,
}

impl Window {
    /// Sums `value(instant, phi, phi')` by the trapezoid rule.
    pub(super) fn sum(&self, t_s: &[f64], value: impl Fn(usize, f64, f64) -> f64) -> f64 {
        let (start, span) = (t_s[self.first], t_s[self.last] - t_s[self.first]);
        let at = |k: usize| {
            let s = (t_s[k] - start) / span;
            let phi = 16.0 * (s * (1.0 - s)).powi(2);
            let phi_dot = 32.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / span;
            value(k, phi, phi_dot)
        };
        (self.first..self.last).map(|k| 0.5 * (at(k) + at(k + 1)) * (t_s[k + 1] - t_s[k])).sum()
    }
}

/// The bumps, one after another, of every joint whose torque was measured throughout.
pub(super) fn windows(joints: &Joints, t_s: &[f64], delay_s: f64, links: usize) -> Vec<Window> {
    let mut all = Vec::new();
    for joint in 0..links.min(joints.torque_nm.len()) {
        let torques: Option<Vec<f64>> = t_s.iter().map(|t| torque_at(joints, joint, t + delay_s)).collect();
        let Some(torques) = torques else { continue };
        for first in (0..t_s.len().saturating_sub(LENGTH)).step_by(LENGTH) {
            let mut window = Window { joint, first, last: first + LENGTH, measured: 0.0, weight: 0.0 };
            window.measured = window.sum(t_s, |k, phi, _| phi * torques[k]);
            window.weight = window.sum(t_s, |_, phi, _| phi);
            all.push(window);
        }
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
