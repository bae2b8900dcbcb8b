//! `tether_linear`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place};
use crate::physics::{BaseLaw, BaseMotion, Physics};
use crate::prior::{Prior, Response};

pub(super) struct TetherLinear;

const ABOUT: About = About {
    id: "tether_linear",
    sentence: "A cable or hose pulls the base towards a place in proportion to the distance.",
    place: Place::Base,
    index: Index::None,
    parameters: &[
        Parameter::new("stiffness_N_m", "N/m", "force per distance").within(0.0, 1000.0).scale(0.01),
        Parameter::new("anchor_x_m", "m", "place without force, table frame").within(-100.0, 100.0).scale(0.3),
        Parameter::new("anchor_y_m", "m", "place without force, table frame").within(-100.0, 100.0).scale(0.3),
    ],
};

impl EffectKind for TetherLinear {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        let mass = plant.total_mass_kg();
        Prior::sized(&[0.02 * mass; 3], &[1e-5 * mass; 3]).responding(Response::Strength)
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.base_laws.push(BaseLaw { law, values: effect.padded(), depends_on_velocity: false });
    }
}

fn law(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    [-p[0] * (base.pose[0] - p[1]), -p[0] * (base.pose[1] - p[2]), 0.0]
}
