//! The base under control on the simulated table: on/off valves, a locked arm that outweighs it, and the room's air.
#![allow(clippy::unwrap_used)]

use fss_base::allocation::Allocator;
use fss_base::{Base, BaseConfig};
use fss_bus::{Bus, InputPort, Latest, Output, OutputPort, Runner, Time};
use fss_messages::{LinksState, MissionState, NavState, ThrustersCommand, topic};
use fss_plant::{JointCommand, Plant, Simulation};

const RATE_HZ: f64 = 100.0;
const Q_RAD: [f64; 4] = [-0.5, 1.0, -1.0, 0.5];

struct Table {
    simulation: Simulation,
    runner: Runner<Base>,
    nav: Output<NavState>,
    mission: Output<MissionState>,
    links: Output<LinksState>,
    valves: Latest<ThrustersCommand>,
    k: u64,
    opened: u64,
}

impl Table {
    fn new(plant: &Plant) -> Self {
        let bus = Bus::local();
        let mut simulation = Simulation::new(plant, 3).unwrap();
        simulation.set_state([-0.6, 0.1, 0.2], [0.0; 3], &Q_RAD, &[0.0; 4]);
        for joint in 0..4 {
            simulation.set_joint(joint, JointCommand::Position { q_rad: Q_RAD[joint], qd_rad_s: 0.0 });
        }
        let config = BaseConfig::from_plant(plant, simulation.model().clone(), RATE_HZ);
        Self {
            simulation,
            runner: Runner::new(Base::new(config), &bus).unwrap(),
            nav: Output::open(&bus, topic::NAV_STATE).unwrap(),
            mission: Output::open(&bus, topic::MISSION_STATE).unwrap(),
            links: Output::open(&bus, topic::LINKS_STATE).unwrap(),
            valves: Latest::open(&bus, topic::THRUSTERS_COMMAND).unwrap(),
            k: 0,
            opened: 0,
        }
    }

    /// Flies towards a goal for `seconds`; `nav_works` says whether navigation is there.
    fn fly(&mut self, goal: [f64; 3], duration_s: f64, seconds: f64, nav_works: bool) -> [f64; 3] {
        let start_ns = self.k * 10_000_000;
        for _ in 0..(seconds * RATE_HZ) as u64 {
            let now = Time::from_ns(self.k * 10_000_000);
            let truth = self.simulation.truth();
            let ([x_m, y_m, theta_rad], [vx_m_s, vy_m_s, omega_rad_s]) = (truth.base_pose, truth.base_velocity);
            if nav_works {
                let (stamp_ns, mode) = (now.ns(), NavState::TRACKING);
                self.nav.publish(NavState {
                    stamp_ns,
                    x_m,
                    y_m,
                    theta_rad,
                    vx_m_s,
                    vy_m_s,
                    omega_rad_s,
                    mode,
                    ..NavState::default()
                });
                self.nav.flush(now);
            }
            self.mission.publish(MissionState {
                stamp_ns: now.ns(),
                phase_start_ns: start_ns,
                state: MissionState::RUNNING,
                base_mode: MissionState::BASE_HOLD,
                base_goal: goal,
                base_duration_s: duration_s,
                ..MissionState::default()
            });
            self.mission.flush(now);
            let mut links = LinksState { stamp_ns: now.ns(), link_count: 4, ..LinksState::default() };
            links.q_rad[..4].copy_from_slice(&Q_RAD);
            self.links.publish(links);
            self.links.flush(now);
            self.runner.step(now);
            self.runner.flush(now);
            self.valves.refresh();
            let valves = self.valves.get().unwrap().valves;
            self.opened += valves.iter().map(|&v| u64::from(v)).sum::<u64>();
            self.simulation.set_valves(&valves[..8].iter().map(|&v| v == 1).collect::<Vec<_>>());
            self.simulation.step(1.0 / RATE_HZ);
            self.k += 1;
        }
        self.simulation.truth().base_pose
    }
}

fn assert_at(pose: [f64; 3], goal: [f64; 3]) {
    let (position_m, heading_deg) = ((pose[0] - goal[0]).hypot(pose[1] - goal[1]), (pose[2] - goal[2]).to_degrees());
    assert!(position_m < 0.01 && heading_deg.abs() < 1.0, "{position_m} m and {heading_deg} deg from the goal");
}

#[test]
fn a_base_holds_its_pose_against_the_rooms_air() {
    let mut table = Table::new(&Plant::default_laboratory().unwrap());
    let goal = [-0.6, 0.1, 0.2];
    for _ in 0..12 {
        assert_at(table.fly(goal, 0.0, 5.0, true), goal);
    }
}

#[test]
fn a_base_slews_and_translates_and_settles() {
    let mut table = Table::new(&Plant::default_laboratory().unwrap());
    let turned = [-0.6, 0.1, 0.2 + 0.35];
    table.fly(turned, 40.0, 40.0, true);
    assert_at(table.fly(turned, 40.0, 20.0, true), turned);
    let moved = [-0.3, -0.1, 0.55];
    table.fly(moved, 40.0, 40.0, true);
    assert_at(table.fly(moved, 40.0, 20.0, true), moved);
}

#[test]
fn a_tilted_table_is_held_against() {
    let text = format!(
        "{}\n[[effect]]\nid = \"table_tilt\"\naccel_x_m_s2 = 0.002\naccel_y_m_s2 = -0.001\n",
        fss_plant::DEFAULT_PLANT
    );
    let mut table = Table::new(&Plant::parse(&text).unwrap());
    let goal = [-0.6, 0.1, 0.2];
    table.fly(goal, 0.0, 120.0, true);
    assert_at(table.fly(goal, 0.0, 10.0, true), goal);
}

#[test]
fn a_base_whose_navigation_falls_silent_shuts_its_thrusters() {
    let mut table = Table::new(&Plant::default_laboratory().unwrap());
    table.fly([0.4, 0.1, 0.2], 0.0, 2.0, true);
    assert!(table.opened > 50, "far from its goal it thrusts");
    table.fly([0.4, 0.1, 0.2], 0.0, 0.1, false);
    table.opened = 0;
    table.fly([0.4, 0.1, 0.2], 0.0, 2.0, false);
    assert_eq!(table.opened, 0);
}

#[test]
fn thrusters_make_the_wanted_wrench_and_never_push_against_each_other() {
    let plant = Plant::default_laboratory().unwrap();
    let wrenches: Vec<_> = (0..8).map(|i| plant.thruster_wrench(i)).collect();
    let mut allocator = Allocator::new(&wrenches);
    for (fx, fy, torque) in [(0.1, 0.0, 0.0), (-0.05, 0.08, 0.004), (0.0, 0.0, -0.02), (0.15, -0.15, 0.005)] {
        let duty = allocator.allocate([fx, fy, torque]).duty;
        let made = |axis: usize| (0..8).map(|i| duty[i] * wrenches[i][axis]).sum::<f64>();
        assert!(
            (made(0) - fx).abs() < 2e-3 && (made(1) - fy).abs() < 2e-3 && (made(2) - torque).abs() < 3e-4,
            "{duty:?}"
        );
        assert!(duty.iter().all(|u| (0.0..=1.0).contains(u)));
        // Thrusters 1 and 2 push along -x, 3 and 4 along +x: a torque may need one of each, never three.
        assert!(duty[..4].iter().filter(|u| **u > 1e-6).count() <= 2, "{duty:?}");
    }
    let beyond = allocator.allocate([5.0, 0.0, 0.0]);
    assert!(beyond.missing > 0.5, "more than the thrusters have");
}
