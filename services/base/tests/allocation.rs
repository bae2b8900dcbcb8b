//! A step of the controller asks the heap for nothing, also where a leg begins and where navigation fails.
#![allow(clippy::unwrap_used)]

mod support;

use fss_bus::allocation::{Counting, allocations_in};
use fss_plant::Plant;
use support::{START, Table};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_allocates_nothing() {
    assert!(allocations_in(|| drop(std::hint::black_box(Box::new(1)))) > 0, "the counter counts");
    let mut table = Table::new(&Plant::default_laboratory().unwrap());
    for (k, goal) in [START, [0.3, 0.1, 1.0], [0.3, 0.1, 1.0]].into_iter().enumerate() {
        table.nav_works = k < 2;
        table.fly(goal, 3.0, 3.0);
        assert_eq!(table.allocations, 0, "goal {k}");
    }
}
