//! The dynamics ask the allocator for nothing.
#![allow(clippy::unwrap_used, clippy::expect_used, unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use fss_multibody::{Base, Coordinates, JointVector, Link, Model, State, integrate};
use nalgebra::Vector3;

struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: hands every request on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn no_evaluation_and_no_step_allocates() {
    let model = Model::new(Base::default(), &[Link::default(); 4], [0.1, 0.2]).unwrap();
    let state = State::from_slices(&[0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6], &[0.1; 7]);
    let tau = Coordinates::zeros();
    let before = COUNT.with(Cell::get);
    let acc = model.forward_dynamics(&state, &tau);
    let mut sum = model.inverse_dynamics(&state, &acc) + model.bias_forces(&state);
    sum += model.hybrid_dynamics(&state, &tau, &[Some(0.0); 8]).acc;
    sum += model.mass_matrix(&state.q) * model.mass_matrix_inverse(&state.q) * acc;
    sum += integrate::step_rk4(&model, &state, 1e-3, |_, _| tau).q;
    sum += integrate::step_semi_implicit(&model, &state, 1e-3, |_, _| tau).q;
    sum[0] += model.generalized_jacobian(&state.q).sum() + model.momentum(&state).angular_about_com;
    sum[0] += model.base_twist(&state.q, &JointVector::zeros(), &Vector3::x()).x + model.kinetic_energy(&state);
    sum[0] += model.end_effector(&state.q).x;
    let after = COUNT.with(Cell::get);
    assert!(sum.sum().is_finite());
    assert_eq!(after - before, 0, "the dynamics allocated");
    drop(std::hint::black_box(vec![0_u8; 16]));
    assert_eq!(COUNT.with(Cell::get) - after, 1, "the counter does not count");
}
