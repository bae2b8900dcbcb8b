//! Where to measure: the postures that determine the kinematic parameters best, and how well, beforehand.
//!
//! The information of a set of postures is the sum of `J' W J` over them, `J` the Jacobian of the end-effector's pose by the
//! parameters; its inverse is the covariance to expect. The best postures leave the least of it, by a [`Criterion`]. They are
//! found by exchange (Fedorov, *Theory of Optimal Experiments*, 1972): from several starts, each posture in turn is replaced by
//! the best of many candidates, and then moved joint by joint as long as that helps.

use super::kinematic::{Choice, unknowns};
use fss_multibody::{Model, coordinates};
use nalgebra::{DMatrix, Vector2};
use rayon::prelude::*;

/// What the best postures make smallest. Neither depends on the units of the parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Criterion {
    /// The product of the standard deviations: the box of the intervals that the estimate will be told with.
    #[default]
    Intervals,
    /// The determinant of the covariance, the volume of the ellipsoid of confidence (D-optimal). Parameters that trade
    /// against each other, as neighbouring joint offsets do, may stay wide as long as the ellipsoid is thin.
    Volume,
    /// The variance of one unknown, by its place among them; says how well it can be known at all (c-optimal).
    One(usize),
}

/// What postures are possible and how they are measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// Joints stay between minus and plus this, rad.
    pub joint_rad: Vec<f64>,
    /// Joints, tip and all links but the first keep this far from the base's centre, m.
    pub clearance_m: f64,
    /// Links that are not neighbours keep their middle lines this far from each other, m.
    pub link_clearance_m: f64,
    /// Standard deviations of one posture: position of the end-effector m, its angle rad.
    pub noise: [f64; 2],
}

/// Postures with what they are worth.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Encoder angles of each posture, rad, in an order that keeps the ways short.
    pub postures: Vec<Vec<f64>>,
    /// Name and expected standard deviation of each parameter.
    pub expected: Vec<(String, f64)>,
    /// Ways from one posture to the next on which the arm would touch the base or itself, did all joints start and end
    /// together.
    pub blocked: usize,
}

/// Candidates that an exchange looks at.
const CANDIDATES: usize = 300;
/// Starts; the best end counts.
const STARTS: usize = 6;
/// Steps in which a joint is moved at the end, rad.
const STEPS_RAD: [f64; 5] = [0.4, 0.2, 0.1, 0.03, 0.01];
/// Rounds through all postures with each step at most.
const ROUNDS: usize = 20;
/// An improvement by less is none.
const NEGLIGIBLE: f64 = 1e-6;
/// No two postures are nearer than this in all joints, rad: what is wrong with a posture would be wrong with both.
const APART_RAD: f64 = 0.2;
/// Where a way is looked at, and what a way that is not clear counts for, rad.
const WAY_STEPS: usize = 24;
const BLOCKED_RAD: f64 = 100.0;
/// Information that is there without any posture, so that the first few can be compared.
const PRIOR: f64 = 1e-6;

/// Fewest postures that determine all parameters: each gives three numbers.
pub fn fewest(model: &Model, choice: Choice) -> usize {
    unknowns(model, choice).len().div_ceil(3)
}

/// The best `count` postures.
pub fn plan(model: &Model, limits: &Limits, count: usize, choice: Choice, criterion: Criterion) -> Plan {
    let design = Design { model, limits, parts: unknowns(model, choice), criterion };
    let candidates: Vec<Vec<f64>> =
        (1..).map(|k| design.candidate(k)).filter(|q| design.fits(q)).take(CANDIDATES).collect();
    let from = |start: usize| {
        let first = |k: usize| candidates[(k * STARTS + start) * 7 % candidates.len()].clone();
        let mut postures: Vec<Vec<f64>> = (0..count).map(first).collect();
        design.exchange(&mut postures, &candidates);
        design.polish(&mut postures);
        (design.worth(&design.total(&postures)), postures)
    };
    let ends: Vec<_> = (0..STARTS).into_par_iter().map(from).collect();
    let best = ends.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
    let postures = design.in_order(best.map_or_else(Vec::new, |(_, postures)| postures));
    let expected = design.expected(&postures);
    let blocked = postures.windows(2).filter(|pair| !design.is_clear_between(&pair[0], &pair[1])).count();
    Plan { postures, expected, blocked }
}

/// Expected standard deviations of the parameters from given postures.
pub fn expected(model: &Model, limits: &Limits, postures: &[Vec<f64>], choice: Choice) -> Vec<(String, f64)> {
    Design { model, limits, parts: unknowns(model, choice), criterion: Criterion::default() }.expected(postures)
}

struct Design<'a> {
    model: &'a Model,
    limits: &'a Limits,
    parts: Vec<(super::Unknown, Vec<fss_multibody::Parameter>)>,
    criterion: Criterion,
}

impl Design<'_> {
    /// Quasi-random angles that fill the joints' ranges evenly (Halton, 1960).
    fn candidate(&self, k: usize) -> Vec<f64> {
        const PRIMES: [usize; fss_multibody::MAX_LINKS] = [2, 3, 5, 7, 11, 13, 17, 19];
        let radical = |base: usize| {
            let (mut rest, mut place, mut value) = (k, 1.0 / base as f64, 0.0);
            while rest > 0 {
                value += (rest % base) as f64 * place;
                rest /= base;
                place /= base as f64;
            }
            value
        };
        self.limits.joint_rad.iter().zip(PRIMES).map(|(limit, base)| (2.0 * radical(base) - 1.0) * limit).collect()
    }

    /// Whether the arm keeps clear of its stops, of the base and of itself.
    fn fits(&self, q_rad: &[f64]) -> bool {
        q_rad.iter().zip(&self.limits.joint_rad).all(|(q, limit)| q.abs() <= *limit) && self.is_clear(q_rad)
    }

    fn is_clear(&self, q_rad: &[f64]) -> bool {
        let k = self.model.kinematics(&coordinates([0.0; 3], q_rad));
        let link = |i: usize| (k.joints[i], k.joints[i + 1]);
        let n = q_rad.len();
        let center = Vector2::zeros();
        (1..n).all(|i| to_segment(center, link(i)) > self.limits.clearance_m)
            && k.joints[n.min(1)].norm() > self.limits.clearance_m
            && (2..n).all(|i| (0..i - 1).all(|j| between(link(i), link(j)) > self.limits.link_clearance_m))
    }

    /// Whether the arm keeps clear on the straight way of the joints from one posture to another.
    fn is_clear_between(&self, from: &[f64], to: &[f64]) -> bool {
        let at = |s: f64| -> Vec<f64> { from.iter().zip(to).map(|(a, b)| a + s * (b - a)).collect() };
        (1..WAY_STEPS).all(|k| self.is_clear(&at(k as f64 / WAY_STEPS as f64)))
    }

    /// From the first posture always to the one that is reached soonest on a way that is clear, or, where none is, soonest.
    fn in_order(&self, mut postures: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        let away = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        for i in 1..postures.len() {
            let cost = |k: usize| {
                let (before, next) = (&postures[i - 1], &postures[k]);
                away(before, next) + if self.is_clear_between(before, next) { 0.0 } else { BLOCKED_RAD }
            };
            let next = (i..postures.len()).min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
            postures.swap(i, next.unwrap_or(i));
        }
        postures
    }

    /// Information of one posture, parameters in units of what is plausible.
    fn information(&self, q_rad: &[f64]) -> DMatrix<f64> {
        let q = coordinates([0.0; 3], q_rad);
        let mut jacobian = DMatrix::<f64>::zeros(3, self.parts.len());
        for (j, (unknown, places)) in self.parts.iter().enumerate() {
            for place in places {
                let by = self.model.end_effector_by_parameter(&q, *place) * unknown.plausible;
                for row in 0..3 {
                    jacobian[(row, j)] += by[row] / self.limits.noise[usize::from(row == 2)];
                }
            }
        }
        jacobian.transpose() * jacobian
    }

    fn total(&self, postures: &[Vec<f64>]) -> DMatrix<f64> {
        let start = DMatrix::identity(self.parts.len(), self.parts.len()) * PRIOR;
        postures.iter().fold(start, |sum, q| sum + self.information(q))
    }

    fn exchange(&self, postures: &mut [Vec<f64>], candidates: &[Vec<f64>]) {
        let known: Vec<DMatrix<f64>> = candidates.iter().map(|q| self.information(q)).collect();
        loop {
            let mut improved = false;
            for i in 0..postures.len() {
                let total = self.total(postures);
                let rest = &total - self.information(&postures[i]);
                let (mut best, mut most) = (None, self.worth(&total) + NEGLIGIBLE);
                let free = |candidate: &[f64]| is_apart(postures, i, candidate);
                for (candidate, information) in candidates.iter().zip(&known).filter(|(candidate, _)| free(candidate)) {
                    let value = self.worth(&(&rest + information));
                    if value > most {
                        (best, most) = (Some(candidate), value);
                    }
                }
                if let Some(candidate) = best {
                    postures[i].clone_from(candidate);
                    improved = true;
                }
            }
            if !improved {
                return;
            }
        }
    }

    fn polish(&self, postures: &mut [Vec<f64>]) {
        for step in STEPS_RAD {
            for _ in 0..ROUNDS {
                let moved = (0..postures.len()).filter(|i| self.polish_one(postures, *i, step)).count();
                if moved == 0 {
                    break;
                }
            }
        }
    }

    /// Moves the joints of one posture by a step where that helps; whether it did.
    fn polish_one(&self, postures: &mut [Vec<f64>], i: usize, step: f64) -> bool {
        let rest = self.total(postures) - self.information(&postures[i]);
        let value = |q: &[f64]| self.worth(&(&rest + self.information(q)));
        let (mut most, mut improved) = (value(&postures[i]), false);
        for joint in 0..postures[i].len() {
            for by in [step, -step] {
                let mut moved = postures[i].clone();
                let limit = self.limits.joint_rad[joint];
                moved[joint] = (moved[joint] + by).clamp(-limit, limit);
                let now = value(&moved);
                if now > most + NEGLIGIBLE && self.fits(&moved) && is_apart(postures, i, &moved) {
                    (postures[i], most, improved) = (moved, now, true);
                }
            }
        }
        improved
    }

    /// How good an information is: the logarithm of what the criterion makes smallest, with the other sign.
    fn worth(&self, information: &DMatrix<f64>) -> f64 {
        let Some(factor) = information.clone().cholesky() else { return f64::NEG_INFINITY };
        match self.criterion {
            Criterion::Volume => factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum(),
            Criterion::Intervals => -factor.inverse().diagonal().iter().map(|variance| variance.ln()).sum::<f64>(),
            Criterion::One(j) => -factor.inverse()[(j, j)].ln(),
        }
    }

    fn expected(&self, postures: &[Vec<f64>]) -> Vec<(String, f64)> {
        let covariance = self.total(postures).try_inverse();
        let of = |j: usize| covariance.as_ref().map_or(f64::INFINITY, |c| c[(j, j)].sqrt());
        self.parts.iter().enumerate().map(|(j, (u, _))| (u.name.clone(), of(j) * u.plausible)).collect()
    }
}

/// Whether a posture may stand in the place of the `i`-th.
fn is_apart(postures: &[Vec<f64>], i: usize, q_rad: &[f64]) -> bool {
    let differs = |other: &[f64]| q_rad.iter().zip(other).any(|(a, b)| (a - b).abs() >= APART_RAD);
    postures.iter().enumerate().all(|(j, other)| j == i || differs(other))
}

type Segment = (Vector2<f64>, Vector2<f64>);

/// Distance of a point from a segment.
fn to_segment(point: Vector2<f64>, (a, b): Segment) -> f64 {
    let along = b - a;
    let share = ((point - a).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (a + along * share - point).norm()
}

/// Distance of two segments of a plane; zero where they cross.
fn between(one: Segment, other: Segment) -> f64 {
    let side = |(a, b): Segment, point: Vector2<f64>| (b - a).perp(&(point - a));
    let parted = |by: Segment, ends: Segment| side(by, ends.0) * side(by, ends.1) > 0.0;
    if !parted(one, other) && !parted(other, one) {
        return 0.0;
    }
    let ends = [to_segment(one.0, other), to_segment(one.1, other), to_segment(other.0, one), to_segment(other.1, one)];
    ends.into_iter().fold(f64::INFINITY, f64::min)
}
