//! `base_linear_drag`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place};
use crate::physics::{BaseLaw, BaseMotion, Physics};
use crate::prior::Prior;

pub(super) struct BaseLinearDrag;

const ABOUT: About = About {
    id: "base_linear_drag",
    sentence: "A force on the base opposes its velocity in proportion to it.",
    place: Place::Base,
    index: Index::None,
    parameters: &[Parameter::new("coefficient_N_s_m", "N s/m", "force per speed").within(0.0, 100.0).scale(0.05)],
};

impl EffectKind for BaseLinearDrag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        let mass = plant.total_mass_kg();
        Prior::sized(&[0.015 * mass], &[1e-4 * mass])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.base_laws.push(BaseLaw { law, values: effect.padded(), depends_on_velocity: true });
    }
}

fn law(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    [-p[0] * base.velocity[0], -p[0] * base.velocity[1], 0.0]
}
