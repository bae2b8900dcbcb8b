//! An ideal vehicle: joints do exactly what they are told, the base answers as momentum commands, all is seen without error.
#![allow(dead_code, unreachable_pub, clippy::large_types_passed_by_value)] // not every test file needs all of it

use fss_arm::{ArmConfig, ArmService};
use fss_bus::{Bus, InputPort, Latest, Output, OutputPort, Runner, Time};
use fss_messages::{ArmCommand, Event, LinksState, MissionState, NavState, text_of, topic};
use fss_multibody::{Coordinates, JointVector, MAX_LINKS, Model};
use fss_plant::Plant;
use nalgebra::Vector3;

pub const START_DEG: [f64; 4] = [-30.0, 60.0, -60.0, 30.0];

pub fn plant() -> Plant {
    Plant::default_laboratory().unwrap()
}

/// A mission in which the arm moves along a line.
pub fn line(arm_mode: u8, length_m: f64, direction_deg: f64, duration_s: f64) -> MissionState {
    MissionState {
        state: MissionState::RUNNING,
        arm_mode,
        line_length_m: length_m,
        line_direction_rad: direction_deg.to_radians(),
        arm_duration_s: duration_s,
        phase_count: 1,
        ..MissionState::default()
    }
}

/// What happened on the way.
#[derive(Clone, Debug, Default)]
pub struct Record {
    pub base_turn_deg: f64,
    pub largest_base_turn_deg: f64,
    /// End-effector less where the line wants it, m; at the end and at most.
    pub ee_error_m: f64,
    pub largest_ee_error_m: f64,
    pub ee_turn_deg: f64,
    pub sigma_min: f64,
    pub largest_rate_rad_s: f64,
    pub largest_joint_deg: f64,
    pub q_deg: Vec<f64>,
    pub blocked: bool,
    pub progress: f64,
    pub events: Vec<String>,
}

/// The vehicle, its controller and what this is told.
pub struct World {
    pub model: Model,
    pub q: Coordinates,
    pub rates: JointVector,
    /// Momentum `[Px, Py, L about the base's origin at the start]`.
    pub momentum: Vector3<f64>,
    pub arm: Runner<ArmService>,
    pub mission: Option<MissionState>,
    pub now: Time,
    pub command: ArmCommand,
    /// Changes what the controller sees.
    pub spoil: fn(&mut NavState, &mut LinksState),
    pub has_nav: bool,
    pub has_links: bool,
    /// What the controller saw last.
    pub seen: (NavState, LinksState),
    period_ns: u64,
    nav_out: Output<NavState>,
    links_out: Output<LinksState>,
    mission_out: Output<MissionState>,
    command_in: Latest<ArmCommand>,
    events_in: fss_bus::Batch<Event>,
    record: Record,
}

impl World {
    /// With the joints at `q_deg`, the controller stepped every `period_s`.
    pub fn new(q_deg: &[f64], period_s: f64) -> Self {
        Self::with(q_deg, period_s, |_| {})
    }

    pub fn with(q_deg: &[f64], period_s: f64, adjust: impl FnOnce(&mut ArmConfig)) -> Self {
        Self::of(&plant(), q_deg, period_s, adjust)
    }

    /// With the vehicle of a plant.
    pub fn of(plant: &Plant, q_deg: &[f64], period_s: f64, adjust: impl FnOnce(&mut ArmConfig)) -> Self {
        let mut config = ArmConfig::new(plant).unwrap();
        config.max_age_ns = config.max_age_ns.max((2.5e9 * period_s) as u64);
        adjust(&mut config);
        let mut q = Coordinates::zeros();
        for (i, degrees) in q_deg.iter().enumerate() {
            q[3 + i] = degrees.to_radians();
        }
        let bus = Bus::local();
        let model = config.model;
        Self {
            model,
            q,
            rates: JointVector::zeros(),
            momentum: Vector3::zeros(),
            arm: Runner::new(ArmService::new(config), &bus).unwrap(),
            mission: Some(MissionState { arm_mode: MissionState::ARM_HOLD, ..MissionState::default() }),
            now: Time::from_ns(1_000_000_000),
            command: ArmCommand::default(),
            spoil: |_, _| {},
            has_nav: true,
            has_links: true,
            seen: (NavState::default(), LinksState::default()),
            period_ns: (period_s * 1e9) as u64,
            nav_out: Output::open(&bus, topic::NAV_STATE).unwrap(),
            links_out: Output::open(&bus, topic::LINKS_STATE).unwrap(),
            mission_out: Output::open(&bus, topic::MISSION_STATE).unwrap(),
            command_in: Latest::open(&bus, topic::ARM_COMMAND).unwrap(),
            events_in: fss_bus::Batch::open(&bus, topic::EVENTS).unwrap(),
            record: Record::default(),
        }
    }

    pub fn links(&self) -> usize {
        self.model.link_count()
    }

    pub fn ee(&self) -> Vector3<f64> {
        self.model.end_effector(&self.q)
    }

    /// Begins a phase now, and the record with it.
    pub fn begin(&mut self, mission: MissionState) {
        self.mission = Some(MissionState { phase_start_ns: self.now.ns(), state: MissionState::RUNNING, ..mission });
        self.record = Record { sigma_min: f64::INFINITY, ..Record::default() };
    }

    /// Shows the controller the vehicle without letting it act.
    pub fn show(&mut self) {
        let stamp_ns = self.now.ns();
        let twist = self.model.base_twist(&self.q, &self.rates, &self.momentum);
        let mut nav = NavState {
            stamp_ns,
            x_m: self.q[0],
            y_m: self.q[1],
            theta_rad: self.q[2],
            vx_m_s: twist.x,
            vy_m_s: twist.y,
            omega_rad_s: twist.z,
            mode: NavState::TRACKING,
            ..NavState::default()
        };
        let mut links = LinksState { stamp_ns, link_count: self.links() as u32, ..LinksState::default() };
        for i in 0..self.links() {
            links.q_rad[i] = self.q[3 + i];
            links.qd_rad_s[i] = self.rates[i];
            (links.measured_q_rad[i], links.measured_ns[i]) = (self.q[3 + i], stamp_ns);
            links.alive[i] = 1;
            links.driver_mode[i] = LinksState::DRIVER_POSITION;
        }
        (self.spoil)(&mut nav, &mut links);
        self.seen = (nav, links);
        if self.has_nav {
            self.nav_out.publish(nav);
            self.nav_out.flush(self.now);
        }
        if self.has_links {
            self.links_out.publish(links);
            self.links_out.flush(self.now);
        }
        if let Some(mission) = self.mission {
            self.mission_out.publish(MissionState { stamp_ns, ..mission });
            self.mission_out.flush(self.now);
        }
    }

    /// One period: the controller looks and commands, the vehicle moves.
    fn tick(&mut self) {
        self.show();
        self.arm.step(self.now);
        self.arm.flush(self.now);
        self.command_in.refresh();
        self.command = *self.command_in.get().unwrap();
        self.events_in.refresh();
        for event in self.events_in.samples() {
            self.record.events.push(text_of(&event.text).to_owned());
        }
        self.rates = if self.command.mode == ArmCommand::OFF {
            JointVector::zeros()
        } else {
            JointVector::from_column_slice(&self.command.qd_rad_s)
        };
        self.move_on(self.period_ns as f64 * 1e-9);
        self.now = self.now.plus_ns(self.period_ns);
    }

    /// The base follows from the momentum; the classic Runge-Kutta method.
    fn move_on(&mut self, dt_s: f64) {
        let steps = (dt_s / 0.01).ceil() as usize;
        let h = dt_s / steps as f64;
        for _ in 0..steps {
            let rate = |q: &Coordinates| {
                let twist = self.model.base_twist(q, &self.rates, &self.momentum);
                let mut v = Coordinates::zeros();
                v.fixed_rows_mut::<3>(0).copy_from(&twist);
                v.fixed_rows_mut::<MAX_LINKS>(3).copy_from(&self.rates);
                v
            };
            let k1 = rate(&self.q);
            let k2 = rate(&(self.q + k1 * (h / 2.0)));
            let k3 = rate(&(self.q + k2 * (h / 2.0)));
            let k4 = rate(&(self.q + k3 * h));
            self.q += (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0);
        }
    }

    /// Lets time pass and tells what happened since the phase began.
    pub fn pass(&mut self, seconds: f64) -> Record {
        let (theta, ee) = (self.q[2], self.ee());
        for _ in 0..(seconds * 1e9 / self.period_ns as f64).round() as u64 {
            self.tick();
            let turn = (self.q[2] - theta).to_degrees();
            let r = &mut self.record;
            r.base_turn_deg = turn;
            r.largest_base_turn_deg = r.largest_base_turn_deg.max(turn.abs());
            r.largest_rate_rad_s = r.largest_rate_rad_s.max(self.rates.amax());
            let joints = self.q.fixed_rows::<MAX_LINKS>(3);
            r.largest_joint_deg = r.largest_joint_deg.max(joints.amax().to_degrees());
            if self.command.sigma_min > 0.0 {
                r.sigma_min = r.sigma_min.min(self.command.sigma_min);
            }
            r.blocked |= self.command.blocked != 0;
            let goal = self.mission.map_or(ee, |m| {
                let s = quintic((self.now.ns() - m.phase_start_ns) as f64 * 1e-9 / m.arm_duration_s);
                let (sin, cos) = m.line_direction_rad.sin_cos();
                ee + Vector3::new(cos, sin, 0.0) * (m.line_length_m * s)
            });
            let here = self.model.end_effector(&self.q);
            r.ee_error_m = (here - goal).xy().norm();
            r.largest_ee_error_m = r.largest_ee_error_m.max(r.ee_error_m);
            r.ee_turn_deg = (here.z - ee.z).to_degrees();
        }
        let mut record = self.record.clone();
        record.progress = self.command.progress;
        record.q_deg = (0..self.links()).map(|i| self.q[3 + i].to_degrees()).collect();
        record
    }
}

fn quintic(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
}

/// Flies one line from `q_deg` with a controller stepped every `period_s`, and half a second more. Like the reference, the
/// controller has no ramps at the ends of a line and no quiet zone.
pub fn fly(q_deg: &[f64], mission: MissionState, period_s: f64) -> Record {
    let mut world = World::with(q_deg, period_s, |config| {
        (config.centring_ramp_s, config.quiet_m, config.quiet_rad) = (0.0, 0.0, 0.0);
    });
    world.pass(1.0);
    world.begin(mission);
    world.pass(mission.arm_duration_s + 0.6)
}
