//! `base_coulomb_drag`
//!
//! The base floats, so that the law may be smoothed where the sign would jump: it has its full size
//! from a few times the creep rates below upwards.

use crate::effect::Effect;
use crate::file::Plant;
use crate::kind::{About, EffectKind, Index, MAX_PARAMETERS, Parameter, Place};
use crate::physics::{BaseLaw, BaseMotion, Physics};
use crate::prior::Prior;

pub(super) struct BaseCoulombDrag;

const ABOUT: About = About {
    id: "base_coulomb_drag",
    sentence: "Something rubs: a force and a torque of constant size oppose the motion of the base.",
    place: Place::Base,
    index: Index::None,
    parameters: &[
        Parameter::new("force_N", "N", "size of the force").within(0.0, 100.0).scale(0.005),
        Parameter::new("torque_N_m", "N m", "size of the torque").within(0.0, 100.0).scale(0.001),
    ],
};

impl EffectKind for BaseCoulombDrag {
    fn about(&self) -> &'static About {
        &ABOUT
    }

    fn prior(&self, plant: &Plant, index: Option<usize>) -> Prior {
        let _ = index;
        let (mass, inertia) = (plant.total_mass_kg(), plant.base.inertia_kg_m2);
        Prior::sized(&[1.5e-3 * mass, 5e-3 * inertia], &[1e-6 * mass, 1e-6 * inertia]).of_contact()
    }

    fn act(&self, effect: &Effect, physics: &mut Physics) {
        physics.base_laws.push(BaseLaw { law, values: effect.padded(), depends_on_velocity: true });
    }
}

/// Below about this speed the rubbing is gentler than its full size (m/s).
const CREEP_M_S: f64 = 2e-4;
/// Below about this rate the rubbing is gentler than its full size (rad/s).
const CREEP_RAD_S: f64 = 5e-4;

fn law(p: &[f64; MAX_PARAMETERS], base: &BaseMotion) -> [f64; 3] {
    let [vx, vy, omega] = base.velocity;
    let per_speed = p[0] / (vx * vx + vy * vy + CREEP_M_S * CREEP_M_S).sqrt();
    let per_rate = p[1] / (omega * omega + CREEP_RAD_S * CREEP_RAD_S).sqrt();
    [-per_speed * vx, -per_speed * vy, -per_rate * omega]
}
