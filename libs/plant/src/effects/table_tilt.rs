//! `table_tilt`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, Parameter, Place};
use crate::physics::Physics;
use crate::prior::Prior;

pub(super) struct TableTilt;

const ABOUT: About = About {
    id: "table_tilt",
    sentence: "The table leans, so every body accelerates alike and steadily.",
    place: Place::Base,
    index: Index::None,
    parameters: &[
        Parameter::new("accel_x_m_s2", "m/s^2", "acceleration along the table's x").within(-20.0, 20.0).scale(0.001),
        Parameter::new("accel_y_m_s2", "m/s^2", "acceleration along the table's y").within(-20.0, 20.0).scale(0.001),
    ],
};

impl EffectKind for TableTilt {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        // A table is levelled; where gravity acts in the plane, its direction is known to a milliradian.
        let [gx, gy] = plant.table.gravity_m_s2;
        let gravity = gx.hypot(gy);
        Prior::sized(&[1e-3 + 1e-2 * gravity; 2], &[3e-6 + 1e-3 * gravity; 2]).of_vector()
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        let [x, y, ..] = effect.padded();
        physics.gravity_m_s2[0] += x;
        physics.gravity_m_s2[1] += y;
    }
}
