//! Prints how long the dynamics take: `cargo run --release -p fss-multibody --example time_dynamics`.
//!
//! Where it says latency or step, each evaluation starts from what the one before it gave, as in a simulation, so that
//! nothing overlaps that would not there. Medians of many short batches, so that other work on the machine disturbs
//! little.

use std::hint::black_box;
use std::time::Instant;

use fss_multibody::{
    Base, Cause, Coordinates, Link, Model, ModelError, Sensitivity, State, integrate, step_with_derivatives,
};

const BATCHES: usize = 501;
const BATCH: u32 = 200;

fn main() -> Result<(), ModelError> {
    println!(
        "links  forward  latency     rk4  inverse  inertia  derivatives  step+transition  step+all   (medians, ns)"
    );
    for links in 0..=8 {
        let model = arm(links)?;
        let state = moving(&model);
        let tau = Coordinates::from_fn(|i, _| if i < model.dof() { 0.02 * (i as f64 - 3.0) } else { 0.0 });

        let forward = median_ns(|| {
            black_box(model.forward_dynamics(black_box(&state), black_box(&tau)));
        });
        let mut chained = state;
        let latency = median_ns(|| {
            let acc = model.forward_dynamics(&chained, &tau);
            // Makes the next evaluation wait for this one without moving the state.
            chained.q[2] += 1e-300 * acc[2 + links];
        });
        let mut flying = state;
        let step = median_ns(|| flying = integrate::step_rk4(&model, &flying, 1e-6, |_, _| tau));
        let inverse = median_ns(|| {
            black_box(model.inverse_dynamics(black_box(&state), black_box(&tau)));
        });
        let inertia = median_ns(|| {
            black_box(model.mass_matrix(black_box(&state.q)));
        });
        let derivatives = median_ns(|| {
            black_box(model.forward_dynamics_derivatives(black_box(&state), black_box(&tau)));
        });
        // The state-transition matrix and the derivatives by the forces; then those by every parameter as well.
        let n = model.dof();
        let mut tangents: Vec<Sensitivity> = (0..n).map(Sensitivity::to_coordinate).collect();
        tangents.extend((0..n).map(Sensitivity::to_velocity));
        tangents.extend((0..n).map(|i| Sensitivity::to(Cause::Force(i))));
        let law = |_: f64, _: &State| tau;
        let transition = median_ns(|| flying = step_with_derivatives(&model, &flying, 1e-7, &law, &mut tangents));
        tangents.extend(model.parameters().map(|p| Sensitivity::to(Cause::Parameter(p))));
        let everything = median_ns(|| flying = step_with_derivatives(&model, &flying, 1e-7, &law, &mut tangents));
        black_box((chained, flying, tangents));
        println!(
            "{links:5}  {forward:7.1}  {latency:7.1}  {step:6.1}  {inverse:7.1}  {inertia:7.1}  {derivatives:11.1}  \
             {transition:15.1}  {everything:8.1}"
        );
    }
    Ok(())
}

fn median_ns(mut run: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..BATCHES)
        .map(|_| {
            let start = Instant::now();
            for _ in 0..BATCH {
                run();
            }
            start.elapsed().as_secs_f64() * 1e9 / f64::from(BATCH)
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[BATCHES / 2]
}

/// The laboratory's vehicle with the number of links given.
fn arm(links: usize) -> Result<Model, ModelError> {
    let base = Base {
        mass_kg: 10.0,
        inertia_kg_m2: 0.25,
        joint1_xy_m: [0.2058, 0.0155],
        joint1_angle_rad: 0.317_841_91,
        ..Base::default()
    };
    let link = Link {
        length_m: 0.3825,
        com_to_next_joint_m: 0.191,
        mass_kg: 2.88,
        inertia_kg_m2: 0.034,
        joint_offset_rad: 0.02,
        ..Link::default()
    };
    Model::new(base, &vec![link; links], [0.0; 2])
}

fn moving(model: &Model) -> State {
    let within = |i: usize, value: f64| if i < model.dof() { value } else { 0.0 };
    State {
        q: Coordinates::from_fn(|i, _| within(i, 0.3 - 0.1 * i as f64)),
        v: Coordinates::from_fn(|i, _| within(i, 0.05 * i as f64 - 0.2)),
    }
}
