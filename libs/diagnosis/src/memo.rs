//! What is computed once for plants that are alike in what it hangs on.

use fss_plant::{Effect, Physics, Stream};
use std::sync::{Arc, Mutex};

/// Values that hang on a few parts of the physics, kept for the physics that were asked for last.
pub(crate) struct Memo<V>(Mutex<Vec<(Physics, Arc<V>)>>);

/// Whether the links of two plants move alike with what their encoders show.
pub(crate) fn are_geared_alike(a: &Physics, b: &Physics) -> bool {
    let of = |physics: &Physics, i: usize| {
        let joint = &physics.joints[i];
        let gear = [joint.backlash_rad, joint.kinematic_error_rad, joint.kinematic_cycles];
        let spring = (joint.stiffness_n_m_rad, physics.servos[i].gear_stiffness_n_m_rad);
        (gear, spring, [joint.encoder_scale, joint.encoder_offset_rad])
    };
    a.joints.len() == b.joints.len() && (0..a.joints.len()).all(|i| of(a, i) == of(b, i))
}

/// Whether the same motion takes the same torques on the links of two plants: their drives alone differ.
pub(crate) fn are_loaded_alike(a: &Physics, b: &Physics) -> bool {
    let driven = Physics { joints: b.joints.clone(), servos: b.servos.clone(), ..a.clone() };
    are_geared_alike(a, b) && driven == *b
}

/// Whether commands make the same thrust on two plants.
pub(crate) fn are_pushed_alike(a: &Physics, b: &Physics) -> bool {
    let early_s = |physics: &Physics| physics.sensors.clock_offset_s[Stream::Valves as usize];
    a.thrusters == b.thrusters && a.supply == b.supply && early_s(a) == early_s(b)
}

/// Whether the same acts from the start of a run to its end.
pub(crate) fn are_steady(effects: &[Effect]) -> bool {
    effects.iter().all(|e| e.onset_s().is_none())
}

/// Enough for the plant itself and for each thread's own present variation.
const KEPT: usize = 4;

impl<V> Memo<V> {
    pub(crate) fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    pub(crate) fn get<E>(
        &self,
        physics: &Physics,
        same: impl Fn(&Physics, &Physics) -> bool,
        make: impl FnOnce() -> Result<V, E>,
    ) -> Result<Arc<V>, E> {
        let lock = || self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((_, value)) = lock().iter().find(|(kept, _)| same(kept, physics)) {
            return Ok(value.clone());
        }
        let value = Arc::new(make()?);
        let mut kept = lock();
        if kept.len() == KEPT {
            // The first is the plant as it is, or as it is about to be extended: the one asked for most.
            kept.remove(1);
        }
        kept.push((physics.clone(), value.clone()));
        Ok(value)
    }

    pub(crate) fn forget(&self) {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clear();
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use fss_plant::Plant;

    #[test]
    fn the_same_motion_takes_the_same_torques_where_drives_alone_differ() {
        let plant = Plant::default_laboratory().unwrap();
        let nominal = Physics::nominal(&plant);
        let with = |id: &str, values: &[f64]| Physics::with(&plant, &[Effect::new(id).unwrap().at(2).with(values)]);
        for (id, value) in [("torque_constant", 0.7), ("joint_viscous_friction", 0.5)] {
            assert!(are_loaded_alike(&nominal, &with(id, &[value])), "{id}");
        }
        for (id, value) in [("link_mass", 5.0), ("encoder_offset", 0.1), ("joint_flexibility", 150.0)] {
            assert!(!are_loaded_alike(&nominal, &with(id, &[value])), "{id}");
        }
        // A law is another where its strength is.
        let drag = |size: f64| Physics::with(&plant, &[Effect::new("base_linear_drag").unwrap().with(&[size])]);
        assert!(are_loaded_alike(&drag(0.1), &drag(0.1)) && !are_loaded_alike(&drag(0.1), &drag(0.2)));
    }
}
