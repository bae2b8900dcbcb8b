//! Random mechanisms and states.

use std::ops::{Deref, DerefMut};

use fss_multibody::{Base, Coordinates, Link, Model, State};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A generator that says its seed, which the environment variable `FSS_TEST_SEED` replaces.
pub(crate) struct Random(ChaCha8Rng);

impl Random {
    pub(crate) fn announced(test: &str, seed: u64) -> Self {
        let seed = std::env::var("FSS_TEST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(seed);
        println!("{test}: FSS_TEST_SEED={seed}");
        Self(ChaCha8Rng::seed_from_u64(seed))
    }
}

impl Deref for Random {
    type Target = ChaCha8Rng;
    fn deref(&self) -> &ChaCha8Rng {
        &self.0
    }
}

impl DerefMut for Random {
    fn deref_mut(&mut self) -> &mut ChaCha8Rng {
        &mut self.0
    }
}

/// A mechanism with everything that one can have: offset centres of mass, rotors, gravity.
pub(crate) fn random_model(random: &mut Random, links: usize, clamped: bool) -> Model {
    let base = Base {
        mass_kg: random.random_range(2.0..20.0),
        inertia_kg_m2: random.random_range(0.05..0.5),
        com_m: [random.random_range(-0.1..0.1), random.random_range(-0.1..0.1)],
        joint1_xy_m: [random.random_range(-0.3..0.3), random.random_range(-0.3..0.3)],
        joint1_angle_rad: random.random_range(-3.0..3.0),
        clamped,
    };
    let links: Vec<Link> = (0..links)
        .map(|_| Link {
            length_m: random.random_range(0.1..0.6),
            com_to_next_joint_m: random.random_range(-0.1..0.4),
            com_offset_m: random.random_range(-0.05..0.05),
            mass_kg: random.random_range(0.5..5.0),
            inertia_kg_m2: random.random_range(0.005..0.1),
            joint_offset_rad: random.random_range(-0.5..0.5),
            rotor_inertia_kg_m2: random.random_range(0.0..0.05),
        })
        .collect();
    Model::new(base, &links, [random.random_range(-2.0..2.0), random.random_range(-9.81..2.0)]).unwrap()
}

pub(crate) fn random_state(random: &mut Random, dof: usize) -> State {
    let mut draw =
        |size: f64| Coordinates::from_fn(|i, _| if i < dof { random.random_range(-size..size) } else { 0.0 });
    State { q: draw(3.0), v: draw(2.0) }
}
