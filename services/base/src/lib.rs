//! Base controller: guidance, thruster allocation and modulation.
//!
//! A smooth reference leads from where the base is to the mission's goal; computed-torque control turns the pose error
//! into a wanted wrench with the inertia of base and arm as they stand ([`fss_multibody`]); the allocator finds open shares
//! for one-sided thrusters, the modulator on/off valves. Where an input is stale, all valves are shut.

pub mod allocation;
pub mod guidance;
pub mod modulation;

use allocation::{Allocator, Wrench};
use fss_bus::{Latest, Output, Service, Time, inputs, outputs};
use fss_messages::{BaseCommand, Event, LinksState, MissionState, NavState, ThrustersCommand, topic};
use fss_multibody::{Model, State};
use fss_plant::Plant;
use guidance::{Reference, quintic};
use modulation::Modulator;

/// Oldest navigation state that the controller flies on, ns.
const MAX_NAV_AGE_NS: u64 = 50_000_000;
/// Oldest goal, ns.
const MAX_MISSION_AGE_NS: u64 = 500_000_000;
/// Integral gain over the cube of the bandwidth: slow beside the loop itself.
const INTEGRAL_SHARE: f64 = 0.1;
/// Share of a wanted wrench that may be missing before the controller calls itself saturated.
const SATURATED: f64 = 0.05;

inputs! {
    /// What the service reads.
    pub struct Inputs {
        /// Where the base is.
        nav: Latest<NavState> = topic::NAV_STATE,
        /// Where it shall be.
        mission: Latest<MissionState> = topic::MISSION_STATE,
        /// How the arm stands.
        links: Latest<LinksState> = topic::LINKS_STATE,
    }
}

outputs! {
    /// What the service writes.
    pub struct Outputs {
        /// The wanted wrench.
        command: Output<BaseCommand> = topic::BASE_COMMAND,
        /// The valves.
        thrusters: Output<ThrustersCommand> = topic::THRUSTERS_COMMAND,
        /// Changes of mode.
        events: Output<Event> = topic::EVENTS,
    }
}

/// What the controller is told.
#[derive(Clone, Debug)]
pub struct BaseConfig {
    /// The vehicle with its arm.
    pub model: Model,
    /// Wrench of each thruster in body axes about the base frame's origin, N and N m.
    pub thruster_wrenches: Vec<Wrench>,
    /// Shortest time for which a valve opens, s.
    pub min_on_s: f64,
    /// The controller's period, s.
    pub period_s: f64,
    /// Bandwidth of the pose loop, rad/s.
    pub bandwidth_rad_s: f64,
    /// Damping ratio of the pose loop.
    pub damping_ratio: f64,
    /// Wanted accelerations below which nothing is done: m/s2, m/s2, rad/s2.
    pub dead_band: [f64; 3],
}

impl BaseConfig {
    /// For a plant, stepped `rate_hz` times a second.
    pub fn from_plant(plant: &Plant, model: Model, rate_hz: f64) -> Self {
        Self {
            model,
            thruster_wrenches: (0..plant.thrusters.len()).map(|i| plant.thruster_wrench(i)).collect(),
            min_on_s: plant.valves.min_on_s,
            period_s: 1.0 / rate_hz,
            bandwidth_rad_s: 0.45,
            damping_ratio: 1.0,
            dead_band: [5e-4, 5e-4, 1e-3],
        }
    }
}

/// From where to where the base goes.
#[derive(Clone, Copy, PartialEq)]
struct Leg {
    start: Time,
    from: [f64; 3],
    to: [f64; 3],
    duration_s: f64,
}

/// The service.
pub struct Base {
    config: BaseConfig,
    allocator: Allocator,
    modulator: Modulator,
    leg: Option<Leg>,
    integral: [f64; 3],
    sample: BaseCommand,
}

impl Base {
    /// For a vehicle.
    pub fn new(config: BaseConfig) -> Self {
        let count = config.thruster_wrenches.len();
        let min_steps = (config.min_on_s / config.period_s - 1e-6).ceil().max(1.0) as u32;
        Self {
            allocator: Allocator::new(&config.thruster_wrenches),
            modulator: Modulator::new(count, min_steps),
            config,
            leg: None,
            integral: [0.0; 3],
            sample: BaseCommand::default(),
        }
    }

    /// The mode that the inputs allow, with the state and the goal to fly.
    fn mode(now: Time, inputs: &Inputs) -> (u8, Option<(&NavState, &MissionState)>) {
        let Some(mission) = inputs.mission.within(now, MAX_MISSION_AGE_NS) else { return (BaseCommand::STALE, None) };
        if mission.base_mode == MissionState::BASE_FREE {
            return (BaseCommand::OFF, None);
        }
        match inputs.nav.within(now, MAX_NAV_AGE_NS) {
            Some(nav) if nav.mode != NavState::INITIALISING && nav.mode != NavState::LOST => {
                (BaseCommand::CONTROL, Some((nav, mission)))
            }
            _ => (BaseCommand::STALE, None),
        }
    }

    /// The leg that the mission wants; a new one begins where the base is.
    fn leg(&mut self, now: Time, nav: &NavState, mission: &MissionState) -> Leg {
        let here = [nav.x_m, nav.y_m, nav.theta_rad];
        let to =
            std::array::from_fn(|i| mission.base_goal[i] + if mission.base_goal_relative == 0 { 0.0 } else { here[i] });
        let start = Time::from_ns(mission.phase_start_ns);
        match self.leg {
            Some(leg) if leg.start == start && (leg.to == to || mission.base_goal_relative != 0) => leg,
            _ => {
                // A controller that was restarted within a phase makes the rest of its time do.
                let gone_s = now.seconds_since(start);
                let duration_s = (mission.base_duration_s - gone_s).max(0.0);
                let leg = Leg { start, from: here, to, duration_s };
                *self.leg.insert(leg)
            }
        }
    }

    /// The wanted wrench in body axes.
    fn wrench(&mut self, now: Time, leg: &Leg, nav: &NavState, links: Option<&LinksState>) -> Wrench {
        let c = &self.config;
        let (w, z) = (c.bandwidth_rad_s, c.damping_ratio);
        let pose = [nav.x_m, nav.y_m, nav.theta_rad];
        let rate = [nav.vx_m_s, nav.vy_m_s, nav.omega_rad_s];
        let t_s = now.seconds_since(leg.start);
        let mut acceleration = [0.0; 3];
        for i in 0..3 {
            let r: Reference = quintic(leg.from[i], leg.to[i], leg.duration_s, t_s);
            let error = pose[i] - r.position;
            // The integral holds against a tilted table; it is slow, and stops where the thrusters are at their end.
            if self.sample.saturated == 0 {
                self.integral[i] += error * c.period_s;
            }
            let spring_and_damper = -w * w * error - 2.0 * z * w * (rate[i] - r.velocity);
            let against_a_steady_force = -INTEGRAL_SHARE * w * w * w * self.integral[i];
            acceleration[i] = r.acceleration + beyond(spring_and_damper, c.dead_band[i]) + against_a_steady_force;
            self.sample.reference[i] = r.position;
            self.sample.error[i] = error;
        }
        let mut q = State::zero();
        q.q[2] = nav.theta_rad;
        if let Some(links) = links {
            let n = c.model.link_count();
            for (slot, angle) in q.q.iter_mut().skip(3).take(n).zip(links.q_rad) {
                *slot = angle;
            }
        }
        let inertia = c.model.mass_matrix(&q.q);
        let force: [f64; 3] = std::array::from_fn(|i| (0..3).map(|j| inertia[(i, j)] * acceleration[j]).sum::<f64>());
        let (sin, cos) = nav.theta_rad.sin_cos();
        [cos * force[0] + sin * force[1], cos * force[1] - sin * force[0], force[2]]
    }
}

/// What of `value` lies beyond a dead band.
fn beyond(value: f64, dead_band: f64) -> f64 {
    value - value.clamp(-dead_band, dead_band)
}

impl Service for Base {
    type Inputs = Inputs;
    type Outputs = Outputs;
    const NAME: &'static str = "base";

    fn step(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        let (mode, flown) = Self::mode(now, inputs);
        if self.sample.mode == BaseCommand::CONTROL && mode == BaseCommand::STALE {
            let message = format_args!("navigation or mission is stale: thrusters shut");
            outputs.events.publish(Event::new(now.ns(), Self::NAME, Event::WARNING, message));
        }
        self.sample.mode = mode;
        self.sample.stamp_ns = now.ns();
        let mut valves = ThrustersCommand {
            stamp_ns: now.ns(),
            valve_count: self.config.thruster_wrenches.len() as u32,
            ..ThrustersCommand::default()
        };
        if let Some((nav, mission)) = flown {
            let leg = self.leg(now, nav, mission);
            let wrench = self.wrench(now, &leg, nav, inputs.links.get());
            let allocation = self.allocator.allocate(wrench);
            let s = &mut self.sample;
            [s.force_x_n, s.force_y_n, s.torque_nm] = wrench;
            s.duty_cycle = allocation.duty;
            s.saturated = u8::from(allocation.missing > SATURATED && allocation.duty.iter().any(|&u| u >= 1.0));
            valves.valves = self.modulator.step(&allocation.duty);
            // The measurement's own time travels on: the age of a measurement when its valve command leaves.
            valves.stamp_ns = nav.stamp_ns;
        } else {
            self.leg = None;
            self.integral = [0.0; 3];
            self.modulator.reset();
            let s = &mut self.sample;
            (s.force_x_n, s.force_y_n, s.torque_nm) = (0.0, 0.0, 0.0);
            s.duty_cycle = Default::default();
            s.saturated = 0;
        }
        outputs.command.publish(self.sample);
        outputs.thrusters.publish(valves);
    }
}
