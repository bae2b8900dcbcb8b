//! Vehicles: the plant file's own in a third of the seeds, others drawn around it.
//!
//! A drawn vehicle has zero to four links and other masses, lengths, drives, thrusters, sensors and rates. Its plant file
//! states how well these are known in the same proportion as the default one, within a factor of two.

use fss_plant::{Link, Plant, Thruster, Uncertainty};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Share of the seeds that keep the plant file's vehicle.
const OWN_SHARE: f64 = 1.0 / 3.0;
/// Most links of a drawn vehicle.
const MOST_LINKS: usize = 4;
/// The random stream of a seed that draws its vehicle.
const STREAM: u64 = 1;

/// The plant of a seed's vehicle, and whether it is `own`.
pub(super) fn draw(seed: u64, own: &Plant) -> (Plant, bool) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(STREAM);
    if random.random::<f64>() < OWN_SHARE {
        return (own.clone(), true);
    }
    let mut plant = own.clone();
    let dice = &mut random;
    base(&mut plant, dice);
    thrusters(&mut plant, dice);
    let count = dice.random_range(0..=MOST_LINKS);
    plant.links = own.links.first().map_or_else(Vec::new, |like| (0..count).map(|_| link(like, dice)).collect());
    sensors(&mut plant, dice);
    plant.uncertainty = own.uncertainty.as_ref().map(|known| uncertainty(known, own, &plant, dice));
    (plant, false)
}

/// Evenly distributed in the logarithm, between `low` and `high` times `value`.
fn scaled(value: f64, low: f64, high: f64, dice: &mut ChaCha8Rng) -> f64 {
    value * low * (high / low).powf(dice.random())
}

fn base(plant: &mut Plant, dice: &mut ChaCha8Rng) {
    let base = &mut plant.base;
    base.mass_kg = scaled(base.mass_kg, 0.5, 2.0, dice);
    // A plate or a ring: radius of gyration 0.12 to 0.20 m.
    base.inertia_kg_m2 = base.mass_kg * dice.random_range(0.12_f64..0.20).powi(2);
    let (radius_m, bearing_rad) = (dice.random_range(0.15..0.25), dice.random_range(-0.5_f64..0.5));
    base.joint1_xy_m = [radius_m * bearing_rad.cos(), radius_m * bearing_rad.sin()];
    base.joint1_angle_rad = dice.random_range(-0.4..0.4);
}

/// Two thrusters a side, in the order of the default vehicle: each pair spans a force and both torques. The two of a pair are
/// turned by the same angle to opposite sides, so that together they push at right angles to their side.
fn thrusters(plant: &mut Plant, dice: &mut ChaCha8Rng) {
    let thrust_n = scaled(plant.typical_thrust_n(), 0.5, 2.0, dice);
    let (half_m, turn_rad) = (dice.random_range(0.1..0.2), dice.random_range(-0.2_f64..0.2));
    let apart_m = half_m * dice.random_range(0.35..0.8);
    let valves = &mut plant.valves;
    for time_s in [&mut valves.delay_s, &mut valves.rise_s, &mut valves.fall_s] {
        *time_s = scaled(*time_s, 0.5, 2.0, dice);
    }
    valves.droop_fraction_per_extra_valve = dice.random_range(0.0..0.03);
    plant.base.thrust_n = Some(thrust_n);
    plant.base.size_m = [2.0 * half_m; 2];
    let (sin, cos) = turn_rad.sin_cos();
    // Outward normals of the four sides: front, back, left, right.
    let sides: [[f64; 2]; 4] = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
    plant.thrusters = (sides.iter())
        .flat_map(|[nx, ny]| {
            // The first of a pair lies towards positive y on front and back, towards positive x on left and right.
            let along = [ny.abs(), nx.abs()];
            [1.0, -1.0].map(|sign| Thruster {
                position_m: [half_m * nx + sign * apart_m * along[0], half_m * ny + sign * apart_m * along[1]],
                force_direction: [-cos * nx + sign * sin * along[0], -cos * ny + sign * sin * along[1]],
                thrust_n: None,
                thrust_curve: None,
                lag_s: None,
            })
        })
        .collect();
}

fn link(like: &Link, dice: &mut ChaCha8Rng) -> Link {
    let mut link = like.clone();
    link.length_m = scaled(0.3, 0.7, 1.4, dice);
    link.mass_kg = scaled(like.mass_kg, 0.4, 1.4, dice);
    link.com_to_next_joint_m = link.length_m * dice.random_range(0.4..0.6);
    link.inertia_kg_m2 = link.mass_kg * (link.length_m * dice.random_range(0.25..0.33)).powi(2);
    link.joint_offset_rad = dice.random_range(-0.1..0.1);
    link.joint_limit_rad = dice.random_range(1.2..2.4);
    link.coulomb_friction_n_m = scaled(like.coulomb_friction_n_m, 0.4, 2.0, dice);
    link.viscous_friction_n_m_s_rad = scaled(like.viscous_friction_n_m_s_rad, 0.4, 2.0, dice);
    link.torque_constant_n_m_a = scaled(like.torque_constant_n_m_a, 0.5, 2.0, dice);
    link.max_torque_n_m = scaled(like.max_torque_n_m, 0.8, 1.8, dice);
    link
}

fn sensors(plant: &mut Plant, dice: &mut ChaCha8Rng) {
    // The torque sensor's range stays in proportion to the strongest motor.
    let strongest_n_m = plant.links.iter().map(|link| link.max_torque_n_m).fold(0.0, f64::max);
    let s = &mut plant.sensors;
    s.torque_range_n_m = s.torque_range_n_m.map(|range| range.max(1.2 * strongest_n_m));
    for std in s.noises_mut() {
        *std = scaled(*std, 0.5, 2.0, dice);
    }
    s.mocap_rate_hz = scaled(s.mocap_rate_hz, 0.6, 1.5, dice).round();
    s.gyro_rate_hz = scaled(s.gyro_rate_hz, 0.6, 1.2, dice).round();
    s.link_rate_hz = scaled(s.link_rate_hz, 1.0, 4.0, dice).round();
    s.mocap_latency_s = scaled(s.mocap_latency_s, 0.5, 2.0, dice);
    if let Some(air) = &mut plant.disturbance {
        air.force_std_n = scaled(air.force_std_n, 0.5, 2.0, dice);
        air.torque_std_n_m = scaled(air.torque_std_n_m, 0.5, 2.0, dice);
        air.correlation_s = scaled(air.correlation_s, 0.5, 2.0, dice);
    }
}

/// Mass and inertia of the base, strength of the thrusters, and the links' mean length, mass, inertia, frictions and torque
/// constant.
fn scales(plant: &Plant) -> [f64; 9] {
    let links = &plant.links;
    let mean = |of: fn(&Link) -> f64| links.iter().map(of).sum::<f64>() / links.len().max(1) as f64;
    [
        plant.base.mass_kg,
        plant.base.inertia_kg_m2,
        plant.typical_thrust_n(),
        mean(|l| l.length_m),
        mean(|l| l.mass_kg),
        mean(|l| l.inertia_kg_m2),
        mean(|l| l.coulomb_friction_n_m),
        mean(|l| l.viscous_friction_n_m_s_rad),
        mean(|l| l.torque_constant_n_m_a),
    ]
}

/// The standard deviations that `known` states of `own`, in proportion to a vehicle of other scales.
fn uncertainty(known: &Uncertainty, own: &Plant, plant: &Plant, dice: &mut ChaCha8Rng) -> Uncertainty {
    let (before, after) = (scales(own), scales(plant));
    let ratio = |i: usize| if before[i] > 0.0 { after[i] / before[i] } else { 1.0 };
    let mut stated = known.clone();
    stated.base_mass_kg *= ratio(0);
    stated.base_inertia_kg_m2 *= ratio(1);
    stated.thrust_n *= ratio(2);
    stated.link_length_m *= ratio(3);
    stated.com_to_next_joint_m *= ratio(3);
    stated.link_mass_kg *= ratio(4);
    stated.link_inertia_kg_m2 *= ratio(5);
    stated.coulomb_friction_n_m *= ratio(6);
    stated.viscous_friction_n_m_s_rad *= ratio(7);
    stated.torque_constant_n_m_a *= ratio(8);
    for std in [
        &mut stated.base_mass_kg,
        &mut stated.base_inertia_kg_m2,
        &mut stated.joint1_xy_m,
        &mut stated.joint1_angle_rad,
        &mut stated.link_length_m,
        &mut stated.com_to_next_joint_m,
        &mut stated.link_mass_kg,
        &mut stated.link_inertia_kg_m2,
        &mut stated.joint_offset_rad,
        &mut stated.coulomb_friction_n_m,
        &mut stated.viscous_friction_n_m_s_rad,
        &mut stated.torque_constant_n_m_a,
        &mut stated.thrust_n,
    ] {
        *std = scaled(*std, 0.5, 2.0, dice);
    }
    stated
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    #[test]
    fn every_vehicle_is_a_plant_file_and_a_third_is_the_own_one() {
        let own = Plant::default_laboratory().unwrap();
        let drawn: Vec<(Plant, bool)> = (0..300).map(|seed| draw(seed, &own)).collect();
        let kept = drawn.iter().filter(|(_, is_own)| *is_own).count();
        assert!((75..125).contains(&kept), "{kept} of 300");
        for (plant, _) in &drawn {
            let again = Plant::parse(&plant.to_toml().unwrap()).unwrap();
            assert_eq!(&again, plant);
        }
        for links in 0..=MOST_LINKS {
            assert!(drawn.iter().any(|(plant, _)| plant.link_count() == links), "no vehicle has {links} links");
        }
    }

    #[test]
    fn thrusters_span_force_and_torque_to_all_sides() {
        let own = Plant::default_laboratory().unwrap();
        for seed in 0..100 {
            let (plant, _) = draw(seed, &own);
            let wrenches: Vec<Vector3<f64>> =
                (0..plant.thrusters.len()).map(|i| Vector3::from(plant.thruster_wrench(i))).collect();
            // All open together they cancel, and they span three dimensions: so any wrench is a non-negative combination.
            let sum: Vector3<f64> = wrenches.iter().sum();
            assert!(sum.norm() < 1e-9, "seed {seed}: {sum}");
            let spread: Matrix3<f64> = wrenches.iter().map(|w| w * w.transpose()).sum();
            let least = spread.symmetric_eigenvalues().min();
            assert!(least > 1e-6, "seed {seed}: {least}");
        }
    }
}
