//! Values of a plant that its file states as uncertain, as the causes that they would be far beyond their deviations.

use fss_diagnosis::uncertain::Uncertain;
use fss_plant::{Effect, Plant};

/// Of a link's values, the cause that each would be far beyond its deviation.
const CAUSES: [(&str, &str); 7] = [
    ("com_to_next_joint_m", "link_com"),
    ("mass_kg", "link_mass"),
    ("inertia_kg_m2", "link_inertia"),
    ("joint_offset_rad", "encoder_offset"),
    ("coulomb_friction_N_m", "joint_coulomb_friction"),
    ("viscous_friction_N_m_s_rad", "joint_viscous_friction"),
    ("torque_constant_N_m_A", "torque_constant"),
];

/// The cause that a value of a link, so many standard deviations away from `plant`'s, would be.
pub(crate) fn as_cause(uncertain: &Uncertain, plant: &Plant, by: f64) -> Option<Effect> {
    let what = uncertain.name.strip_prefix(&format!("link {} ", uncertain.index + 1))?;
    let (_, id) = CAUSES.iter().find(|(name, _)| *name == what)?;
    let nominal = uncertain.of(plant);
    let value = match *id {
        // An encoder that reads too much makes its joint stand at less.
        "encoder_offset" => -by * uncertain.sd,
        "torque_constant" => 1.0 + by * uncertain.sd / nominal,
        _ => nominal + by * uncertain.sd,
    };
    Some(Effect::new(id).ok()?.at(uncertain.index + 1).with(&[value]))
}
