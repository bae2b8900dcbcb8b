//! What every laboratory is off by and none states: tenths of a percent, a millisecond, a tenth of a millimetre.
//!
//! Nobody wants to hear of these, however sure the data are of them. So each possible cause comes in small for nothing, as
//! an uncertain value does, and has to be asserted only for what it is beyond that.

use crate::hypothesis::Hypothesis;
use fss_plant::Plant;

/// Standard deviations of a hypothesis' coordinates that come in for nothing; `None` where there is no such thing.
pub(crate) fn tolerance(hypothesis: &Hypothesis, plant: &Plant) -> Option<Vec<f64>> {
    // A shape of no strength cannot be felt.
    if hypothesis.has_shape { None } else { unsaid(hypothesis, plant) }
}

/// Standard deviations of a hypothesis' coordinates that go without saying; of one with a shape, of its strength.
pub(crate) fn unsaid(hypothesis: &Hypothesis, plant: &Plant) -> Option<Vec<f64>> {
    if hypothesis.is_discrete {
        return None;
    }
    let effect = &hypothesis.nominal;
    let nominal = effect.values()[0].abs();
    let mass_kg = plant.base.mass_kg + plant.links.iter().map(|l| l.mass_kg).sum::<f64>();
    let inertia_kg_m2 = plant.base.inertia_kg_m2;
    let link_m = effect.index().and_then(|i| plant.links.get(i - 1)).map_or(0.3, |l| l.length_m);
    // Accelerations that a levelled table and a calm room leave.
    let (shift, turn) = (1e-5, 1e-5);
    let sd = match effect.id() {
        // Datagrams are taken to arrive after a constant time, which is false: it varies by a millisecond or two, and motion between
        // two reports is interpolated. A latency is known no better than that.
        "clock_offset" | "link_latency" | "thruster_delay" | "thruster_rise_time" | "gyro_scale" => vec![1e-3],
        "encoder_offset" | "encoder_scale" | "marker_yaw" => vec![2e-4],
        "gyro_bias" | "drive_kinematic_error" => vec![5e-5],
        "marker_offset" | "base_com" => vec![1e-4; 2],
        "table_tilt" => vec![0.3 * shift; 2],
        "body_force" => vec![shift * mass_kg, shift * mass_kg, turn * inertia_kg_m2],
        "base_linear_drag" => vec![1e-4 * mass_kg],
        "base_angular_drag" => vec![1e-4 * inertia_kg_m2],
        "base_mass" | "link_mass" => vec![1e-3 * nominal],
        "base_inertia" | "link_inertia" => vec![3e-3 * nominal],
        "link_com" => vec![1e-3 * link_m],
        "joint_coulomb_friction" | "joint_viscous_friction" if nominal > 0.0 => vec![0.01 * nominal],
        "torque_constant" | "thruster_gain" if effect.index().is_some() => vec![3e-3],
        "torque_sensor" => vec![1e-3, 3e-3],
        "thruster_misalignment" => vec![2e-3],
        "tether_linear" => vec![2.0 * shift * mass_kg],
        "tether_torsion" => vec![turn * inertia_kg_m2],
        "joint_spring" | "joint_stribeck_friction" => vec![3e-3],
        // Five reports a second flatten an arm's accelerations as a stiffness of some thousand newton metres would.
        "joint_backlash" | "joint_flexibility" => vec![1e-4],
        _ => return None,
    };
    Some(sd)
}
