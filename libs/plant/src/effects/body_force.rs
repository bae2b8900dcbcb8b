//! `body_force`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place};
use crate::physics::{BaseLaw, BaseMotion, Physics};
use crate::prior::Prior;

pub(super) struct BodyForce;

const ABOUT: About = About {
    id: "body_force",
    sentence: "A steady force and torque turn with the base, as of an air pad that leans.",
    place: Place::Base,
    index: Index::None,
    parameters: &[
        Parameter::new("force_x_N", "N", "along the base's x").within(-100.0, 100.0).scale(0.005),
        Parameter::new("force_y_N", "N", "along the base's y").within(-100.0, 100.0).scale(0.005),
        Parameter::new("torque_N_m", "N m", "about the base frame's origin").within(-100.0, 100.0).scale(0.001),
    ],
};

impl EffectKind for BodyForce {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        let (mass, inertia) = (plant.total_mass_kg(), plant.base.inertia_kg_m2);
        Prior::sized(&[1.5e-3 * mass, 1.5e-3 * mass, 5e-3 * inertia], &[1e-5 * mass, 1e-5 * mass, 1e-5 * inertia])
            .of_vector()
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.base_laws.push(BaseLaw { law, values: effect.padded(), depends_on_velocity: false });
    }
}

fn law(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    let (sin, cos) = base.pose[2].sin_cos();
    [cos * p[0] - sin * p[1], sin * p[0] + cos * p[1], p[2]]
}
