//! The air of the room.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::file::Plant;

/// Room air: an Ornstein-Uhlenbeck process in force and torque.
#[derive(Debug, Clone)]
pub(crate) struct Room {
    std: [f64; 3],
    correlation_s: f64,
    now: [f64; 3],
    random: ChaCha8Rng,
}

impl Room {
    /// The room of the plant, if its air moves.
    pub(crate) fn new(plant: &Plant, seed: u64) -> Option<Self> {
        let disturbance = plant.disturbance.as_ref()?;
        let force = disturbance.force_std_n;
        let mut room = Self {
            std: [force, force, disturbance.torque_std_n_m],
            correlation_s: disturbance.correlation_s,
            now: [0.0; 3],
            random: ChaCha8Rng::seed_from_u64(seed),
        };
        room.mix(0.0);
        Some(room)
    }

    /// Exact transition over `dt_s`; the stationary process has the given spread.
    pub(crate) fn step(&mut self, dt_s: f64) {
        self.mix((-dt_s / self.correlation_s).exp());
    }

    /// Force and torque on the base now, table axes (N, N, N m).
    pub(crate) fn now(&self) -> &[f64; 3] {
        &self.now
    }

    fn mix(&mut self, keep: f64) {
        let fresh = (1.0 - keep * keep).sqrt();
        for (value, std) in self.now.iter_mut().zip(self.std) {
            let normal: f64 = StandardNormal.sample(&mut self.random);
            *value = keep * *value + fresh * std * normal;
        }
    }
}
