//! Lines on the simulated table: servos with friction, commands and telemetry five times a second, noise, moving air.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use fss_arm::{ArmConfig, ArmService, Drive};
use fss_bus::{Bus, InputPort, Latest, Output, OutputPort, Runner, Time};
use fss_messages::{ArmCommand, LinksState, MissionState, MocapPose, NavState, topic};
use fss_plant::{Instruments, JointCommand, LinkSample, Plant, Simulation};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

const MS: u64 = 1_000_000;
const LINKS: usize = 4;
const START_DEG: [f64; LINKS] = [-30.0, 60.0, -60.0, 30.0];

/// What a run came to.
#[derive(Debug)]
struct Outcome {
    /// Largest turn of the base since the line began, degrees.
    base_turn_deg: f64,
    /// End-effector less the end of its line, m: when the line ends, and four seconds later.
    ee_error_m: f64,
    settled_ee_error_m: f64,
    moved_m: f64,
    blocked: bool,
}

struct Table {
    simulation: Simulation,
    instruments: Instruments,
    arm: Runner<ArmService>,
    nav: Output<NavState>,
    links: Output<LinksState>,
    mission: Output<MissionState>,
    mocap: Output<MocapPose>,
    command: Latest<ArmCommand>,
    random: ChaCha8Rng,
    now: Time,
    /// What each link's driver was told, and when.
    told: [(ArmCommand, u64); LINKS],
    /// Each link's last telemetry and when it was measured.
    heard: [(LinkSample, u64); LINKS],
    goal: MissionState,
    has_ee_mocap: bool,
}

impl Table {
    fn new(plant: &Plant, seed: u64, adjust: impl FnOnce(&mut ArmConfig)) -> Self {
        let mut config = ArmConfig::new(plant).unwrap();
        adjust(&mut config);
        let mut simulation = Simulation::new(plant, seed).unwrap();
        simulation.set_state([-0.6, 0.0, 0.0], [0.0; 3], &START_DEG.map(f64::to_radians), &[0.0; LINKS]);
        let mut instruments = Instruments::new(LINKS, seed);
        let first = std::array::from_fn(|i| (instruments.link(&simulation, i), 0));
        let bus = Bus::local();
        Self {
            simulation,
            instruments,
            arm: Runner::new(ArmService::new(config), &bus).unwrap(),
            nav: Output::open(&bus, topic::NAV_STATE).unwrap(),
            links: Output::open(&bus, topic::LINKS_STATE).unwrap(),
            mission: Output::open(&bus, topic::MISSION_STATE).unwrap(),
            mocap: Output::open(&bus, topic::MOCAP_END_EFFECTOR).unwrap(),
            command: Latest::open(&bus, topic::ARM_COMMAND).unwrap(),
            random: ChaCha8Rng::seed_from_u64(seed),
            now: Time::from_ns(0),
            told: [(ArmCommand::default(), 0); LINKS],
            heard: first,
            goal: MissionState { arm_mode: MissionState::ARM_HOLD, ..MissionState::default() },
            has_ee_mocap: false,
        }
    }

    fn noise(&mut self, std: f64) -> f64 {
        Normal::new(0.0, std).unwrap().sample(&mut self.random)
    }

    /// Navigation as good as the stack must have it, telemetry as old as the radio makes it.
    fn show(&mut self) {
        let (stamp_ns, truth) = (self.now.ns(), self.simulation.truth());
        let nav = NavState {
            stamp_ns,
            x_m: truth.base_pose[0] + self.noise(2e-4),
            y_m: truth.base_pose[1] + self.noise(2e-4),
            theta_rad: truth.base_pose[2] + self.noise(3e-4),
            vx_m_s: truth.base_velocity[0] + self.noise(3e-4),
            vy_m_s: truth.base_velocity[1] + self.noise(3e-4),
            omega_rad_s: truth.base_velocity[2] + self.noise(5e-4),
            mode: NavState::TRACKING,
            ..NavState::default()
        };
        let mut links = LinksState { stamp_ns, link_count: LINKS as u32, ..LinksState::default() };
        for (i, (sample, measured_ns)) in self.heard.iter().enumerate() {
            let age_s = (stamp_ns - measured_ns) as f64 * 1e-9;
            links.q_rad[i] = sample.q_rad + sample.qd_rad_s * age_s;
            links.qd_rad_s[i] = sample.qd_rad_s;
            (links.measured_q_rad[i], links.measured_ns[i]) = (sample.q_rad, *measured_ns);
            links.alive[i] = 1;
            links.driver_mode[i] = LinksState::DRIVER_POSITION;
        }
        self.nav.publish(nav);
        self.links.publish(links);
        self.mission.publish(MissionState { stamp_ns, ..self.goal });
        if self.has_ee_mocap
            && let Some([x_m, y_m, theta_rad]) = self.instruments.mocap_end_effector(&self.simulation)
        {
            self.mocap.publish(MocapPose { stamp_ns, x_m, y_m, theta_rad, ..MocapPose::default() });
        }
        self.nav.flush(self.now);
        self.links.flush(self.now);
        self.mission.flush(self.now);
        self.mocap.flush(self.now);
    }

    /// One millisecond.
    fn tick(&mut self) {
        let now_ns = self.now.ns();
        if now_ns.is_multiple_of(20 * MS) {
            self.show();
            self.arm.step(self.now);
            self.arm.flush(self.now);
            self.command.refresh();
        }
        for i in 0..LINKS {
            // Commands leave together; telemetry comes when each link likes, 30 ms old.
            if now_ns % (200 * MS) == 60 * MS {
                self.told[i] = (*self.command.get().unwrap(), now_ns);
            }
            if now_ns % (200 * MS) == 50 * MS * i as u64 + 7 * MS {
                self.heard[i] = (self.instruments.link(&self.simulation, i), now_ns.saturating_sub(30 * MS));
            }
            let (command, told_ns) = &self.told[i];
            let since_s = (now_ns - told_ns) as f64 * 1e-9;
            let (q, qd_rad_s) = (command.q_rad[i], command.qd_rad_s[i]);
            self.simulation.set_joint(
                i,
                match command.mode {
                    ArmCommand::POSITION => JointCommand::Position { q_rad: q + qd_rad_s * since_s, qd_rad_s },
                    ArmCommand::VELOCITY => JointCommand::Velocity { qd_rad_s },
                    _ => JointCommand::Free,
                },
            );
        }
        self.simulation.step(1e-3);
        self.now = self.now.plus_ns(MS);
    }

    /// Lets time pass; returns the base's largest turn from the heading `from_rad`, degrees.
    fn pass(&mut self, seconds: f64, from_rad: f64) -> f64 {
        let mut largest: f64 = 0.0;
        for _ in 0..(seconds * 1e3) as u64 {
            self.tick();
            largest = largest.max((self.simulation.truth().base_pose[2] - from_rad).abs().to_degrees());
        }
        largest
    }

    /// A line of 0.1 m towards 240 degrees in 20 s.
    fn fly(&mut self, arm_mode: u8) -> Outcome {
        self.pass(3.0, 0.0);
        self.goal = MissionState {
            state: MissionState::RUNNING,
            arm_mode,
            line_length_m: 0.1,
            line_direction_rad: 240_f64.to_radians(),
            arm_duration_s: 20.0,
            phase_start_ns: self.now.ns(),
            ..MissionState::default()
        };
        let start = self.simulation.truth().ee_pose;
        let error = |table: &Self| {
            let ee = table.simulation.truth().ee_pose;
            let (sin, cos) = 240_f64.to_radians().sin_cos();
            (ee[0] - start[0] - 0.1 * cos).hypot(ee[1] - start[1] - 0.1 * sin)
        };
        let heading = self.simulation.truth().base_pose[2];
        let on_the_way = self.pass(20.1, heading);
        let (ee_error_m, moved) = (error(self), self.simulation.truth().ee_pose);
        let after = self.pass(4.0, heading);
        Outcome {
            base_turn_deg: on_the_way.max(after),
            ee_error_m,
            settled_ee_error_m: error(self),
            moved_m: (moved[0] - start[0]).hypot(moved[1] - start[1]),
            blocked: self.command.get().unwrap().blocked != 0,
        }
    }
}

fn plant() -> Plant {
    Plant::default_laboratory().unwrap()
}

#[test]
fn the_arm_moves_its_end_effector_and_the_base_does_not_turn() {
    for (drive, most_deg) in [(Drive::Position, 0.3), (Drive::Velocity, 0.5)] {
        for seed in 0..3 {
            let mut table = Table::new(&plant(), seed, |config| config.drive = drive);
            let outcome = table.fly(MissionState::ARM_ZERO_REACTION);
            println!("{drive:?}, seed {seed}: {outcome:?}");
            assert!(!outcome.blocked && outcome.moved_m > 0.09);
            assert!(outcome.base_turn_deg < most_deg, "the base turns");
            assert!(outcome.settled_ee_error_m < 5e-3 && outcome.ee_error_m < 5e-3, "it misses the end of its line");
        }
    }
}

#[test]
fn the_same_line_without_it_turns_the_base() {
    let outcome = Table::new(&plant(), 1, |_| {}).fly(MissionState::ARM_LINE);
    println!("{outcome:?}");
    assert!(outcome.base_turn_deg > 8.0 && outcome.settled_ee_error_m < 5e-3);
}

#[test]
fn the_end_effector_keeps_its_orientation_where_it_shall() {
    let mut table = Table::new(&plant(), 2, |_| {});
    let outcome = table.fly(MissionState::ARM_ZERO_REACTION_POSE);
    println!("{outcome:?}");
    assert!(!outcome.blocked && outcome.base_turn_deg < 0.4 && outcome.settled_ee_error_m < 5e-3);
}

#[test]
fn motion_capture_of_the_end_effector_makes_good_for_a_bad_calibration() {
    let mut off = plant();
    for link in &mut off.links {
        link.joint_offset_rad += 1_f64.to_radians();
    }
    let fly = |has_ee_mocap| {
        let mut table = Table::new(&plant(), 3, |config| config.model = ArmConfig::new(&off).unwrap().model);
        table.has_ee_mocap = has_ee_mocap;
        table.fly(MissionState::ARM_ZERO_REACTION)
    };
    let (without, with) = (fly(false), fly(true));
    println!("joint offsets 1 degree wrong; without {without:?}\nwith {with:?}");
    assert!(with.settled_ee_error_m < 3e-3 && with.base_turn_deg < 0.3);
    assert!(without.settled_ee_error_m > with.settled_ee_error_m);
}
