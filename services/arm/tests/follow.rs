//! An arm that follows goals which may change at any time.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::large_types_passed_by_value)]

mod support;

use fss_messages::{MAX_LINKS, MissionState};
use support::{START_DEG, World};

const PERIOD_S: f64 = 0.02;
/// What the joints may change their rates by, rad/s2.
const BRAKING_RAD_S2: f64 = 0.3;

fn goal(q_rad: [f64; 4]) -> MissionState {
    let mut q_goal_rad = [0.0; MAX_LINKS];
    q_goal_rad[..4].copy_from_slice(&q_rad);
    MissionState { arm_mode: MissionState::ARM_FOLLOW, q_goal_rad, phase_count: 1, ..MissionState::default() }
}

/// Lets the joints go on for so long; no rate jumps on the way (the last step, onto a stop, may brake a little harder), and
/// none is too large.
#[track_caller]
fn goes_smoothly(world: &mut World, seconds: f64) {
    for _ in 0..(seconds / PERIOD_S).round() as usize {
        let before = world.rates;
        world.pass(PERIOD_S);
        let change = (world.rates - before).amax();
        assert!(change <= 1.2 * BRAKING_RAD_S2 * PERIOD_S, "the rates jump by {change} rad/s");
        assert!(world.rates.amax() <= 0.3 + 1e-9);
    }
}

#[test]
fn joints_go_to_a_goal_that_changes_on_the_way_without_a_jump_and_come_to_rest_on_it() {
    let mut world = World::new(&START_DEG, PERIOD_S);
    world.pass(1.0);
    world.begin(goal([0.5, 0.0, -1.0, 0.5]));
    goes_smoothly(&mut world, 2.0);
    let change = |world: &mut World, q_rad| world.mission.as_mut().unwrap().q_goal_rad = goal(q_rad).q_goal_rad;
    let wanted = [-0.7, 0.9, -0.2, 0.1];
    change(&mut world, wanted);
    goes_smoothly(&mut world, 10.0);
    for (i, wanted) in wanted.into_iter().enumerate() {
        assert!((world.q[3 + i] - wanted).abs() < 1e-3, "joint {} at {}, not {wanted}", i + 1, world.q[3 + i]);
    }
    assert!(world.rates.amax() < 1e-6, "{:?}", world.rates);
}

#[test]
fn a_stream_of_goals_is_tracked_closely() {
    let mut world = World::new(&[0.0; 4], PERIOD_S);
    world.pass(1.0);
    world.begin(goal([0.0; 4]));
    let mut furthest = 0.0_f64;
    for step in 0..1000 {
        let t_s = f64::from(step) * PERIOD_S;
        // 0.1 rad/s at most.
        let wanted = 0.5 - 0.5 * (0.2 * t_s).cos();
        world.mission.as_mut().unwrap().q_goal_rad = goal([wanted; 4]).q_goal_rad;
        goes_smoothly(&mut world, PERIOD_S);
        furthest = (0..4).fold(furthest, |most, i| most.max((world.q[3 + i] - wanted).abs()));
    }
    println!("{furthest} rad behind at most");
    assert!(furthest < 0.03, "{furthest} rad behind");
}

#[test]
fn a_goal_beyond_a_stop_ends_before_it_and_a_silent_mission_stops_the_joints() {
    let mut world = World::new(&START_DEG, PERIOD_S);
    world.pass(1.0);
    world.begin(goal([3.0, -3.0, 3.0, -3.0]));
    goes_smoothly(&mut world, 15.0);
    let largest = world.q.as_slice()[3..7].iter().fold(0.0_f64, |most, q| most.max(q.abs()));
    assert!((1.5..90_f64.to_radians()).contains(&largest), "{largest} rad");
    world.mission.as_mut().unwrap().q_goal_rad = goal([0.0; 4]).q_goal_rad;
    goes_smoothly(&mut world, 1.0);
    assert!(world.rates.amax() > 0.1);
    world.mission = None;
    world.pass(3.0);
    assert_eq!(world.rates.amax(), 0.0, "{:?}", world.command);
}
