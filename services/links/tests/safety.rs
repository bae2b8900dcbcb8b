//! What the links are told when something is wrong above them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod support;

use fss_messages::{ArmCommand, LinksState};
use fss_wire::link::Mode;
use support::{LINKS, Radio, World};

#[test]
fn the_joints_hold_when_the_arm_controller_falls_silent() {
    let mut world = World::new(Radio::PERFECT, 1);
    world.want([0.0; 4], [0.1, -0.1, 0.05, 0.2]);
    world.pass(3.0);
    world.command = None;
    world.pass(0.6);
    let stopped: Vec<f64> = world.links.iter().map(|link| link.q_rad).collect();
    world.pass(5.0);
    for (link, q) in world.links.iter().zip(stopped) {
        assert_eq!((link.mode, link.qd_rad_s), (Mode::Position, 0.0));
        assert!((link.q_rad - q).abs() < 1e-9, "it creeps");
    }
}

#[test]
fn a_driver_that_is_off_is_not_switched_on_to_hold() {
    let mut world = World::new(Radio::PERFECT, 1);
    world.pass(2.0);
    world.command = None;
    world.pass(3.0);
    assert!(world.links.iter().all(|link| link.mode == Mode::Disabled));
}

#[test]
fn a_restarted_service_does_not_disturb_the_links() {
    let mut world = World::new(Radio::PERFECT, 1);
    world.command = None;
    world.pass(0.4);
    assert!(world.sent.is_empty(), "it waits to hear the arm controller");
    world.want([0.3; 4], [0.0; 4]);
    world.pass(0.1);
    assert_eq!(world.last_sent(0).mode, Mode::Position);
}

#[test]
fn links_shut_off_when_the_service_dies() {
    let mut world = World::new(Radio::PERFECT, 1);
    world.want([0.1; 4], [0.0; 4]);
    world.pass(1.0);
    world.radio.loss = 1.0;
    world.pass(1.3);
    assert!(world.links.iter().all(|link| link.mode == Mode::Disabled));
    world.radio.loss = 0.0;
    let state = world.pass(1.0);
    assert_eq!(state.fault[0], LinksState::FAULT_COMMAND_TIMEOUT);
}

#[test]
fn no_joint_is_ever_told_to_pass_its_stop() {
    let mut world = World::new(Radio::PERFECT, 1);
    world.want([1.4, -1.4, 0.0, 0.0], [0.5, -0.5, 4.0, f64::NAN]);
    world.pass(2.0);
    let stop = std::f64::consts::FRAC_PI_2;
    for (_, datagram) in &world.sent {
        let command = fss_wire::link::Command::decode(&datagram.bytes, &support::key()).unwrap();
        let (q, qd) = (f64::from(command.position_rad), f64::from(command.velocity_rad_s));
        assert!(q.abs() <= stop + 1e-6 && (q + 0.4 * qd).abs() <= stop + 1e-6, "told {q} rad at {qd} rad/s");
        assert!(qd.abs() <= 1.5 + 1e-6);
        assert!((command.max_torque_nm - 1.8).abs() < 1e-6);
    }
    assert!((world.links[0].q_rad - stop).abs() < 1e-6);
    assert_eq!(world.last_sent(3).velocity_rad_s, 0.0, "a command that is no number is none");
}

#[test]
fn a_rate_ends_at_the_stop_even_if_the_controller_does_not_care() {
    let mut world = World::new(Radio::PERFECT, 1);
    world.want([0.0; 4], [1.0; 4]);
    world.command.as_mut().unwrap().mode = ArmCommand::VELOCITY;
    world.pass(10.0);
    for i in 0..LINKS {
        let q = world.links[i].q_rad;
        assert!(q > 1.4 && q <= std::f64::consts::FRAC_PI_2 + 1e-6, "joint {} stands at {q} rad", i + 1);
    }
}
