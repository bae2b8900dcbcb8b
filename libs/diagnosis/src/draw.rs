//! Causes drawn from the prior that the search compares sets with: what simulation-based calibration hides.

use crate::candidates::{Candidate, Records, candidates};
use crate::problem::is_same;
use crate::search::SIZES;
use fss_plant::{Effect, Plant, Response};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Causes that act in a plant, drawn from the prior of [`crate::diagnose`]. Each is one effect; a law may be two.
///
/// The number of causes, the kind, which of a kind, and the slab or point of each are drawn, then its values within their
/// bounds. `duration_s` is the length of the longest run: frequencies of laws are fractions of it. Spikes are not drawn: what
/// is absent is nominal.
pub fn drawn_causes(plant: &Plant, duration_s: f64, random: &mut ChaCha8Rng) -> Vec<Vec<Effect>> {
    let all = candidates(plant, &Records { duration_s, rates_rad_s: Vec::new(), ranges_rad: Vec::new(), swing: false });
    let mut kinds: Vec<&str> = all.iter().map(|c| c.kind.as_str()).collect();
    kinds.sort_unstable();
    kinds.dedup();
    let size = drawn_size(random);
    // Two kinds never exclude each other: among so many kinds there is always another cause.
    if kinds.len() < SIZES.len() {
        return Vec::new();
    }
    let mut chosen: Vec<&Candidate> = Vec::new();
    while chosen.len() < size {
        let kind = kinds[random.random_range(0..kinds.len())];
        let of_kind: Vec<&Candidate> = all.iter().filter(|c| c.kind == kind).collect();
        let one = of_kind[random.random_range(0..of_kind.len())];
        if !chosen.iter().any(|other| excludes(one, other)) {
            chosen.push(one);
        }
    }
    chosen.into_iter().map(|cause| cause.at(&drawn_coordinates(cause, random))).collect()
}

fn drawn_size(random: &mut ChaCha8Rng) -> usize {
    let mut lot: f64 = random.random();
    for (size, probability) in SIZES.iter().enumerate() {
        lot -= probability;
        if lot < 0.0 {
            return size;
        }
    }
    0
}

/// Whether no set holds both: a cause is in a set once, and of a law one frequency.
fn excludes(a: &Candidate, b: &Candidate) -> bool {
    if a.is_law || b.is_law {
        return a.kind == b.kind;
    }
    is_same(&a.nominal, &b.nominal) && (a.prior.response != Response::Discrete || a.nominal == b.nominal)
}

fn drawn_coordinates(cause: &Candidate, random: &mut ChaCha8Rng) -> Vec<f64> {
    if cause.prior.response == Response::Discrete {
        return vec![1.0];
    }
    let class = random.random_range(0..cause.classes());
    let drawn = |i: usize| match cause.prior_in(class, i) {
        (0.0, sd) => within(cause.bounds(i), sd, random),
        (mean, sd) => mean + sd * normal(random),
    };
    let mut coordinates: Vec<f64> = (0..cause.size).map(drawn).collect();
    // Up to half of the way to the neighbours.
    let shape =
        cause.shapes().filter(|_| !cause.is_law).map(|[from, to]| from + (to - from) * random.random_range(0.25..0.75));
    coordinates.extend(shape);
    coordinates
}

/// A normal value about 0, which lies within the bounds.
fn within([lower, upper]: [f64; 2], sd: f64, random: &mut ChaCha8Rng) -> f64 {
    loop {
        let value = sd * normal(random);
        if (lower..=upper).contains(&value) {
            return value;
        }
    }
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn sizes_are_as_often_as_their_prior_and_values_are_within_bounds() {
        let mut plant = Plant::default_laboratory().unwrap();
        plant.links.clear();
        let seed = 5;
        println!("seed {seed}");
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let count = 2000;
        let mut of_size = [0.0; SIZES.len()];
        for _ in 0..count {
            let causes = drawn_causes(&plant, 33.0, &mut random);
            of_size[causes.len()] += 1.0 / f64::from(count);
            for effect in causes.iter().flatten() {
                for (value, parameter) in effect.values().iter().zip(effect.about().parameters) {
                    assert!((parameter.lower..=parameter.upper).contains(value), "{effect}");
                }
            }
        }
        for (share, prior) in of_size.iter().zip(SIZES) {
            let deviation = (prior * (1.0 - prior) / f64::from(count)).sqrt();
            assert!((share - prior).abs() < 4.0 * deviation, "{of_size:?}");
        }
    }
}
