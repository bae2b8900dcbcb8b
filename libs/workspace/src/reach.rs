//! Where the end-effector can be, and how well the arm moves it there (the paper's section 5).

use fss_multibody::wrapped;
use fss_multibody::{Manipulability, Model, coordinates};
use std::f64::consts::{PI, TAU};

/// Steps of the distance from joint 1.
const RINGS: usize = 400;

/// The longest distance of the end-effector from the centre of mass of a floating vehicle, m: the total length of its
/// virtual manipulator (the paper's equations 11 to 13), with the base's `b_0` from its centre of mass to joint 1.
/// Joint limits play no part. `None` for a clamped base, whose centre of mass is not free.
pub fn virtual_manipulator_radius_m(model: &Model) -> Option<f64> {
    let (base, total_kg) = (model.base(), model.total_mass_kg());
    if base.clamped || total_kg <= 0.0 {
        return None;
    }
    let b_0 = (base.joint1_xy_m[0] - base.com_m[0]).hypot(base.joint1_xy_m[1] - base.com_m[1]);
    let mut inner_kg = base.mass_kg;
    let mut radius_m = b_0 * inner_kg / total_kg;
    for link in model.links() {
        let b = link.com_to_next_joint_m;
        radius_m += (link.length_m - b) * inner_kg / total_kg;
        inner_kg += link.mass_kg;
        radius_m += b * inner_kg / total_kg;
    }
    Some(radius_m)
}

/// Where the end-effector can be at one distance from joint 1, base held.
#[derive(Clone, Copy, Debug)]
pub struct Ring {
    /// Distance from joint 1, m.
    pub radius_m: f64,
    /// Least and largest angle about joint 1, base frame, rad; their difference is at most a full turn.
    pub angles_rad: [f64; 2],
}

/// What the end-effector reaches with the base held and joints within plus and minus `limits_rad`: rings of equal width,
/// from the inside out; those it does not reach are missing. Empty for arms of fewer than two links.
///
/// At each distance from joint 1 the directions that joints 2 to n give are one interval (gaps in it are narrower than
/// joint 1's travel), which joint 1 widens by its travel.
pub fn reachable_rings(model: &Model, limits_rad: &[f64]) -> Vec<Ring> {
    let links = model.links();
    if links.len() < 2 || limits_rad.len() < links.len() {
        return Vec::new();
    }
    let reach_m: f64 = links.iter().map(|link| link.length_m).sum();
    let mut ranges = vec![(f64::INFINITY, f64::NEG_INFINITY); RINGS];
    let radius_m = |ring: usize| (ring as f64 + 0.5) * reach_m / RINGS as f64;
    let (first, second) = (links[0].length_m, links[1]);
    for (x, y) in beyond_second_joint(model, limits_rad) {
        let (distance, angle) = (x.hypot(y), y.atan2(x));
        for (ring, range) in ranges.iter_mut().enumerate() {
            // The triangle of joint 1, joint 2 and the tip gives joint 2 for this distance, on either side.
            let r = radius_m(ring);
            let cos = (r * r - first * first - distance * distance) / (2.0 * first * distance);
            if cos.abs() > 1.0 {
                continue;
            }
            for turn in [cos.acos(), -cos.acos()] {
                let q = wrapped(turn - angle - second.joint_offset_rad);
                if q.abs() <= limits_rad[1] {
                    let direction = (distance * turn.sin()).atan2(first + distance * turn.cos());
                    *range = (range.0.min(direction), range.1.max(direction));
                }
            }
        }
    }
    let zero_rad = model.base().joint1_angle_rad + links[0].joint_offset_rad;
    let seen = ranges.iter().enumerate().filter(|(_, range)| range.0 <= range.1);
    seen.map(|(ring, range)| {
        let (middle, half) = (0.5 * (range.0 + range.1), (0.5 * (range.1 - range.0) + limits_rad[0]).min(PI));
        Ring { radius_m: radius_m(ring), angles_rad: [zero_rad + middle - half, zero_rad + middle + half] }
    })
    .collect()
}

/// Area of [`reachable_rings`], m^2.
pub fn fixed_area_m2(model: &Model, limits_rad: &[f64]) -> f64 {
    let width_m = model.links().iter().map(|link| link.length_m).sum::<f64>() / RINGS as f64;
    let length_m = |ring: &Ring| (ring.angles_rad[1] - ring.angles_rad[0]) * ring.radius_m;
    reachable_rings(model, limits_rad).iter().map(length_m).sum::<f64>() * width_m
}

/// The largest manipulability measure (base held, m^2) of all postures that reach a place, for the rings of
/// [`reachable_rings`] and `bearings` equal steps of the angle about joint 1 (base frame), from -pi: `[ring][bearing]`,
/// rings from the inside out, none where no posture of the search came by.
///
/// The measure does not depend on joint 1, so a search over the joints beyond it serves all of its travel.
pub fn best_manipulability_by_place(model: &Model, limits_rad: &[f64], bearings: usize) -> Vec<Vec<Option<f64>>> {
    const POSTURES: usize = 600_000;
    let links = model.links();
    let reach_m: f64 = links.iter().map(|link| link.length_m).sum();
    let mut seen = vec![vec![None; bearings]; RINGS];
    let keep = |slot: &mut Option<f64>, value: f64| *slot = Some(slot.map_or(value, |best: f64| best.max(value)));
    let base = model.base();
    let origin = nalgebra::Vector2::from(base.joint1_xy_m);
    let mut q = vec![0.0; links.len()];
    for index in 1..=POSTURES {
        for i in 1..links.len() {
            q[i] = limits_rad[i] * (2.0 * halton(index, i) - 1.0);
        }
        let tip = model.end_effector(&coordinates([0.0; 3], &q)).xy() - origin;
        let ring = ((tip.norm() / reach_m * RINGS as f64) as usize).min(RINGS - 1);
        let bearing = ((tip.y.atan2(tip.x) + PI) / TAU * bearings as f64) as usize % bearings;
        keep(&mut seen[ring][bearing], manipulability(model, &q, false).measure_m2());
    }
    // Joint 1 turns all of it by up to its limit either way.
    let reach = (limits_rad.first().copied().unwrap_or(0.0) / TAU * bearings as f64) as usize;
    let turned = |ring: &Vec<Option<f64>>| {
        let mut best = vec![None; bearings];
        for (bearing, value) in ring.iter().enumerate().filter_map(|(bearing, value)| value.map(|v| (bearing, v))) {
            for turn in 0..=2 * reach.min(bearings / 2) {
                keep(&mut best[(bearing + bearings + turn - reach.min(bearings / 2)) % bearings], value);
            }
        }
        best
    };
    seen.iter().map(turned).collect()
}

/// The tip seen from joint 2 in link 2's frame, on a grid of the joints beyond.
fn beyond_second_joint(model: &Model, limits_rad: &[f64]) -> Vec<(f64, f64)> {
    let links = model.links();
    let joints = links.len() - 2;
    let steps = if joints <= 2 { 120 } else { (1.5e4_f64).powf(1.0 / joints as f64) as usize };
    let mut points = Vec::new();
    for index in 0..(steps + 1).pow(joints as u32) {
        let (mut x, mut y, mut angle, mut rest) = (links[1].length_m, 0.0, 0.0_f64, index);
        for i in 2..links.len() {
            let q = limits_rad[i] * (2.0 * (rest % (steps + 1)) as f64 / steps as f64 - 1.0);
            rest /= steps + 1;
            angle += q + links[i].joint_offset_rad;
            x += links[i].length_m * angle.cos();
            y += links[i].length_m * angle.sin();
        }
        points.push((x, y));
    }
    points
}

/// Manipulability of a posture with the base held (`floating` false) or floating at zero momentum.
pub fn manipulability(model: &Model, q_rad: &[f64], floating: bool) -> Manipulability {
    let q = coordinates([0.0; 3], q_rad);
    if floating {
        return Manipulability::of(&model.generalized_jacobian(&q));
    }
    Manipulability::of(&model.jacobian(&q).fixed_columns::<{ fss_multibody::MAX_LINKS }>(3).into_owned())
}

/// The largest measure `w2` (m^2) within the joint limits and the posture (rad) that has it: searches from many starts.
pub fn max_manipulability(model: &Model, limits_rad: &[f64], floating: bool) -> (f64, Vec<f64>) {
    const STARTS: usize = 48;
    let of = |q: &[f64]| manipulability(model, q, floating).measure_m2();
    let mut best = (0.0, vec![0.0; limits_rad.len()]);
    for start in 1..=STARTS {
        let mut q: Vec<f64> =
            limits_rad.iter().enumerate().map(|(i, limit)| limit * (2.0 * halton(start, i) - 1.0)).collect();
        let (mut value, mut step) = (of(&q), 0.3);
        while step > 1e-7 {
            let mut improved = false;
            for i in 0..q.len() {
                for sign in [1.0, -1.0] {
                    let before = q[i];
                    q[i] = (before + sign * step).clamp(-limits_rad[i], limits_rad[i]);
                    let moved = of(&q);
                    if moved > value {
                        (value, improved) = (moved, true);
                    } else {
                        q[i] = before;
                    }
                }
            }
            if !improved {
                step *= 0.5;
            }
        }
        if value > best.0 {
            best = (value, q);
        }
    }
    best
}

/// Van der Corput's sequence in the base of the `dimension`-th prime.
fn halton(mut index: usize, dimension: usize) -> f64 {
    const PRIMES: [usize; 8] = [2, 3, 5, 7, 11, 13, 17, 19];
    let prime = PRIMES[dimension % PRIMES.len()];
    let (mut share, mut value) = (1.0, 0.0);
    while index > 0 {
        share /= prime as f64;
        value += share * (index % prime) as f64;
        index /= prime;
    }
    value
}
