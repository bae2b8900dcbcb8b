//! A step allocates nothing and takes microseconds.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod support;

use fss_bus::allocation::{Counting, allocations_in};
use fss_messages::MissionState;
use support::{START_DEG, World, line};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_of_the_arm_allocates_nothing() {
    let mut world = World::new(&START_DEG, 0.02);
    assert!(allocations_in(|| drop(std::hint::black_box(Box::new(1)))) > 0, "the counter counts");
    let step = |world: &mut World| {
        for _ in 0..20 {
            world.pass(0.02);
            world.show();
            let now = world.now;
            assert_eq!(allocations_in(|| world.arm.step(now)), 0);
            world.arm.flush(now);
        }
    };
    step(&mut world);
    for mode in [MissionState::ARM_LINE, MissionState::ARM_ZERO_REACTION_POSE, MissionState::ARM_JOINTS] {
        world.begin(line(mode, 0.1, 240.0, 20.0));
        step(&mut world);
    }
    // Into the limits, with its events.
    world.begin(line(MissionState::ARM_LINE_POSE, 3.0, 240.0, 5.0));
    for _ in 0..5 {
        step(&mut world);
    }
}
