//! The air of the room.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::file::Plant;

/// Room air: an Ornstein-Uhlenbeck process in force and torque, or the sum of two independent ones.
#[derive(Debug, Clone)]
pub(crate) struct Room {
    first: Process,
    second: Option<Process>,
    sum: [f64; 3],
    random: ChaCha8Rng,
}

/// A stationary Ornstein-Uhlenbeck process in each of force x, force y and torque.
#[derive(Debug, Clone)]
struct Process {
    std: [f64; 3],
    correlation_s: f64,
    now: [f64; 3],
}

impl Room {
    /// The room of the plant, if its air moves.
    pub(crate) fn new(plant: &Plant, seed: u64) -> Option<Self> {
        let disturbance = plant.disturbance.as_ref()?;
        let (force, torque) = (disturbance.force_std_n, disturbance.torque_std_n_m);
        let process = |variance_share: f64, correlation_s: f64| Process {
            std: [force, force, torque].map(|std| std * variance_share.max(0.0).sqrt()),
            correlation_s,
            now: [0.0; 3],
        };
        let second_share = disturbance.second.as_ref().map_or(0.0, |second| second.variance_share);
        let mut room = Self {
            first: process(1.0 - second_share, disturbance.correlation_s),
            second: disturbance.second.as_ref().map(|second| process(second_share, second.correlation_s)),
            sum: [0.0; 3],
            random: ChaCha8Rng::seed_from_u64(seed),
        };
        room.step(f64::INFINITY);
        Some(room)
    }

    /// Exact transition over `dt_s`; the stationary process has the given spread.
    pub(crate) fn step(&mut self, dt_s: f64) {
        self.first.step(dt_s, &mut self.random);
        self.sum = self.first.now;
        if let Some(second) = &mut self.second {
            second.step(dt_s, &mut self.random);
            self.sum.iter_mut().zip(second.now).for_each(|(sum, own)| *sum += own);
        }
    }

    /// Force and torque on the base now, table axes (N, N, N m).
    pub(crate) fn now(&self) -> &[f64; 3] {
        &self.sum
    }
}

impl Process {
    fn step(&mut self, dt_s: f64, random: &mut ChaCha8Rng) {
        let keep = (-dt_s / self.correlation_s).exp();
        let fresh = (1.0 - keep * keep).sqrt();
        for (value, std) in self.now.iter_mut().zip(self.std) {
            let normal: f64 = StandardNormal.sample(random);
            *value = keep * *value + fresh * std * normal;
        }
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;
    use crate::parts::{Disturbance, SecondProcess};

    #[test]
    fn two_processes_keep_the_stated_spread_and_have_both_correlation_times() {
        let mut plant = Plant::default_laboratory().expect("the default plant");
        plant.disturbance = Some(Disturbance {
            force_std_n: 0.5,
            torque_std_n_m: 0.1,
            correlation_s: 4.0,
            second: Some(SecondProcess { variance_share: 0.4, correlation_s: 0.5 }),
        });
        let mut room = Room::new(&plant, 7).expect("the air moves");
        let (dt_s, lag, count) = (0.1, 10, 400_000);
        let force: Vec<f64> = (0..count)
            .map(|_| {
                room.step(dt_s);
                room.now()[0]
            })
            .collect();
        let product = |lag: usize| force.windows(lag + 1).map(|w| w[0] * w[lag]).sum::<f64>() / (count - lag) as f64;
        assert!((product(0) / 0.25 - 1.0).abs() < 0.05, "variance {}", product(0));
        let lag_s = lag as f64 * dt_s;
        let expected = 0.25 * (0.6 * (-lag_s / 4.0_f64).exp() + 0.4 * (-lag_s / 0.5_f64).exp());
        assert!((product(lag) / expected - 1.0).abs() < 0.1, "{} for {expected}", product(lag));
    }
}
