//! `base_angular_drag`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place};
use crate::physics::{BaseLaw, BaseMotion, Physics};
use crate::prior::Prior;

pub(super) struct BaseAngularDrag;

const ABOUT: About = About {
    id: "base_angular_drag",
    sentence: "A torque on the base opposes its turning in proportion to the rate.",
    place: Place::Base,
    index: Index::None,
    parameters: &[Parameter::new("coefficient_N_m_s_rad", "N m s/rad", "torque per rate")
        .within(0.0, 100.0)
        .scale(0.01)],
};

impl EffectKind for BaseAngularDrag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        let inertia = plant.base.inertia_kg_m2;
        Prior::sized(&[0.1 * inertia], &[1e-4 * inertia])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.base_laws.push(BaseLaw { law, values: effect.padded(), depends_on_velocity: true });
    }
}

fn law(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    [0.0, 0.0, -p[0] * base.velocity[2]]
}
