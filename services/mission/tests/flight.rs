//! How a mission flies: it waits for good inputs, runs its phases on time, and gives up safely.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_bus::{Bus, InputPort, Latest, Output, OutputPort, Runner, Time};
use fss_messages::{ArmCommand, LinksState, MAX_LINKS, MissionGoal, MissionState, NavState, topic};
use fss_mission::{Mission, MissionConfig, MissionService};

const PERIOD_NS: u64 = 50_000_000;

/// A stack of which only the mission is real.
struct Flight {
    mission: Runner<MissionService>,
    nav: Output<NavState>,
    links: Output<LinksState>,
    arm: Output<ArmCommand>,
    goals: Output<MissionGoal>,
    state: Latest<MissionState>,
    now: Time,
    sample: (Option<NavState>, Option<LinksState>, Option<ArmCommand>),
}

impl Flight {
    fn of(phases: &str) -> Self {
        let mission = Mission::parse(&format!("name = \"test\"\n{phases}")).unwrap();
        let bus = Bus::local();
        let mut links = LinksState { link_count: 4, ..LinksState::default() };
        links.alive[..4].fill(1);
        let nav = NavState { mode: NavState::TRACKING, x_m: 0.5, y_m: -0.25, theta_rad: 0.1, ..NavState::default() };
        Self {
            mission: Runner::new(MissionService::new(mission, MissionConfig::default()), &bus).unwrap(),
            nav: Output::open(&bus, topic::NAV_STATE).unwrap(),
            links: Output::open(&bus, topic::LINKS_STATE).unwrap(),
            arm: Output::open(&bus, topic::ARM_COMMAND).unwrap(),
            goals: Output::open(&bus, topic::MISSION_GOAL).unwrap(),
            state: Latest::open(&bus, topic::MISSION_STATE).unwrap(),
            now: Time::from_ns(1_000_000_000),
            sample: (Some(nav), Some(links), Some(ArmCommand { link_count: 4, ..ArmCommand::default() })),
        }
    }

    fn nav(&mut self) -> &mut NavState {
        self.sample.0.as_mut().unwrap()
    }

    fn fly(&mut self, seconds: f64) -> MissionState {
        for _ in 0..(seconds * 1e9) as u64 / PERIOD_NS {
            self.now = self.now.plus_ns(PERIOD_NS);
            let stamp_ns = self.now.ns();
            if let Some(sample) = self.sample.0 {
                self.nav.publish(NavState { stamp_ns, ..sample });
            }
            if let Some(sample) = self.sample.1 {
                self.links.publish(LinksState { stamp_ns, ..sample });
            }
            if let Some(sample) = self.sample.2 {
                self.arm.publish(ArmCommand { stamp_ns, ..sample });
            }
            self.nav.flush(self.now);
            self.links.flush(self.now);
            self.arm.flush(self.now);
            self.mission.step(self.now);
            self.mission.flush(self.now);
        }
        self.state.refresh();
        *self.state.get().unwrap()
    }
}

const HOLD_THEN_LINE: &str = r#"
[[phase]]
duration_s = 2
settle_s = 1
base = { goal = "goto", x_m = 0.1, theta_deg = 90, relative = true }
arm = { goal = "joints", q_deg = [10, 20, 30, 40] }
[[phase]]
duration_s = 4
base = { goal = "hold" }
arm = { goal = "line", length_m = 0.1, direction_deg = 90, keep_orientation = true }
"#;

#[test]
fn a_mission_waits_until_navigation_and_links_are_good() {
    let mut flight = Flight::of(HOLD_THEN_LINE);
    flight.nav().mode = NavState::INITIALISING;
    let waiting = flight.fly(3.0);
    assert_eq!((waiting.state, waiting.base_mode), (MissionState::WAITING, MissionState::BASE_FREE));
    assert_eq!(waiting.arm_mode, MissionState::ARM_HOLD);
    flight.nav().mode = NavState::TRACKING;
    assert_eq!(flight.fly(0.5).state, MissionState::WAITING, "good for half a second only");
    assert_eq!(flight.fly(1.0).state, MissionState::RUNNING);
}

#[test]
fn phases_follow_each_other_on_time_and_the_end_is_safe() {
    let mut flight = Flight::of(HOLD_THEN_LINE);
    let first = flight.fly(1.5);
    assert_eq!((first.state, first.phase, first.phase_count), (MissionState::RUNNING, 0, 2));
    assert_eq!(first.base_goal, [0.6, -0.25, 0.1 + std::f64::consts::FRAC_PI_2]);
    assert_eq!(first.arm_mode, MissionState::ARM_JOINTS);
    assert!((first.q_goal_rad[3] - 40_f64.to_radians()).abs() < 1e-12);

    let second = flight.fly(3.0);
    assert_eq!((second.phase, second.arm_mode), (1, MissionState::ARM_LINE_POSE));
    assert_eq!(second.phase_start_ns - first.phase_start_ns, 3_000_000_000);
    assert_eq!(second.base_goal, first.base_goal, "the base holds what the phase before wanted");

    let done = flight.fly(4.0);
    assert_eq!(done.state, MissionState::DONE);
    assert_eq!((done.base_mode, done.arm_mode), (MissionState::BASE_FREE, MissionState::ARM_HOLD));
}

#[test]
fn valves_open_by_the_clock_of_their_phase_and_are_shut_in_the_end() {
    let mut flight = Flight::of(
        r#"
[[phase]]
duration_s = 2
base = { goal = "valves", pulses = [
    { at_s = 0.5, for_s = 0.25, thrusters = [1, 3] }, { at_s = 1.9, for_s = 0.1, thrusters = [2] },
] }
arm = { goal = "sines", q_deg = [0, 10, 0, 0], sines = [{ joint = 2, amplitude_deg = 5, frequency_Hz = 0.2 }] }
"#,
    );
    while flight.fly(0.05).state == MissionState::WAITING {}
    let mut open = vec![];
    for _ in 0..39 {
        let state = flight.fly(0.05);
        assert_eq!((state.base_mode, state.arm_mode), (MissionState::BASE_VALVES, MissionState::ARM_SINES));
        assert!((state.sine_amplitude_rad[3] - 5_f64.to_radians()).abs() < 1e-12, "the first of joint 2");
        open.push((state.valves[0], state.valves[1], state.valves[2]));
    }
    let steps = |valves| open.iter().filter(|seen| **seen == valves).count();
    assert_eq!((steps((1, 0, 1)), steps((0, 1, 0)), steps((0, 0, 0))), (5, 2, 32));
    assert_eq!(open[9], (1, 0, 1), "0.5 s after the start of the phase");
    let done = flight.fly(0.1);
    assert_eq!((done.state, done.base_mode, done.valves), (MissionState::DONE, MissionState::BASE_FREE, [0; 16]));
}

#[track_caller]
fn aborts_after(mut flight: Flight, spoil: impl Fn(&mut Flight), at_least_s: f64, at_most_s: f64) {
    assert_eq!(flight.fly(2.0).state, MissionState::RUNNING);
    spoil(&mut flight);
    assert_eq!(flight.fly(at_least_s).state, MissionState::RUNNING, "too hasty");
    let state = flight.fly(at_most_s - at_least_s);
    assert_eq!(state.state, MissionState::ABORTED, "too patient");
    assert_eq!((state.base_mode, state.arm_mode), (MissionState::BASE_FREE, MissionState::ARM_HOLD));
}

#[test]
fn lost_navigation_aborts_at_once() {
    aborts_after(Flight::of(HOLD_THEN_LINE), |f| f.nav().mode = NavState::LOST, 0.0, 0.1);
}

#[test]
fn a_blocked_arm_aborts_at_once() {
    aborts_after(Flight::of(HOLD_THEN_LINE), |f| f.sample.2.as_mut().unwrap().blocked = 1, 0.0, 0.1);
}

#[test]
fn silence_is_borne_for_a_while() {
    aborts_after(Flight::of(HOLD_THEN_LINE), |f| f.sample.0 = None, 1.0, 1.8);
    aborts_after(Flight::of(HOLD_THEN_LINE), |f| f.sample.1 = None, 1.0, 1.8);
    aborts_after(Flight::of(HOLD_THEN_LINE), |f| f.sample.2 = None, 1.0, 1.8);
    aborts_after(Flight::of(HOLD_THEN_LINE), |f| f.sample.1.as_mut().unwrap().alive[2] = 0, 0.9, 1.2);
}

#[test]
fn a_driver_that_failed_aborts_and_a_low_battery_does_not() {
    let fault = |bits| move |f: &mut Flight| f.sample.1.as_mut().unwrap().fault[1] = bits;
    aborts_after(Flight::of(HOLD_THEN_LINE), fault(LinksState::FAULT_DRIVER), 0.9, 1.2);
    let mut flight = Flight::of(HOLD_THEN_LINE);
    fault(LinksState::FAULT_BATTERY_LOW | LinksState::FAULT_JOINT_LIMIT)(&mut flight);
    assert_eq!(flight.fly(4.0).state, MissionState::RUNNING);
}

#[test]
fn a_mission_survives_a_gap_that_mends_itself() {
    let mut flight = Flight::of(HOLD_THEN_LINE);
    flight.fly(1.5);
    flight.nav().mode = NavState::COASTING;
    assert_eq!(flight.fly(1.5).state, MissionState::RUNNING, "coasting is good enough to go on");
    flight.sample.1.as_mut().unwrap().alive[0] = 0;
    flight.fly(0.5);
    flight.sample.1.as_mut().unwrap().alive[0] = 1;
    assert_eq!(flight.fly(1.5).state, MissionState::RUNNING);
}

const UNTIL_STILL: &str = r#"
[[phase]]
duration_s = 2
until = { condition = "still", speed_m_s = 0.01, omega_deg_s = 1, for_s = 1 }
timeout_s = 6
on_abort = "way out"
base = { goal = "stop" }
arm = { goal = "hold" }
[[phase]]
duration_s = 3
base = { goal = "free" }
arm = { goal = "hold" }
[[abort]]
name = "way out"
duration_s = 2
gripper = "open"
base = { goal = "hold" }
arm = { goal = "hold" }
"#;

#[test]
fn a_phase_ends_when_its_condition_has_held_for_long_enough() {
    let mut flight = Flight::of(UNTIL_STILL);
    flight.nav().omega_rad_s = 0.5;
    while flight.fly(0.05).state == MissionState::WAITING {}
    let state = flight.fly(2.0);
    assert_eq!((state.phase, state.base_mode), (0, MissionState::BASE_STOP), "it still turns");
    flight.nav().omega_rad_s = 0.0;
    assert_eq!(flight.fly(0.9).phase, 0, "not for long enough");
    flight.nav().omega_rad_s = 0.5;
    flight.fly(0.1);
    flight.nav().omega_rad_s = 0.0;
    assert_eq!(flight.fly(0.9).phase, 0, "it was not still in between");
    assert_eq!(flight.fly(0.3).phase, 1);
    assert_eq!(flight.fly(4.0).state, MissionState::DONE);
}

#[test]
fn a_condition_that_does_not_come_leads_to_the_way_out_and_ends_aborted() {
    let mut flight = Flight::of(UNTIL_STILL);
    flight.nav().omega_rad_s = 0.5;
    while flight.fly(0.05).state == MissionState::WAITING {}
    assert_eq!(flight.fly(5.8).phase, 0, "too hasty");
    let state = flight.fly(0.4);
    assert_eq!((state.state, state.phase, state.phase_count), (MissionState::RUNNING, 2, 2), "on its way out");
    assert_eq!(state.base_mode, MissionState::BASE_HOLD);
    let state = flight.fly(2.2);
    assert_eq!((state.state, state.base_mode), (MissionState::ABORTED, MissionState::BASE_FREE));
}

const FOLLOWING: &str = r#"
[[phase]]
duration_s = 10
base = { goal = "follow" }
arm = { goal = "follow" }
[[phase]]
duration_s = 10
base = { goal = "hold" }
arm = { goal = "hold" }
"#;

impl Flight {
    /// A controller outside wants this, `age_ns` ago.
    fn wants(&mut self, base_goal: [f64; 3], q_rad: &[f64], age_ns: u64) {
        let mut q_goal_rad = [f64::NAN; MAX_LINKS];
        q_goal_rad[..q_rad.len()].copy_from_slice(q_rad);
        let stamp_ns = self.now.ns() - age_ns;
        self.goals.publish(MissionGoal { stamp_ns, base_goal, q_goal_rad, ..MissionGoal::default() });
        self.goals.flush(self.now);
    }
}

#[test]
fn a_phase_that_follows_stays_where_it_is_until_it_is_told_and_goes_where_it_is_told() {
    let mut flight = Flight::of(FOLLOWING);
    flight.sample.1.as_mut().unwrap().q_rad[..4].copy_from_slice(&[0.1, 0.2, 0.3, 0.4]);
    let state = flight.fly(2.0);
    assert_eq!((state.base_mode, state.arm_mode), (MissionState::BASE_HOLD, MissionState::ARM_FOLLOW));
    assert_eq!((state.base_goal, &state.q_goal_rad[..4]), ([0.5, -0.25, 0.1], [0.1, 0.2, 0.3, 0.4].as_slice()));
    // Two goals between two steps count both, and what one says nothing of stays.
    flight.wants([0.2, 0.2, 0.3], &[], 0);
    flight.wants([f64::NAN; 3], &[f64::NAN, 0.5], 0);
    let state = flight.fly(0.1);
    assert_eq!(
        (&state.base_goal[..2], &state.q_goal_rad[..4]),
        ([0.2, 0.2].as_slice(), [0.1, 0.5, 0.3, 0.4].as_slice())
    );
    assert!((state.base_goal[2] - 0.3).abs() < 1e-9);
    // Turned by nearly a whole turn is a short way back.
    flight.wants([0.2, 0.1, 6.2], &[], 0);
    assert!(flight.fly(0.1).base_goal[2].abs() < 0.1);
}

#[test]
fn goals_that_are_old_or_that_no_phase_follows_change_nothing() {
    let mut flight = Flight::of(FOLLOWING);
    flight.wants([0.2, 0.1, 0.3], &[0.5], 0);
    let state = flight.fly(2.0);
    assert_eq!((state.base_goal, state.q_goal_rad[0]), ([0.5, -0.25, 0.1], 0.0), "it came before the mission began");
    flight.wants([0.2, 0.1, 0.3], &[0.5], 600_000_000);
    assert_eq!(flight.fly(0.1).base_goal, [0.5, -0.25, 0.1]);
    let state = flight.fly(11.0);
    assert_eq!((state.phase, state.arm_mode), (1, MissionState::ARM_HOLD));
    flight.wants([0.2, 0.1, 0.3], &[0.5], 0);
    let state = flight.fly(0.1);
    assert_eq!((state.base_goal, state.q_goal_rad[0]), ([0.5, -0.25, 0.1], 0.0));
}
