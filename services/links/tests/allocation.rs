//! A step allocates nothing.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod support;

use fss_bus::allocation::{Counting, allocations_in};
use fss_links::TelemetryDatagram;
use support::{MS, Radio, World};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn a_step_of_links_allocates_nothing() {
    let mut world = World::new(Radio::PERFECT, 1);
    world.want([0.1; 4], [0.01; 4]);
    world.pass(1.0);
    assert!(allocations_in(|| drop(std::hint::black_box(Box::new(1)))) > 0, "the counter counts");
    world.dead[1] = true;
    for _ in 0..20 {
        world.pass(0.1);
        world.inject(TelemetryDatagram::new(world.now.ns(), b"damaged"));
        world.now = world.now.plus_ns(200 * MS);
        let now = world.now;
        assert_eq!(allocations_in(|| world.service.step(now)), 0, "with telemetry, commands and events");
        world.service.flush(now);
    }
}
