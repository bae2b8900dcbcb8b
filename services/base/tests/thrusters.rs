//! Which thrusters open for a wanted wrench, against the least gas that could make it.
#![allow(clippy::unwrap_used)]

use fss_base::allocation::{Allocator, Wrench};
use fss_plant::Plant;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SEED: u64 = 20_261_121;

fn wrenches() -> Vec<Wrench> {
    let plant = Plant::default_laboratory().unwrap();
    (0..8).map(|i| plant.thruster_wrench(i)).collect()
}

fn made(wrenches: &[Wrench], duty: &[f64]) -> Wrench {
    std::array::from_fn(|axis| wrenches.iter().zip(duty).map(|(w, u)| w[axis] * u).sum())
}

fn determinant([a, b, c]: [Wrench; 3]) -> f64 {
    a[0] * (b[1] * c[2] - b[2] * c[1]) - b[0] * (a[1] * c[2] - a[2] * c[1]) + c[0] * (a[1] * b[2] - a[2] * b[1])
}

/// The smallest sum of open shares that makes a small wrench: a vertex of the linear program, which opens at most three
/// thrusters, so all triples are tried (Cramer's rule).
fn least_gas(wrenches: &[Wrench], wanted: Wrench) -> f64 {
    let mut least = f64::INFINITY;
    for i in 0..wrenches.len() {
        for j in 0..i {
            for k in 0..j {
                let triple = [wrenches[i], wrenches[j], wrenches[k]];
                let whole = determinant(triple);
                let share = |place: usize| {
                    let mut replaced = triple;
                    replaced[place] = wanted;
                    determinant(replaced) / whole
                };
                let shares = [share(0), share(1), share(2)];
                if whole.abs() > 1e-9 && shares.iter().all(|u| (-1e-9..=1.0).contains(u)) {
                    least = least.min(shares.iter().sum());
                }
            }
        }
    }
    least
}

#[test]
fn any_wrench_is_made_with_hardly_more_than_the_least_gas() {
    println!("seed {SEED}");
    let wrenches = wrenches();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut allocator = Allocator::new(&wrenches);
    let (mut gas, mut least, mut worst_n, mut worst_nm) = (0.0, 0.0, 0.0_f64, 0.0_f64);
    for _ in 0..2000 {
        let mut unit = || 2.0 * rng.random::<f64>() - 1.0;
        let wanted = [0.1 * unit(), 0.1 * unit(), 0.008 * unit()];
        let duty = allocator.allocate(wanted).duty;
        assert!(duty.iter().all(|u| (0.0..=1.0).contains(u)));
        let made = made(&wrenches, &duty);
        worst_n = worst_n.max((made[0] - wanted[0]).abs()).max((made[1] - wanted[1]).abs());
        worst_nm = worst_nm.max((made[2] - wanted[2]).abs());
        gas += duty.iter().sum::<f64>();
        least += least_gas(&wrenches, wanted);
    }
    println!("gas {gas}, least {least}, off by at most {worst_n} N and {worst_nm} N m");
    assert!(gas < 1.05 * least);
    assert!(worst_n < 5e-3 && worst_nm < 5e-4);
}

#[test]
fn a_wrench_beyond_the_thrusters_is_called_so() {
    let mut allocator = Allocator::new(&wrenches());
    let beyond = allocator.allocate([5.0, 0.0, 0.0]);
    assert!(beyond.is_saturated() && beyond.missing > 0.5);
    assert!(!allocator.allocate([0.1, 0.0, 0.0]).is_saturated());
}

#[test]
fn thrusters_make_the_wanted_wrench_and_never_push_against_each_other() {
    let wrenches = wrenches();
    let mut allocator = Allocator::new(&wrenches);
    for (fx, fy, torque) in [(0.1, 0.0, 0.0), (-0.05, 0.08, 0.004), (0.0, 0.0, -0.02), (0.15, -0.15, 0.005)] {
        let duty = allocator.allocate([fx, fy, torque]).duty;
        let made = |axis: usize| (0..8).map(|i| duty[i] * wrenches[i][axis]).sum::<f64>();
        assert!(
            (made(0) - fx).abs() < 2e-3 && (made(1) - fy).abs() < 2e-3 && (made(2) - torque).abs() < 3e-4,
            "{duty:?}"
        );
        assert!(duty.iter().all(|u| (0.0..=1.0).contains(u)));
        // Thrusters 1 and 2 push along -x, 3 and 4 along +x: a torque may need one of each, never three.
        assert!(duty[..4].iter().filter(|u| **u > 1e-6).count() <= 2, "{duty:?}");
    }
}
