//! What a drive passes on, and what its joint weighs.

use fss_experiments::measured::Joints;
use fss_multibody::{MAX_LINKS, MassMatrix};
use fss_plant::JointPhysics;
use nalgebra::SMatrix;

/// Rates below about this are not told from rest, rad/s.
const REST_RAD_S: f64 = 0.006;

/// A column's value of a joint, where it was measured.
pub(super) fn measured(columns: &[Vec<f64>], joint: usize, k: usize) -> Option<f64> {
    columns.get(joint)?.get(k).copied().filter(|v| v.is_finite())
}

/// Torque that the drive passes on, as its current and its friction say; `None` without a current.
pub(super) fn driven(
    joints: &Joints,
    k: usize,
    joint: usize,
    drive: &JointPhysics,
    rate: f64,
    rate_sd: f64,
) -> Option<f64> {
    let current = measured(&joints.current_a, joint, k)?;
    let motor = drive.torque_scale * drive.torque_constant_n_m_a * current;
    Some(motor - drive.friction.sliding_n_m(direction(rate, rate_sd), rate))
}

/// The direction of sliding that is expected of a rate that is known only so well.
pub(super) fn direction(rate: f64, sd: f64) -> f64 {
    (rate / (sd.hypot(REST_RAD_S) * 1.25)).tanh()
}

/// Torques per joint accelerations while the base is free, N m s2/rad.
pub(super) fn free_inertia(mass: &MassMatrix) -> SMatrix<f64, MAX_LINKS, MAX_LINKS> {
    let base = mass.fixed_view::<3, 3>(0, 0).into_owned();
    let coupling = mass.fixed_view::<3, MAX_LINKS>(0, 3).into_owned();
    let arm = mass.fixed_view::<MAX_LINKS, MAX_LINKS>(3, 3).into_owned();
    base.try_inverse().map_or(arm, |inverse| arm - coupling.transpose() * inverse * coupling)
}
