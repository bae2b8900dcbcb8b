//! Starts that a seed draws.

use super::{Initial, Mission, TargetBody};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Ranges of what is added to a start; all zero adds nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ranges {
    /// Position along the table's x axis, m.
    pub x_m: [f64; 2],
    /// Position along the table's y axis, m.
    pub y_m: [f64; 2],
    /// Heading, rad.
    pub theta_rad: [f64; 2],
    /// Speed of the centre of mass, in any direction, m/s.
    pub drift_m_s: [f64; 2],
    /// Rate of the whole about its centre of mass, to either side, rad/s.
    pub spin_rad_s: [f64; 2],
}

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Draw {
    /// Added to the pose: m, m, rad.
    pub pose: [f64; 3],
    /// Added to the velocity of the centre of mass and to the rate: m/s, m/s, rad/s.
    pub velocity: [f64; 3],
}

impl Ranges {
    /// One start from these ranges; every number costs the generator as much whatever its range.
    fn draw(&self, random: &mut ChaCha8Rng) -> Draw {
        let mut within = |[low, high]: [f64; 2]| low + (high - low) * random.random::<f64>();
        let pose = [within(self.x_m), within(self.y_m), within(self.theta_rad)];
        let (speed, direction) = (within(self.drift_m_s), within([0.0, TAU]));
        let (spin, side) = (within(self.spin_rad_s), within([0.0, 1.0]));
        let omega = if side < 0.5 { -spin } else { spin };
        Draw { pose, velocity: [speed * direction.cos(), speed * direction.sin(), omega] }
    }
}

impl Mission {
    /// What `seed` adds to the starts of the vehicle and of the target.
    pub fn drawn(&self, seed: u64) -> [Draw; 2] {
        // A stream of its own, apart from the laboratory's.
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(0x5_7A57);
        let Initial { ranges, .. } = &self.initial;
        let of_target = self.target.as_ref().map_or(Ranges::default(), |TargetBody { ranges, .. }| *ranges);
        [ranges.draw(&mut random), of_target.draw(&mut random)]
    }
}
