//! A real laboratory drawn from what a plant file knows about it.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::file::Plant;

impl Plant {
    /// A laboratory as it may really be: every value of `[uncertainty]` off by a normal draw of that spread. Only stamps of link
    /// telemetry are right: it is who receives them that makes them wrong.
    ///
    /// Masses, inertias, lengths and strengths stay positive. The drawn values are exact, so it has no `[uncertainty]`.
    pub fn drawn(&self, seed: u64) -> Self {
        let mut plant = self.clone();
        let Some(u) = plant.uncertainty.take() else {
            return plant;
        };
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut off = |value: &mut f64, std: f64| {
            let normal: f64 = StandardNormal.sample(&mut random);
            *value += std * normal;
        };
        let mut positive = |value: &mut f64, std: f64| {
            let nominal = *value;
            off(value, std);
            *value = value.max(0.05 * nominal);
        };
        positive(&mut plant.base.mass_kg, u.base_mass_kg);
        positive(&mut plant.base.inertia_kg_m2, u.base_inertia_kg_m2);
        for i in 0..plant.thrusters.len() {
            let mut thrust = plant.thrust_n(i);
            positive(&mut thrust, u.thrust_n);
            plant.set_thrust_n(i, thrust);
        }
        for link in &mut plant.links {
            positive(&mut link.length_m, u.link_length_m);
            positive(&mut link.mass_kg, u.link_mass_kg);
            positive(&mut link.inertia_kg_m2, u.link_inertia_kg_m2);
            positive(&mut link.coulomb_friction_n_m, u.coulomb_friction_n_m);
            positive(&mut link.viscous_friction_n_m_s_rad, u.viscous_friction_n_m_s_rad);
            positive(&mut link.torque_constant_n_m_a, u.torque_constant_n_m_a);
        }
        for coordinate in &mut plant.base.joint1_xy_m {
            off(coordinate, u.joint1_xy_m);
        }
        off(&mut plant.base.joint1_angle_rad, u.joint1_angle_rad);
        for link in &mut plant.links {
            off(&mut link.com_to_next_joint_m, u.com_to_next_joint_m);
            off(&mut link.joint_offset_rad, u.joint_offset_rad);
        }
        plant
    }
}
