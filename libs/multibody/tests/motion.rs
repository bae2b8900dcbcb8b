//! What a person at the table would see: what is conserved, what swings, what converges.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::random::{Random, random_model, random_state};
use common::{model, reference};
use fss_multibody::{Base, Coordinates, Link, Model, State, integrate};

fn laboratory() -> Model {
    model(&reference("dynamics.json")["params"])
}

fn no_force(_: f64, _: &State) -> Coordinates {
    Coordinates::zeros()
}

fn fly(model: &Model, start: &State, step_s: f64, duration_s: f64) -> State {
    fly_with(model, start, step_s, duration_s, |m, s, h| integrate::step_rk4(m, s, h, no_force))
}

fn fly_with(
    model: &Model,
    start: &State,
    step_s: f64,
    duration_s: f64,
    step: impl Fn(&Model, &State, f64) -> State,
) -> State {
    let steps = (duration_s / step_s).round() as usize;
    (0..steps).fold(*start, |state, _| step(model, &state, step_s))
}

/// A base that drifts and turns while the arm tumbles, faster than the laboratory's ever will.
fn tumbling() -> State {
    State::from_slices(&[0.1, -0.2, 0.3, -0.5, 1.0, -1.0, 0.5], &[0.05, -0.03, 0.2, 0.4, -0.5, 0.3, -0.6])
}

/// Largest relative drift of linear and angular momentum over a minute.
fn momentum_drift(step: impl Fn(&Model, &State, f64) -> State, step_s: f64) -> f64 {
    let model = laboratory();
    let start = tumbling();
    let before = model.momentum(&start);
    let mut state = start;
    let mut worst = 0.0_f64;
    for _ in 0..(60.0 / step_s).round() as usize {
        state = step(&model, &state, step_s);
        let now = model.momentum(&state);
        worst = worst.max((now.linear - before.linear).norm() / before.linear.norm());
        worst = worst.max((now.angular_about_com / before.angular_about_com - 1.0).abs());
    }
    println!("momentum drifts by {worst:e} in 60 s at {step_s} s steps");
    worst
}

#[test]
fn sixty_seconds_of_free_motion_keep_momentum_to_twelve_digits() {
    let classical = momentum_drift(|m, s, h| integrate::step_rk4(m, s, h, no_force), 5e-4);
    assert!(classical < 1e-12, "momentum is off by {classical:e} with plain Runge-Kutta steps");
    let kept = momentum_drift(|m, s, h| integrate::step_rk4_momentum(m, s, h, no_force), 1e-2);
    assert!(kept < 1e-12, "momentum is off by {kept:e} although it is kept");
}

#[test]
fn forces_on_base_and_joints_change_the_momentum_by_exactly_their_impulse() {
    let mut random = Random::announced("impulse", 52);
    for links in 0..=8 {
        let model = random_model(&mut random, links, false);
        let mut state = random_state(&mut random, model.dof());
        let forces = |_: f64, s: &State| {
            let mut tau = -0.2 * s.v;
            tau[0] = 0.4 + (10.0 * s.q[2]).cos();
            tau[2] += 0.1;
            tau
        };
        let exact = fly_with(&model, &state, 1e-4, 0.1, |m, s, h| integrate::step_rk4(m, s, h, forces));
        state = fly_with(&model, &state, 1e-2, 0.1, |m, s, h| integrate::step_rk4_momentum(m, s, h, forces));
        let (kept, exact) = (model.momentum(&state), model.momentum(&exact));
        let error = (kept.linear - exact.linear).norm() / exact.linear.norm()
            + (kept.angular_about_com / exact.angular_about_com - 1.0).abs();
        assert!(error < 1e-7, "{links} links: the momentum after a push is off by {error:e}");
    }
}

#[test]
fn the_centre_of_mass_of_free_motion_goes_straight() {
    let model = laboratory();
    let start = tumbling();
    let end = fly(&model, &start, 1e-3, 20.0);
    let velocity = model.momentum(&start).linear / model.total_mass_kg();
    let expected = model.center_of_mass(&start.q) + 20.0 * velocity;
    let error = (model.center_of_mass(&end.q) - expected).norm();
    assert!(error < 1e-11, "the centre of mass is off by {error:e} m");
}

/// Error of the energy, RMS over twenty instants of a motion of so many steps (a multiple of twenty).
fn energy_error(model: &Model, start: &State, step: impl Fn(&Model, &State) -> State, steps: usize) -> f64 {
    let energy = |state: &State| model.kinetic_energy(state) + model.potential_energy(&state.q);
    let before = energy(start);
    let mut state = *start;
    let mut squares = 0.0;
    for count in 1..=steps {
        state = step(model, &state);
        if count % (steps / 20) == 0 {
            squares += (energy(&state) - before).powi(2);
        }
    }
    (squares / 20.0).sqrt()
}

#[test]
fn halving_the_step_lowers_the_energy_error_by_the_order_of_the_method() {
    let free = laboratory();
    let wall = Base { clamped: true, ..*free.base() };
    let hanging = Model::new(wall, free.links(), [0.0, -9.81]).unwrap();
    let mut tumbling = tumbling();
    tumbling.v *= 3.0;
    let raised = State::from_slices(&[0.0, 0.0, 0.0, 0.4, -0.3, 0.5, 0.1], &[]);
    for (name, model, start) in [("free", free, tumbling), ("hanging", hanging, raised)] {
        let order = |step: &dyn Fn(&Model, &State, f64) -> State, steps: usize| {
            let error = |steps: usize| energy_error(&model, &start, |m, s| step(m, s, 0.4 / steps as f64), steps);
            (error(steps) / error(2 * steps)).log2()
        };
        let euler = order(&|m, s, h| integrate::step_semi_implicit(m, s, h, no_force), 2000);
        let rk4 = order(&|m, s, h| integrate::step_rk4(m, s, h, no_force), 200);
        let kept = order(&|m, s, h| integrate::step_rk4_momentum(m, s, h, no_force), 200);
        println!("{name}: orders {euler:.3}, {rk4:.3}, {kept:.3}");
        assert!((euler - 1.0).abs() < 0.1, "{name}: semi-implicit Euler shows order {euler:.2}");
        assert!((rk4 - 4.0).abs() < 0.2, "{name}: Runge-Kutta shows order {rk4:.2}");
        assert!((kept - 4.0).abs() < 0.2, "{name}: Runge-Kutta that keeps momentum shows order {kept:.2}");
    }
}

#[test]
fn a_clamped_pendulum_swings_with_the_period_of_the_elliptic_integral() {
    let link = Link {
        length_m: 0.4,
        com_to_next_joint_m: 0.15,
        mass_kg: 1.3,
        inertia_kg_m2: 0.02,
        rotor_inertia_kg_m2: 0.007,
        ..Link::default()
    };
    let base = Base { clamped: true, ..Base::default() };
    let model = Model::new(base, &[link], [0.0, -9.81]).unwrap();
    let about_joint = 0.02 + 0.007 + 1.3 * 0.25 * 0.25;
    let slow = (about_joint / (1.3 * 9.81 * 0.25_f64)).sqrt();
    for amplitude in [0.01, 1.0, 2.5] {
        // T = 2 pi sqrt(I / m g r) / agm(1, cos(amplitude / 2)): Gauss's form of the complete elliptic integral.
        let (mut a, mut g) = (1.0_f64, (amplitude / 2.0_f64).cos());
        for _ in 0..8 {
            (a, g) = (0.5 * (a + g), (a * g).sqrt());
        }
        let period = std::f64::consts::TAU * slow / a;
        let hanging = -std::f64::consts::FRAC_PI_2;
        let start = State::from_slices(&[0.0, 0.0, 0.0, hanging + amplitude], &[]);
        let state = fly(&model, &start, period / 4000.0, period);
        let error = (state.q[3] - start.q[3]).abs() + state.v[3].abs() * slow;
        assert!(error < 1e-9 * amplitude, "after one period of {period} s it is {error:e} rad from where it began");
        let quarter = fly(&model, &start, period / 4000.0, period / 4.0);
        assert!((quarter.q[3] - hanging).abs() < 1e-9, "after a quarter it hangs {} rad", quarter.q[3]);
    }
}

#[test]
fn a_free_mechanism_falls_with_gravity_and_feels_none_of_it() {
    let model = laboratory();
    let falling = model.with_gravity([0.3, -9.81]).unwrap();
    let state = tumbling();
    let tau = Coordinates::from_fn(|i, _| if i < 7 { 0.1 * i as f64 } else { 0.0 });
    let difference = falling.forward_dynamics(&state, &tau) - model.forward_dynamics(&state, &tau);
    let expected = Coordinates::from_fn(|i, _| [0.3, -9.81].get(i).copied().unwrap_or(0.0));
    assert!((difference - expected).amax() < 1e-12, "gravity adds {difference}");
}

#[test]
fn a_force_at_the_centre_of_mass_moves_a_bare_base_without_turning_it() {
    let base = Base { mass_kg: 10.0, inertia_kg_m2: 0.25, com_m: [0.02, -0.01], ..Base::default() };
    let model = Model::new(base, &[], [0.0; 2]).unwrap();
    let state = State::from_slices(&[1.0, 2.0, 0.7], &[0.0, 0.0, 0.0]);
    let lever = model.center_of_mass(&state.q) - nalgebra::Vector2::new(1.0, 2.0);
    let (fx, fy) = (0.4, -0.2);
    let tau = State::from_slices(&[fx, fy, lever.x * fy - lever.y * fx], &[]).q;
    let acc = model.forward_dynamics(&state, &tau);
    let expected = State::from_slices(&[fx / 10.0, fy / 10.0, 0.0], &[]).q;
    assert!((acc - expected).amax() < 1e-16, "{acc}");
}
