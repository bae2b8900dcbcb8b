//! `tether_torsion`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place};
use crate::physics::{BaseLaw, BaseMotion, Physics};
use crate::prior::{Prior, Response};

pub(super) struct TetherTorsion;

const ABOUT: About = About {
    id: "tether_torsion",
    sentence: "A cable or hose twists and turns the base back towards a heading.",
    place: Place::Base,
    index: Index::None,
    parameters: &[
        Parameter::new("stiffness_N_m_rad", "N m/rad", "torque per turn").within(0.0, 100.0).scale(0.01),
        Parameter::new("rest_rad", "rad", "heading without torque").within(-100.0, 100.0).scale(0.3),
    ],
};

impl EffectKind for TetherTorsion {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        let inertia = plant.base.inertia_kg_m2;
        Prior::sized(&[0.1 * inertia; 2], &[1e-5 * inertia; 2]).responding(Response::Strength)
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.base_laws.push(BaseLaw { law, values: effect.padded(), depends_on_velocity: false });
    }
}

fn law(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    [0.0, 0.0, -p[0] * (base.pose[2] - p[1])]
}
