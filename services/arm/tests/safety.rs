//! What the arm does where it cannot go on: limits, singularities, stale inputs, restarts.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::large_types_passed_by_value)]

mod support;

use fss_messages::{ArmCommand, LinksState, MissionState};
use support::{Record, START_DEG, World, line, plant};

const PERIOD_S: f64 = 0.02;

fn flying(mission: MissionState) -> World {
    let mut world = World::new(&START_DEG, PERIOD_S);
    world.pass(1.0);
    world.begin(mission);
    world
}

fn zero_reaction() -> MissionState {
    line(MissionState::ARM_ZERO_REACTION, 0.1, 240.0, 20.0)
}

/// Blocked, at rest, within all limits, and with a reason.
#[track_caller]
fn is_blocked_and_safe(mut world: World, seconds: f64, reason: &str) -> Record {
    let record = world.pass(seconds);
    println!("{record:?}");
    assert!(record.blocked && record.progress < 1.0);
    assert!(record.events.iter().any(|event| event.contains("blocked") && event.contains(reason)));
    assert!(record.largest_joint_deg < 90.0 && record.largest_rate_rad_s <= 0.3 + 1e-9);
    assert_eq!(world.rates.amax(), 0.0, "it does not stand still");
    let q = world.q;
    world.pass(5.0);
    assert_eq!(world.rates.amax(), 0.0);
    assert_eq!(world.command.mode, ArmCommand::POSITION);
    assert!((world.q - q).fixed_rows::<4>(3).amax() < 1e-9, "it does not hold");
    record
}

#[test]
fn a_line_beyond_the_reach_ends_blocked_near_the_singularity() {
    let world = flying(line(MissionState::ARM_LINE, 2.0, 0.0, 60.0));
    is_blocked_and_safe(world, 90.0, "singular");
}

#[test]
fn a_straight_arm_is_singular_for_a_line_along_itself() {
    let mut world = World::new(&[0.0, -5.801, 3.402, 1.391], PERIOD_S);
    world.pass(1.0);
    world.begin(line(MissionState::ARM_LINE_POSE, 0.1, 18.2, 10.0));
    is_blocked_and_safe(world, 15.0, "singular");
}

#[test]
fn joint_limits_end_a_line_that_needs_more() {
    let mut world = World::new(&[80.0, 80.0, 80.0, 80.0], PERIOD_S);
    world.pass(1.0);
    let inward = line(MissionState::ARM_ZERO_REACTION_POSE, 0.5, 0.0, 40.0);
    let away = line(MissionState::ARM_ZERO_REACTION_POSE, 0.5, 180.0, 40.0);
    for mission in [inward, away] {
        world.begin(mission);
        let record = world.pass(60.0);
        println!("{record:?}");
        assert!(record.blocked && record.largest_joint_deg < 90.0);
        assert_eq!(world.rates.amax(), 0.0);
    }
}

#[test]
fn a_joint_at_its_limit_is_locked_and_the_others_do_the_line() {
    let mut world = World::with(&START_DEG, PERIOD_S, |config| config.limit_rad[2] = 70_f64.to_radians());
    world.pass(1.0);
    world.begin(line(MissionState::ARM_LINE, 0.1, 240.0, 20.0));
    let (start, mut was_limited) = (world.ee(), false);
    let mut record = Record::default();
    for _ in 0..42 {
        record = world.pass(0.5);
        was_limited |= world.command.limited[2] == 1;
    }
    assert!(!record.blocked && record.progress == 1.0 && was_limited);
    assert!(((world.ee() - start).xy().norm() - 0.1).abs() < 6e-4);
    assert!(record.q_deg[2] > -69.8 && record.q_deg[2] < -66.0, "joint 3 ends at {}", record.q_deg[2]);
}

#[test]
fn a_vehicle_with_too_few_joints_for_the_task_is_blocked() {
    let mut two_links = plant();
    two_links.links.truncate(2);
    let mut world = World::of(&two_links, &[20.0, 40.0], PERIOD_S, |_| {});
    world.pass(1.0);
    world.begin(zero_reaction());
    is_blocked_and_safe(world, 2.0, "singular");
}

#[test]
fn six_links_do_what_four_do() {
    let mut six_links = plant();
    let last = six_links.links[3].clone();
    six_links.links.extend([last.clone(), last]);
    let mut world = World::of(&six_links, &[-30.0, 50.0, -40.0, 30.0, -20.0, 40.0], PERIOD_S, |_| {});
    world.pass(1.0);
    world.begin(line(MissionState::ARM_ZERO_REACTION_POSE, 0.2, 200.0, 20.0));
    let record = world.pass(21.0);
    println!("{record:?}");
    assert!(!record.blocked && record.ee_error_m < 1e-3 && record.largest_base_turn_deg < 0.05);
    assert!(record.ee_turn_deg.abs() < 0.05);
}

#[test]
fn stopping_in_the_middle_of_a_zero_reaction_line_does_not_turn_the_base() {
    let mut world = flying(zero_reaction());
    let start = world.ee();
    world.pass(10.0);
    assert!(world.rates.amax() > 0.02, "it moves");
    world.has_nav = false;
    let stopping = world.pass(2.0);
    assert_eq!((world.command.holding, world.rates.amax()), (1, 0.0));
    assert!(stopping.largest_base_turn_deg < 0.02, "{stopping:?}");

    world.has_nav = true;
    let record = world.pass(13.0);
    assert_eq!((world.command.holding, record.blocked), (0, false));
    assert!(record.progress == 1.0 && record.largest_base_turn_deg < 0.05, "{record:?}");
    assert!(((world.ee() - start).xy().norm() - 0.1).abs() < 6e-4, "it ends elsewhere");
}

#[test]
fn the_arm_holds_when_telemetry_or_mission_fall_silent() {
    let silences: [fn(&mut World); 3] = [
        |world| world.has_links = false,
        |world| world.mission = None,
        |world| world.spoil = |_, links| links.alive[1] = 0,
    ];
    for silence in silences {
        let mut world = flying(zero_reaction());
        world.pass(10.0);
        silence(&mut world);
        world.pass(2.0);
        assert_eq!((world.command.holding, world.rates.amax()), (1, 0.0));
        assert_eq!(world.command.mode, ArmCommand::POSITION, "it holds, it does not let go");
    }
}

#[test]
fn joints_that_hold_do_not_drift_under_noise() {
    let mut world = World::new(&START_DEG, PERIOD_S);
    world.spoil = |nav, links| {
        let noise = if nav.stamp_ns / 20_000_000 % 2 == 0 { 1e-3 } else { -0.5e-3 };
        links.q_rad[0] += noise;
        links.qd_rad_s[1] += noise;
    };
    world.pass(1.0);
    let q = world.command.q_rad;
    world.pass(60.0);
    assert_eq!((world.command.q_rad, world.command.qd_rad_s), (q, [0.0; 8]));
}

#[test]
fn joints_reach_their_angles_in_time_and_at_rest() {
    let mut world = World::new(&START_DEG, PERIOD_S);
    world.pass(1.0);
    let goal = [0.4, -0.2, 0.1, -0.5];
    let mut mission =
        MissionState { arm_mode: MissionState::ARM_JOINTS, arm_duration_s: 12.0, ..MissionState::default() };
    mission.q_goal_rad[..4].copy_from_slice(&goal);
    world.begin(mission);
    let under_way = world.pass(11.0);
    assert!(under_way.progress > 0.95 && under_way.progress < 1.0);
    let record = world.pass(1.1);
    assert_eq!((record.progress, world.rates.amax()), (1.0, 0.0));
    for (i, goal) in goal.iter().enumerate() {
        assert!((world.q[3 + i] - goal).abs() < 1e-3, "joint {}", i + 1);
        assert!((world.command.q_rad[i] - goal).abs() < 1e-12, "joint {}", i + 1);
    }
}

#[test]
fn a_motion_that_is_too_fast_takes_longer() {
    let mut world = World::new(&[0.0; 4], PERIOD_S);
    world.pass(1.0);
    let mut mission =
        MissionState { arm_mode: MissionState::ARM_JOINTS, arm_duration_s: 1.0, ..MissionState::default() };
    mission.q_goal_rad[1] = 3.0;
    world.begin(mission);
    let record = world.pass(12.0);
    assert!(record.largest_rate_rad_s <= 0.3 + 1e-9, "{}", record.largest_rate_rad_s);
    assert!(
        record.largest_joint_deg < 90.0 && record.largest_joint_deg > 89.0,
        "a goal beyond the stop ends before it"
    );
    assert!(record.events.iter().any(|event| event.contains("need")));
}

#[test]
fn a_joint_motion_that_was_interrupted_goes_on_from_where_it_stopped() {
    let mut world = World::new(&[0.0; 4], PERIOD_S);
    world.pass(1.0);
    let mut mission =
        MissionState { arm_mode: MissionState::ARM_JOINTS, arm_duration_s: 10.0, ..MissionState::default() };
    mission.q_goal_rad[0] = 0.8;
    world.begin(mission);
    world.pass(5.0);
    world.has_links = false;
    world.pass(3.0);
    let stopped = world.command.q_rad[0];
    world.has_links = true;
    world.pass(0.1);
    assert!((world.command.q_rad[0] - stopped).abs() < 0.01, "it jumps");
    world.pass(8.0);
    assert!((world.command.q_rad[0] - 0.8).abs() < 1e-9);
}

#[test]
fn a_driver_that_is_off_is_followed_not_pulled_back() {
    let mut world = World::new(&START_DEG, PERIOD_S);
    world.pass(1.0);
    world.spoil = |_, links| {
        links.driver_mode[2] = LinksState::DRIVER_OFF;
        links.q_rad[2] = 0.25;
    };
    world.pass(0.1);
    assert!((world.command.q_rad[2] - 0.25).abs() < 1e-12);
    assert!((world.command.q_rad[1] - START_DEG[1].to_radians()).abs() < 1e-9, "the others hold");
}

#[test]
fn drivers_stay_off_until_there_is_telemetry_and_when_the_mission_wants_it() {
    let mut world = World::new(&START_DEG, PERIOD_S);
    world.has_links = false;
    world.pass(1.0);
    assert_eq!(world.command.mode, ArmCommand::OFF);
    world.has_links = true;
    world.pass(0.1);
    assert_eq!(world.command.mode, ArmCommand::POSITION);
    world.begin(MissionState { arm_mode: MissionState::ARM_OFF, ..MissionState::default() });
    world.pass(0.1);
    assert_eq!(world.command.mode, ArmCommand::OFF);
}

#[test]
fn a_controller_that_starts_in_the_middle_of_a_line_holds() {
    let mut world = World::new(&START_DEG, PERIOD_S);
    world.begin(zero_reaction());
    world.now = world.now.plus_ns(5_000_000_000);
    is_blocked_and_safe(world, 2.0, "without this controller");
}

#[test]
fn a_joint_that_does_not_follow_blocks_the_arm() {
    let mut world = flying(line(MissionState::ARM_LINE, 0.2, 240.0, 10.0));
    world.spoil = |_, links| links.q_rad[1] = 60_f64.to_radians() - 0.3;
    let record = world.pass(3.0);
    assert!(record.blocked, "{record:?}");
}

#[test]
fn a_line_is_straight_and_the_base_keeps_its_heading_though_the_vehicle_drifts_and_turns() {
    for mode in [MissionState::ARM_LINE, MissionState::ARM_ZERO_REACTION] {
        let mut world = World::new(&START_DEG, PERIOD_S);
        world.momentum = nalgebra::Vector3::new(0.06, -0.04, 0.01);
        world.pass(10.0);
        let heading = world.q[2];
        world.begin(line(mode, 0.1, 240.0, 20.0));
        let record = world.pass(21.0);
        println!("{record:?}");
        assert!(!record.blocked && record.largest_ee_error_m < 2e-3);
        if mode == MissionState::ARM_ZERO_REACTION {
            assert!((world.q[2] - heading).to_degrees().abs() < 0.1 && record.largest_base_turn_deg < 0.3);
        }
    }
}

#[test]
fn the_next_phase_frees_a_blocked_arm() {
    let mut world = flying(line(MissionState::ARM_LINE, 2.0, 0.0, 60.0));
    assert!(world.pass(90.0).blocked);
    let mut back = MissionState { arm_mode: MissionState::ARM_JOINTS, arm_duration_s: 8.0, ..MissionState::default() };
    for (goal, degrees) in back.q_goal_rad.iter_mut().zip(START_DEG) {
        *goal = degrees.to_radians();
    }
    world.begin(back);
    let record = world.pass(8.1);
    assert!(!record.blocked && record.progress == 1.0);
    world.begin(line(MissionState::ARM_LINE, 0.1, 180.0, 10.0));
    let record = world.pass(11.0);
    assert!(!record.blocked && record.progress == 1.0 && record.ee_error_m < 1e-3, "{record:?}");
}
