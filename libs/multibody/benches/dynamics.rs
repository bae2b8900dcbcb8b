//! Criterion benches of the dynamics: `cargo bench -p fss-multibody`.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use fss_multibody::{
    Base, Cause, Coordinates, Link, Model, Parameter, Sensitivity, State, integrate, step_with_derivatives,
};

/// The laboratory's vehicle with the number of links given, and a state in which everything moves.
fn laboratory(links: usize) -> Option<(Model, State)> {
    let base = Base {
        mass_kg: 10.0,
        inertia_kg_m2: 0.25,
        joint1_xy_m: [0.2058, 0.0155],
        joint1_angle_rad: 0.317_841_91,
        ..Base::default()
    };
    let link =
        Link { length_m: 0.3825, com_to_next_joint_m: 0.191, mass_kg: 2.88, inertia_kg_m2: 0.034, ..Link::default() };
    let model = Model::new(base, &vec![link; links], [0.0; 2]).ok()?;
    let within = |i: usize, value: f64| if i < links + 3 { value } else { 0.0 };
    let state = State {
        q: Coordinates::from_fn(|i, _| within(i, 0.3 - 0.1 * i as f64)),
        v: Coordinates::from_fn(|i, _| within(i, 0.05 * i as f64 - 0.2)),
    };
    Some((model, state))
}

fn dynamics(criterion: &mut Criterion) {
    let tau = Coordinates::zeros();
    let law = |_: f64, _: &State| tau;
    for links in [0, 2, 4, 6, 8] {
        let Some((model, state)) = laboratory(links) else { continue };
        let mut bench = |name: &str, run: &mut dyn FnMut()| {
            criterion.bench_function(&format!("{name}/{links}"), |b| b.iter(&mut *run));
        };
        bench("forward_dynamics", &mut || {
            black_box(model.forward_dynamics(black_box(&state), black_box(&tau)));
        });
        bench("inverse_dynamics", &mut || {
            black_box(model.inverse_dynamics(black_box(&state), black_box(&tau)));
        });
        bench("mass_matrix", &mut || {
            black_box(model.mass_matrix(black_box(&state.q)));
        });
        bench("generalized_jacobian", &mut || {
            black_box(model.generalized_jacobian(black_box(&state.q)));
        });
        bench("rk4_step", &mut || {
            black_box(integrate::step_rk4(&model, black_box(&state), 1e-3, law));
        });
        bench("rk4_momentum_step", &mut || {
            black_box(integrate::step_rk4_momentum(&model, black_box(&state), 1e-3, law));
        });
        let mut tangents: Vec<Sensitivity> = (0..links + 3).map(Sensitivity::to_coordinate).collect();
        tangents.extend((0..links + 3).map(Sensitivity::to_velocity));
        tangents.extend((0..links + 3).map(|i| Sensitivity::to(Cause::Force(i))));
        tangents.push(Sensitivity::to(Cause::Parameter(Parameter::BaseMass)));
        bench("step_with_derivatives", &mut || {
            black_box(step_with_derivatives(&model, black_box(&state), 1e-9, &law, &mut tangents));
        });
    }
}

criterion_group!(benches, dynamics);
criterion_main!(benches);
