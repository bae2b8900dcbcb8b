//! A vehicle on the simulated table, its base under control and its arm held.
#![allow(dead_code, unreachable_pub)]

use fss_base::{Base, BaseConfig};
use fss_bus::allocation::allocations_in;
use fss_bus::{Bus, InputPort, Latest, Output, OutputPort, Runner, Time};
use fss_messages::{BaseCommand, LinksState, MissionState, NavState, ThrustersCommand, topic};
use fss_plant::{JointCommand, Plant, Simulation};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub const RATE_HZ: f64 = 100.0;
const PERIOD_NS: u64 = 10_000_000;
const SEED: u64 = 20_261_121;
const Q_RAD: [f64; 4] = [-0.5, 1.0, -1.0, 0.5];
pub const START: [f64; 3] = [-0.6, 0.1, 0.2];

/// Errors of the navigation filter on a quiet base, as `fusion`'s tests measure them: x, y, theta, vx, vy, omega; they
/// last for about a tenth of a second.
const NAV_ERROR: [f64; 6] = [8e-5, 8e-5, 8e-5, 6e-4, 6e-4, 6e-4];
const NAV_ERROR_KEEPS: f64 = 0.9;

pub struct Table {
    pub simulation: Simulation,
    pub runner: Runner<Base>,
    pub bus: Bus,
    pub nav_works: bool,
    /// Whole turns that the navigation has forgotten.
    pub forgotten_turns: f64,
    nav: Output<NavState>,
    mission: Output<MissionState>,
    links: Output<LinksState>,
    valves: Latest<ThrustersCommand>,
    command: Latest<BaseCommand>,
    rng: ChaCha8Rng,
    nav_error: [f64; 6],
    k: u64,
    phase_start_ns: u64,
    /// Valve openings so far, and steps in which each was open.
    pub pulses: u64,
    pub opened: u64,
    last_valves: [u8; 16],
    /// What the controller's steps asked of the heap, where the test counts.
    pub allocations: u64,
}

impl Table {
    pub fn new(plant: &Plant) -> Self {
        println!("seed {SEED}");
        let bus = Bus::local();
        let mut simulation = Simulation::new(plant, SEED).unwrap();
        simulation.set_state(START, [0.0; 3], &Q_RAD, &[0.0; 4]);
        for joint in 0..4 {
            simulation.set_joint(joint, JointCommand::Position { q_rad: Q_RAD[joint], qd_rad_s: 0.0 });
        }
        Self {
            runner: controller(plant, &simulation, &bus),
            nav_works: true,
            forgotten_turns: 0.0,
            nav: Output::open(&bus, topic::NAV_STATE).unwrap(),
            mission: Output::open(&bus, topic::MISSION_STATE).unwrap(),
            links: Output::open(&bus, topic::LINKS_STATE).unwrap(),
            valves: Latest::open(&bus, topic::THRUSTERS_COMMAND).unwrap(),
            command: Latest::open(&bus, topic::BASE_COMMAND).unwrap(),
            bus,
            simulation,
            rng: ChaCha8Rng::seed_from_u64(SEED),
            nav_error: [0.0; 6],
            k: 0,
            phase_start_ns: 0,
            pulses: 0,
            opened: 0,
            last_valves: [0; 16],
            allocations: 0,
        }
    }

    /// The controller dies and another takes its place.
    pub fn restart_controller(&mut self, plant: &Plant) {
        self.runner = controller(plant, &self.simulation, &self.bus);
    }

    fn publish_nav(&mut self, now: Time) {
        let truth = self.simulation.truth();
        for (error, sd) in self.nav_error.iter_mut().zip(NAV_ERROR) {
            let n: f64 = StandardNormal.sample(&mut self.rng);
            *error = NAV_ERROR_KEEPS * *error + sd * (1.0 - NAV_ERROR_KEEPS.powi(2)).sqrt() * n;
        }
        let (p, v, e) = (truth.base_pose, truth.base_velocity, self.nav_error);
        self.nav.publish(NavState {
            stamp_ns: now.ns(),
            x_m: p[0] + e[0],
            y_m: p[1] + e[1],
            theta_rad: p[2] + e[2] - std::f64::consts::TAU * self.forgotten_turns,
            vx_m_s: v[0] + e[3],
            vy_m_s: v[1] + e[4],
            omega_rad_s: v[2] + e[5],
            mode: NavState::TRACKING,
            ..NavState::default()
        });
        self.nav.flush(now);
    }

    /// A new phase of the mission: flies towards a goal for `seconds`; returns the largest distance from the reference.
    pub fn fly(&mut self, goal: [f64; 3], duration_s: f64, seconds: f64) -> [f64; 3] {
        self.phase_start_ns = self.k * PERIOD_NS;
        self.fly_on(goal, duration_s, seconds)
    }

    /// Goes on with the phase.
    pub fn fly_on(&mut self, goal: [f64; 3], duration_s: f64, seconds: f64) -> [f64; 3] {
        let mut largest = [0.0_f64; 3];
        for _ in 0..(seconds * RATE_HZ) as u64 {
            self.step(goal, duration_s);
            let error = self.command.get().unwrap().error;
            largest = std::array::from_fn(|i| largest[i].max(error[i].abs()));
        }
        largest
    }

    fn step(&mut self, goal: [f64; 3], duration_s: f64) {
        let now = Time::from_ns(self.k * PERIOD_NS);
        if self.nav_works {
            self.publish_nav(now);
        }
        self.mission.publish(MissionState {
            stamp_ns: now.ns(),
            phase_start_ns: self.phase_start_ns,
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
        self.allocations += allocations_in(|| self.runner.step(now));
        self.runner.flush(now);
        self.command.refresh();
        self.valves.refresh();
        let valves = self.valves.get().unwrap().valves;
        for (now, before) in valves.iter().zip(self.last_valves) {
            self.opened += u64::from(*now);
            self.pulses += u64::from(*now == 1 && before == 0);
        }
        self.last_valves = valves;
        self.simulation.set_valves(&valves[..8].iter().map(|&v| v == 1).collect::<Vec<_>>());
        self.simulation.step(1.0 / RATE_HZ);
        self.k += 1;
    }

    /// Fails unless the base stands within 1 cm and 1 degree of the goal.
    #[track_caller]
    pub fn assert_at(&self, goal: [f64; 3]) {
        let pose = self.simulation.truth().base_pose;
        let (position_m, heading_deg) =
            ((pose[0] - goal[0]).hypot(pose[1] - goal[1]), (pose[2] - goal[2]).to_degrees());
        println!("{:.2} mm, {heading_deg:.3} deg from the goal", position_m * 1e3);
        assert!(position_m < 0.01 && heading_deg.abs() < 1.0, "{position_m} m and {heading_deg} deg from the goal");
    }
}

fn controller(plant: &Plant, simulation: &Simulation, bus: &Bus) -> Runner<Base> {
    let config = BaseConfig::from_plant(plant, *simulation.model(), RATE_HZ);
    Runner::new(Base::new(config), bus).unwrap()
}
