//! `base_quadratic_drag`

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place};
use crate::physics::{BaseLaw, BaseMotion, Physics};
use crate::prior::Prior;

pub(super) struct BaseQuadraticDrag;

const ABOUT: About = About {
    id: "base_quadratic_drag",
    sentence: "A force on the base opposes its velocity and grows with the square of the speed.",
    place: Place::Base,
    index: Index::None,
    parameters: &[Parameter::new("coefficient_N_s2_m2", "N s^2/m^2", "force per speed squared")
        .within(0.0, 1000.0)
        .scale(0.5)],
};

impl EffectKind for BaseQuadraticDrag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        let mass = plant.total_mass_kg();
        Prior::sized(&[0.1 * mass], &[1e-4 * mass])
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.base_laws.push(BaseLaw { law, values: effect.padded(), depends_on_velocity: true });
    }
}

fn law(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    let speed = base.velocity[0].hypot(base.velocity[1]);
    [-p[0] * speed * base.velocity[0], -p[0] * speed * base.velocity[1], 0.0]
}
