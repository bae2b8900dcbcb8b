//! Telemetry and commands over a radio that loses, repeats, damages and reorders.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod support;

use fss_links::TelemetryDatagram;
use fss_messages::LinksState;
use fss_wire::link::{Faults, Mode, TorqueCount};
use support::{LINKS, MS, Radio, World};

#[test]
fn each_link_gets_five_commands_a_second_that_only_it_may_take() {
    let mut world = World::new(Radio::PERFECT, 1);
    world.want([0.1, 0.2, 0.3, 0.4], [0.0; 4]);
    let state = world.pass(10.0);
    for i in 0..LINKS {
        assert!((50..=51).contains(&world.times(i).len()), "{} commands", world.times(i).len());
        assert!((world.links[i].q_rad - 0.1 * (i + 1) as f64).abs() < 1e-6);
        assert_eq!(world.links[i].mode, Mode::Position);
        assert!(state.acknowledged_sequence[i] >= 1000 + 4 * 48);
        assert_eq!(state.driver_mode[i], LinksState::DRIVER_POSITION);
    }
    assert_eq!((state.refused, state.lost), (0, [0; 8]));
}

#[test]
fn commands_go_together_or_spread_over_the_period() {
    let first_times = |stagger| {
        let mut world = World::with(Radio::PERFECT, 1, |config| config.stagger = stagger);
        world.pass(1.0);
        (0..LINKS).map(|i| world.times(i)[0] / MS).collect::<Vec<_>>()
    };
    let together = first_times(false);
    assert!(together.iter().all(|t| *t == together[0]));
    let apart = first_times(true);
    assert_eq!(
        apart.iter().map(|t| t - apart[0]).collect::<Vec<_>>(),
        [0, 60, 100, 160],
        "50 ms apart, in steps of 20"
    );
}

#[test]
fn a_moving_joint_is_known_between_its_reports() {
    let mut world = World::new(Radio::PERFECT, 1);
    world.want([0.0; 4], [0.05, -0.05, 0.1, 0.0]);
    world.pass(2.0);
    world.watch(4.0, |world, state| {
        for i in 0..LINKS {
            let error = state.q_rad[i] - world.links[i].q_rad;
            assert!(error.abs() < 3e-4, "joint {} is {error} rad off at an age of {} ns", i + 1, state.age_ns[i]);
            assert!(state.age_ns[i] < 230 * MS);
        }
    });
}

#[test]
fn the_arm_follows_over_a_bad_radio() {
    for seed in 0..5 {
        println!("seed {seed}");
        let mut world = World::new(Radio::BAD, seed);
        world.want([0.1; 4], [0.05, -0.05, 0.02, 0.0]);
        let start = world.pass(4.0);
        let mut oldest_ns = 0;
        world.watch(8.0, |world, state| {
            for i in 0..LINKS {
                oldest_ns = oldest_ns.max(state.age_ns[i]);
                let error = state.q_rad[i] - world.links[i].q_rad;
                // A target that moves on steadily jumps by no more than the rate times the delay.
                assert!(error.abs() < 0.05 * 0.6, "joint {} is {error} rad off", i + 1);
            }
        });
        let end = world.pass(0.02);
        assert!(oldest_ns > 250 * MS, "the radio was not bad enough to show anything");
        assert!(end.refused > start.refused && end.lost[0] > start.lost[0]);
        let wanted = world.command.unwrap();
        for i in 0..LINKS {
            assert!((world.links[i].q_rad - wanted.q_rad[i]).abs() < 0.03, "joint {} lost its way", i + 1);
        }
    }
}

#[test]
fn no_sequence_goes_backwards_and_no_time_stands_in_the_future() {
    let mut world = World::new(Radio::BAD, 9);
    let mut last = LinksState::default();
    world.watch(10.0, |_, state| {
        for i in 0..LINKS {
            assert!(state.telemetry_sequence[i] >= last.telemetry_sequence[i]);
            assert!(state.measured_ns[i] >= last.measured_ns[i].saturating_sub(MS), "measurements are in order");
            assert!(state.measured_ns[i] <= state.stamp_ns);
        }
        last = *state;
    });
}

#[test]
fn a_link_that_falls_silent_is_said_to_be_dead_and_comes_back() {
    let mut world = World::new(Radio::PERFECT, 1);
    assert_eq!(world.pass(1.0).alive[..4], [1; 4]);
    world.dead[2] = true;
    assert_eq!(world.pass(0.75).alive[..4], [1; 4]);
    assert_eq!(world.pass(0.4).alive[..4], [1, 1, 0, 1]);
    world.dead[2] = false;
    assert_eq!(world.pass(0.3).alive[..4], [1; 4]);
}

#[test]
fn a_link_that_was_switched_off_and_on_is_heard_again() {
    let mut world = World::new(Radio::PERFECT, 1);
    world.pass(3.0);
    world.links[1].sequence = 0;
    world.links[1].clock_ns = 50 * MS;
    world.links[1].q_rad = -0.7;
    let state = world.pass(1.0);
    assert_eq!(state.alive[1], 1);
    assert!((state.q_rad[1] + 0.7).abs() < 1e-6);
    assert!(state.age_ns[1] < 230 * MS, "its new clock is translated");
}

#[test]
fn a_saturated_torque_sensor_is_a_fault_and_no_reading() {
    let mut world = World::new(Radio::PERFECT, 1);
    world.links[3].torque = TorqueCount::from_torque(0.5, 2.1);
    assert!((world.pass(1.0).torque_nm[3] - 0.5).abs() < 1e-6);
    world.links[3].torque = TorqueCount::new(TorqueCount::MAX);
    let state = world.pass(1.0);
    assert_eq!(state.fault[3], LinksState::FAULT_TORQUE_SENSOR);
    assert!((state.torque_nm[3] - 0.5).abs() < 1e-6, "the last reading stays");
}

#[test]
fn faults_and_modes_have_the_same_numbers_on_the_wire_and_in_the_sample() {
    let pairs = [
        (Faults::DRIVER, LinksState::FAULT_DRIVER),
        (Faults::TORQUE_SATURATED, LinksState::FAULT_TORQUE_SENSOR),
        (Faults::JOINT_LIMIT, LinksState::FAULT_JOINT_LIMIT),
        (Faults::COMMAND_LOST, LinksState::FAULT_COMMAND_TIMEOUT),
        (Faults::BATTERY_LOW, LinksState::FAULT_BATTERY_LOW),
        (Faults::TORQUE_LIMIT, LinksState::FAULT_TORQUE_LIMIT),
    ];
    for (wire, sample) in pairs {
        assert_eq!(wire.0, sample);
    }
    let modes = [Mode::Disabled, Mode::Position, Mode::Velocity, Mode::Current].map(|mode| mode as u8);
    assert_eq!(
        modes,
        [LinksState::DRIVER_OFF, LinksState::DRIVER_POSITION, LinksState::DRIVER_VELOCITY, LinksState::DRIVER_CURRENT,]
    );
}

#[test]
fn noise_on_the_radio_is_counted_and_nothing_else() {
    let mut world = World::new(Radio::PERFECT, 1);
    let before = world.pass(1.0);
    for junk in [&[][..], &[0; 60][..], b"FSSL", &[255; 64]] {
        world.inject(TelemetryDatagram::new(world.now.ns(), junk));
    }
    let after = world.pass(0.04);
    assert_eq!(after.refused, before.refused + 4);
    assert_eq!(after.q_rad, before.q_rad);
}
