//! Hyper-parameters of the joints' noise model.

use crate::block::{HyperParameter, Strength};

/// Their values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hyper {
    /// Acceleration beside the commanded one: of a joint at rest (rad/s2), and as a share of what is commanded.
    pub(super) acceleration: [f64; 2],
    /// Its correlation time, s.
    pub(super) acceleration_s: f64,
    /// White torque, share of the torque scale, root s.
    pub(super) white: f64,
    /// Correlated torque on the links and in the drives, shares of the torque scale.
    pub(super) link: f64,
    pub(super) drive: f64,
    /// Their correlation time, s.
    pub(super) torque_s: f64,
    /// Error of the end-effector's geometry, m.
    pub(super) tip_m: f64,
    /// Noise over stated noise: angle, rate, current, torque, end-effector.
    pub(super) noise: [f64; 5],
}

const fn strength(name: &'static str, median: f64, log_sd: f64, bounds: [f64; 2]) -> HyperParameter {
    HyperParameter { name, median, log_sd, bounds, strength_of: Some(Strength::Joint) }
}

const fn plain(name: &'static str, median: f64, log_sd: f64, bounds: [f64; 2]) -> HyperParameter {
    HyperParameter { name, median, log_sd, bounds, strength_of: None }
}

/// Stated noise is right to about a seventh.
const fn noise(name: &'static str) -> HyperParameter {
    plain(name, 1.0, 0.15, [0.3, 3.0])
}

// A good model of a drive is right to a hundredth of its torques, of a mechanism to a few thousandths; a poor one to ten
// times that. Servo drives follow what is commanded with errors of tenths of the acceleration, for tenths of a second.
const TORQUE: [HyperParameter; 4] = [
    strength("link torque, share of scale", 3e-3, 2.5, [1e-6, 10.0]),
    strength("drive torque, share of scale", 1e-2, 2.5, [1e-6, 10.0]),
    plain("correlation of torques, s", 0.5, 1.0, [0.01, 10.0]),
    strength("end-effector geometry, m", 1e-4, 2.0, [1e-7, 0.1]),
];
const NOISE: [HyperParameter; 5] = [
    noise("encoder angle noise over stated"),
    noise("encoder rate noise over stated"),
    noise("current noise over stated"),
    noise("torque sensor noise over stated"),
    noise("end-effector noise over stated"),
];
const MOTION: [HyperParameter; 3] = [
    plain("acceleration at rest, rad/s2", 0.02, 2.0, [1e-5, 10.0]),
    plain("acceleration beside the command, share", 0.2, 1.0, [1e-3, 10.0]),
    plain("correlation of accelerations, s", 0.2, 0.7, [0.02, 3.0]),
];
const WHITE: HyperParameter = strength("white torque, share of scale root s", 3e-3, 2.5, [1e-5, 10.0]);

/// Those of joints whose motion follows from their torques, and of joints that follow a command.
pub(super) fn hyper_parameters(driven: bool) -> Vec<HyperParameter> {
    let first: Vec<HyperParameter> = if driven { vec![WHITE] } else { MOTION.to_vec() };
    first.into_iter().chain(TORQUE).chain(NOISE).collect()
}

impl Hyper {
    /// From the values in the order of [`hyper_parameters`]; what is missing has its prior's median.
    pub(super) fn new(values: &[f64], driven: bool) -> Self {
        let all = hyper_parameters(driven);
        let at = |k: usize| values.get(k).copied().unwrap_or(all[k].median);
        let n = all.len() - TORQUE.len() - NOISE.len();
        Self {
            acceleration: if driven { [0.0; 2] } else { [at(0), at(1)] },
            acceleration_s: if driven { 1.0 } else { at(2) },
            white: if driven { at(0) } else { 0.0 },
            link: at(n),
            drive: at(n + 1),
            torque_s: at(n + 2),
            tip_m: at(n + 3),
            noise: std::array::from_fn(|i| at(n + 4 + i)),
        }
    }
}
