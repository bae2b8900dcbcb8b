//! Stopping with the least gas: the bound, and the burns that meet it.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_base::allocation::Wrench;
use fss_base::stop::{Action, Body, Stop, least_impulse};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

const THRUST_N: f64 = 0.159;

/// Two thrusters a side, as the laboratory has them.
fn wrenches() -> Vec<Wrench> {
    let (far, near) = (0.135, 0.065);
    let places = [
        ([far, near], [-1.0, 0.0]),
        ([far, -near], [-1.0, 0.0]),
        ([-far, near], [1.0, 0.0]),
        ([-far, -near], [1.0, 0.0]),
        ([near, far], [0.0, -1.0]),
        ([-near, far], [0.0, -1.0]),
        ([near, -far], [0.0, 1.0]),
        ([-near, -far], [0.0, 1.0]),
    ];
    places.map(|([x, y], [fx, fy])| [fx, fy, x * fy - y * fx].map(|share| share * THRUST_N)).to_vec()
}

fn vehicle(rate_rad_s: f64, momentum: [f64; 2], centre_m: [f64; 2]) -> Body {
    Body { mass_kg: 21.5, inertia_kg_m2: 4.0, heading_rad: 0.3, rate_rad_s, momentum, centre_m, place_m: [0.0; 2] }
}

/// Opens a thruster for a step.
fn push(body: &mut Body, wrench: &Wrench, step_s: f64) {
    let (thrust, lever) = body.thrust_and_lever(wrench);
    let (sin, cos) = body.heading_rad.sin_cos();
    body.momentum[0] += (cos * wrench[0] - sin * wrench[1]) * step_s;
    body.momentum[1] += (sin * wrench[0] + cos * wrench[1]) * step_s;
    body.rate_rad_s += thrust * lever / body.inertia_kg_m2 * step_s;
}

#[test]
fn two_burns_stop_spin_and_drift_with_the_least_impulse() {
    let seed = 11;
    println!("seed {seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let wrenches = wrenches();
    for _ in 0..50 {
        let mut within = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
        let side = if within(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        let (drift, direction) = (within(0.0, 0.15), within(0.0, TAU));
        let momentum = [drift * direction.cos(), drift * direction.sin()];
        let mut body = vehicle(side * within(0.07, 0.3), momentum, [within(0.2, 0.5), within(-0.3, 0.3)]);
        let least = least_impulse(&body, &wrenches);
        let (start, mut stop, mut spent) = (body, Stop::default(), 0.0);
        let step_s = 1e-3;
        for _ in 0..300_000 {
            match stop.step(&body, &wrenches, step_s) {
                Action::Burn(thruster) => {
                    push(&mut body, &wrenches[thruster], step_s);
                    spent += THRUST_N * step_s;
                }
                Action::Coast => {}
                Action::Damp => break,
            }
            body.heading_rad += body.rate_rad_s * step_s;
        }
        assert!(body.rate_rad_s.abs() < 1e-4, "still turns: {start:?} {body:?}");
        assert!(body.momentum[0].hypot(body.momentum[1]) < 0.03 * least + 1e-3, "still drifts: {start:?} {body:?}");
        assert!((spent / least - 1.0).abs() < 0.002, "{spent} N s where {least} N s are enough: {start:?}");
    }
}

#[test]
fn no_firings_stop_a_vehicle_with_less_than_the_bound() {
    let seed = 12;
    println!("seed {seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let wrenches = wrenches();
    for _ in 0..2000 {
        // Any firings in any headings; the motion that they stop is the opposite of what they make.
        let mut made = vehicle(0.0, [0.0; 2], [0.4, 0.1]);
        let mut spent = 0.0;
        for _ in 0..random.random_range(1..6) {
            made.heading_rad = random.random::<f64>() * TAU;
            let time_s = random.random::<f64>();
            push(&mut made, &wrenches[random.random_range(0..8)], time_s);
            spent += THRUST_N * time_s;
        }
        let stopped = vehicle(-made.rate_rad_s, made.momentum.map(|p| -p), made.centre_m);
        let least = least_impulse(&stopped, &wrenches);
        assert!(least <= spent * (1.0 + 1e-12), "{least} N s against {spent} N s");
        assert!(least > 0.0 || made.rate_rad_s == 0.0);
    }
}
