//! What the mission knows of the vehicle, and how patient it is.

use fss_multibody::Model;
use fss_plant::Plant;

/// How patient the mission is.
#[derive(Clone, Copy, Debug)]
pub struct MissionConfig {
    /// Older navigation, telemetry or arm commands are missing ones, ns.
    pub max_age_ns: u64,
    /// Navigation and telemetry must be good for this long before the first phase begins, ns.
    pub ready_ns: u64,
    /// What is missing or faulty for this long aborts the mission, ns.
    pub patience_ns: u64,
    /// The vehicle, where it is known: it tells where the base must be to meet a target, and how the whole moves.
    pub model: Option<Model>,
    /// How far from the middle the base may be before the mission is aborted, m.
    pub edges_m: Option<[f64; 2]>,
}

impl Default for MissionConfig {
    fn default() -> Self {
        Self {
            max_age_ns: 500_000_000,
            ready_ns: 1_000_000_000,
            patience_ns: 1_000_000_000,
            model: None,
            edges_m: None,
        }
    }
}

impl MissionConfig {
    /// For a plant with the effects that it has from the start.
    pub fn for_plant(plant: &Plant) -> Self {
        let model = plant.model().ok().filter(|model| !model.base().clamped);
        Self { model, edges_m: Some(plant.table.size_m.map(|size| size / 2.0)), ..Self::default() }
    }
}
