//! The equations of motion against Lagrange's, derived from the energies alone by automatic differentiation.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod common;

use common::hyperdual::HyperDual;
use common::random::{Random, random_model, random_state};
use fss_multibody::{Coordinates, MassMatrix, Model, State};
use rand::RngExt;

type D = HyperDual;

/// `T - V`, body by body, from nothing but rotations, velocities of centres of mass and Koenig's theorem.
fn lagrangian(model: &Model, q: &[D], v: &[D]) -> D {
    let half = D::constant(0.5);
    let base = model.base();
    let gravity = model.gravity_m_s2();
    let (mut x, mut y, mut vx, mut vy, mut angle, mut rate) = (q[0], q[1], v[0], v[1], q[2], v[2]);
    let body = |x: D, y: D, vx: D, vy: D, angle: D, rate: D, c: [f64; 2], mass: f64, inertia: f64| {
        let (px, py, pvx, pvy) = at(x, y, vx, vy, angle, rate, c);
        let kinetic = D::constant(mass) * (pvx * pvx + pvy * pvy) + D::constant(inertia) * rate * rate;
        let potential = D::constant(-mass * gravity[0]) * px + D::constant(-mass * gravity[1]) * py;
        half * kinetic - potential
    };
    let mut total = body(x, y, vx, vy, angle, rate, base.com_m, base.mass_kg, base.inertia_kg_m2);
    (x, y, vx, vy) = at(x, y, vx, vy, angle, rate, base.joint1_xy_m);
    for (i, link) in model.links().iter().enumerate() {
        let zero = if i == 0 { base.joint1_angle_rad } else { 0.0 };
        angle = angle + q[3 + i] + D::constant(link.joint_offset_rad + zero);
        rate = rate + v[3 + i];
        let c = [link.length_m - link.com_to_next_joint_m, link.com_offset_m];
        total = total + body(x, y, vx, vy, angle, rate, c, link.mass_kg, link.inertia_kg_m2);
        total = total + half * D::constant(link.rotor_inertia_kg_m2) * v[3 + i] * v[3 + i];
        (x, y, vx, vy) = at(x, y, vx, vy, angle, rate, [link.length_m, 0.0]);
    }
    total
}

/// Position and velocity of a point fixed in a body.
#[allow(clippy::too_many_arguments)]
fn at(x: D, y: D, vx: D, vy: D, angle: D, rate: D, point: [f64; 2]) -> (D, D, D, D) {
    let (c, s) = (angle.cos(), angle.sin());
    let rx = c * D::constant(point[0]) - s * D::constant(point[1]);
    let ry = s * D::constant(point[0]) + c * D::constant(point[1]);
    (x + rx, y + ry, vx - rate * ry, vy + rate * rx)
}

/// A coordinate's place in `(q, v)`.
#[derive(Clone, Copy)]
enum Of {
    Q(usize),
    V(usize),
}

/// Second derivative by `a` and `b`, and the first by `a`.
fn derivatives(model: &Model, state: &State, a: Of, b: Of) -> (f64, f64) {
    let mut q: Vec<D> = state.q.iter().map(|x| D::constant(*x)).collect();
    let mut v: Vec<D> = state.v.iter().map(|x| D::constant(*x)).collect();
    match a {
        Of::Q(i) => q[i].by_a = 1.0,
        Of::V(i) => v[i].by_a = 1.0,
    }
    match b {
        Of::Q(i) => q[i].by_b = 1.0,
        Of::V(i) => v[i].by_b = 1.0,
    }
    let l = lagrangian(model, &q, &v);
    (l.by_ab, l.by_a)
}

/// `H_ij = d2L/dv_i dv_j` and `h_i = sum_j (d2L/dv_i dq_j) v_j - dL/dq_i`.
fn lagrange(model: &Model, state: &State) -> (MassMatrix, Coordinates) {
    let n = model.dof();
    let mut inertia = MassMatrix::zeros();
    let mut bias = Coordinates::zeros();
    for i in 0..n {
        for j in 0..n {
            inertia[(i, j)] = derivatives(model, state, Of::V(i), Of::V(j)).0;
            bias[i] += derivatives(model, state, Of::V(i), Of::Q(j)).0 * state.v[j];
        }
        bias[i] -= derivatives(model, state, Of::Q(i), Of::V(0)).1;
    }
    (inertia, bias)
}

#[test]
fn any_number_of_links_obeys_lagranges_equations() {
    let mut random = Random::announced("lagrange", 31);
    for round in 0..20 {
        for links in 0..=8 {
            let model = random_model(&mut random, links, false);
            let n = model.dof();
            let state = random_state(&mut random, n);
            let (inertia, bias) = lagrange(&model, &state);
            let label = format!("round {round}, {links} links");

            let error = (model.mass_matrix(&state.q) - inertia).amax() / inertia.amax();
            assert!(error < 1e-13, "{label}: H is off by {error:e}");
            let error = (model.bias_forces(&state) - bias).amax() / bias.amax();
            assert!(error < 1e-12, "{label}: h is off by {error:e}");
            let error = (model.generalized_momentum(&state) - inertia * state.v).amax() / inertia.amax();
            assert!(error < 1e-13, "{label}: H v is off by {error:e}");

            let tau = Coordinates::from_fn(|i, _| if i < n { random.random_range(-5.0..5.0) } else { 0.0 });
            let acc = model.forward_dynamics(&state, &tau);
            let residual = (inertia * acc + bias - tau).amax() / (inertia.amax() * acc.amax());
            assert!(residual < 1e-13, "{label}: H acc + h - tau is {residual:e}");
            let error = (model.inverse_dynamics(&state, &acc) - tau).amax() / (inertia.amax() * acc.amax());
            assert!(error < 1e-13, "{label}: inverse dynamics is off by {error:e}");
            let unit = model.mass_matrix_inverse(&state.q) * inertia;
            for i in 0..n {
                for j in 0..n {
                    let expected = f64::from(u8::from(i == j));
                    assert!((unit[(i, j)] - expected).abs() < 1e-7, "{label}: H^-1 H [{i}, {j}] = {}", unit[(i, j)]);
                }
            }
        }
    }
}

#[test]
fn a_clamped_base_stays_and_its_joints_obey_lagranges_equations() {
    let mut random = Random::announced("clamped", 32);
    for links in 1..=8 {
        let model = random_model(&mut random, links, true);
        let n = model.dof();
        let mut state = random_state(&mut random, n);
        state.v.fixed_rows_mut::<3>(0).fill(0.0);
        let (inertia, bias) = lagrange(&model, &state);
        let tau = Coordinates::from_fn(|i, _| if i < n { random.random_range(-5.0..5.0) } else { 0.0 });
        let acc = model.forward_dynamics(&state, &tau);
        assert_eq!(acc.fixed_rows::<3>(0).amax(), 0.0, "{links} links: the base accelerates");
        let residual = inertia * acc + bias - tau;
        let error = residual.fixed_rows::<8>(3).amax() / (inertia.amax() * acc.amax());
        assert!(error < 1e-12, "{links} links: H acc + h - tau is {error:e} at the joints");
        let inverse = model.mass_matrix_inverse(&state.q);
        assert_eq!(inverse.fixed_rows::<3>(0).amax(), 0.0, "{links} links: a force moves the base");
        let error = (inverse * (tau - bias) - acc).amax() / acc.amax();
        assert!(error < 1e-9, "{links} links: H^-1 (tau - h) is off by {error:e}");
    }
}

#[test]
fn joints_with_prescribed_accelerations_get_the_torques_that_it_takes() {
    let mut random = Random::announced("hybrid", 33);
    for round in 0..200 {
        let links = 1 + round % 8;
        let model = random_model(&mut random, links, round % 3 == 0);
        let n = model.dof();
        let state = random_state(&mut random, n);
        let tau = Coordinates::from_fn(|i, _| if i < n { random.random_range(-5.0..5.0) } else { 0.0 });
        let acc = model.forward_dynamics(&state, &tau);
        let mut given = tau;
        let prescribed = std::array::from_fn(|i| {
            let ruled = i < links && random.random_bool(0.5);
            if ruled {
                given[3 + i] = 1e3;
            }
            ruled.then(|| acc[3 + i])
        });
        let hybrid = model.hybrid_dynamics(&state, &given, &prescribed);
        let error = (hybrid.acc - acc).amax() / acc.amax();
        assert!(error < 1e-9, "round {round}: accelerations are off by {error:e}");
        let error = (hybrid.tau - tau).amax() / (model.mass_matrix(&state.q).amax() * acc.amax());
        assert!(error < 1e-11, "round {round}: torques are off by {error:e}");

        let joint_acc = acc.fixed_rows::<8>(3).into_owned();
        let force = tau.fixed_rows::<3>(0).into_owned();
        let error = (model.prescribed_dynamics(&state, &joint_acc, &force) - acc).amax() / acc.amax();
        assert!(error < 1e-9, "round {round}: the base under prescribed joints is off by {error:e}");
    }
}
