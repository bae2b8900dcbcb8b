//! How sensors show what deviates from the predicted motion: as they show the motion itself, late and by their scale.

use super::arrivals::Arrivals;
use super::noise_model::{ARM_MOMENTUM, ARM_SHIFT};
use super::samples::Ages;
use fss_plant::Physics;

/// How sensors show the base's motion.
#[derive(Clone, Copy)]
pub(super) struct Shown {
    /// Reading of the gyro over the rate.
    gyro_scale: f64,
    /// How much older poses are than their stamps say, s.
    pose_age_s: f64,
}

/// States that a row measures, each with its coefficient. Channels are x, y, heading and the gyro's rate.
impl Shown {
    pub(super) fn by(physics: &Physics) -> Self {
        Self { gyro_scale: physics.sensors.gyro_scale, pose_age_s: Ages::of(physics).pose_s }
    }

    /// Of the body, which moves evenly while its pose is on the way.
    pub(super) fn body(self, channel: usize, inertia_kg_m2: f64) -> [(usize, f64); 2] {
        match channel {
            0 | 1 => [(2 * channel, 1.0), (2 * channel + 1, -self.pose_age_s)],
            2 => [(4, 1.0), (5, -self.pose_age_s / inertia_kg_m2)],
            _ => [(4, 0.0), (5, self.gyro_scale / inertia_kg_m2)],
        }
    }

    /// Of the errors of the arm's path, of these standard deviations.
    pub(super) fn arm(
        self,
        channel: usize,
        ([momentum_sd, shift_sd], correlation_s): ([f64; 2], f64),
        inertia_kg_m2: f64,
    ) -> (usize, f64) {
        match channel {
            0 | 1 => (ARM_SHIFT + channel, shift_sd),
            2 => (ARM_MOMENTUM, self.before_s(correlation_s) * momentum_sd / inertia_kg_m2),
            _ => (ARM_MOMENTUM, -self.gyro_scale * momentum_sd / inertia_kg_m2),
        }
    }

    /// Of a joint's datagrams that arrive late, its first state `u`.
    pub(super) fn arrivals(self, channel: usize, (u, arrivals): (usize, &Arrivals), block: usize) -> [(usize, f64); 2] {
        let (moved, lag_s) = (arrivals.moved[block], arrivals.lag_s);
        if channel < 3 {
            let before = moved[channel] * self.before_s(lag_s) / lag_s;
            [(u, -before), (u + 1, moved[channel] + before)]
        } else {
            let rate = self.gyro_scale * moved[2] / lag_s;
            [(u, rate), (u + 1, -rate)]
        }
    }

    /// For how long a rate that fades with this time constant lasts while a pose is on the way.
    fn before_s(self, lag_s: f64) -> f64 {
        lag_s * -(-self.pose_age_s.abs() / lag_s).exp_m1() * self.pose_age_s.signum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(states: &[f64], row: [(usize, f64); 2]) -> f64 {
        row.iter().map(|(state, by)| by * states[*state]).sum()
    }

    #[test]
    fn a_late_pose_shows_what_was_and_an_early_one_what_will_be() {
        let at = |pose_age_s: f64| Shown { gyro_scale: 1.0, pose_age_s };
        // A body that moves evenly.
        let (place, speed, momentum, inertia) = (0.3, 0.05, 0.02, 0.4);
        let states = [place, speed, 0.0, 0.0, 1.0, momentum];
        assert!((measured(&states, at(0.1).body(0, inertia)) - (place - 0.1 * speed)).abs() < 1e-12);
        assert!((measured(&states, at(-0.1).body(2, inertia)) - (1.0 + 0.1 * momentum / inertia)).abs() < 1e-12);
        // A joint that goes to where its datagrams displace it: x' = (u - x) / lag.
        let (u, x, lag_s) = (0.7, 0.2, 0.125);
        let arrivals = Arrivals { time_s: 0.1, lag_s, moved: vec![[1.0, 2.0, 3.0]] };
        let after = u + (x - u) * (-0.05 / lag_s).exp();
        assert!((measured(&[u, x], at(-0.05).arrivals(1, (0, &arrivals), 0)) - 2.0 * after).abs() < 1e-12);
    }
}
