//! Base controller: guidance, thruster allocation and modulation.
//!
//! A smooth reference leads from where the base is to the mission's goal; computed-torque control turns the pose error
//! into a wanted wrench with the inertia of base and arm as they stand ([`fss_multibody`]); the allocator finds open shares
//! for one-sided thrusters, the modulator on/off valves. A vehicle that turns is stopped with the least gas by [`stop`]. Where an input is stale, all valves are shut. A mission that
//! excites the vehicle for identification sets the valves itself; the controller then only passes them on.

pub mod allocation;
mod config;
pub mod guidance;
pub mod modulation;
mod program;
pub mod stop;

use allocation::{Allocator, Wrench};
pub use config::{BaseConfig, wrenches};
use fss_bus::{Latest, Output, Service, Time, inputs, outputs};
use fss_messages::parameter::Tuning;
use fss_messages::{
    BaseCommand, Event, LinksState, MAX_THRUSTERS, MissionState, MocapPose, NavState, Parameters, ThrustersCommand,
    topic,
};
use fss_multibody::{Model, State};
use guidance::Leg;
use modulation::Modulator;
pub use program::Config;
use std::f64::consts::TAU;
use stop::{Action, Body, Stop};

/// Oldest navigation state that the controller flies on, ns.
const MAX_NAV_AGE_NS: u64 = 50_000_000;
/// Oldest goal, ns.
const MAX_MISSION_AGE_NS: u64 = 500_000_000;
/// Integral gain over the cube of the bandwidth: slow beside the loop itself.
const INTEGRAL_SHARE: f64 = 0.2;
/// Share of the thrusters that a reference may ask for; the rest is for control.
const ABILITY: f64 = 0.7;
/// A leg that takes longer than the mission gave it by more than this is said, s.
const LATE_S: f64 = 1.0;

inputs! {
    /// What the service reads.
    pub struct Inputs {
        /// Where the base is.
        nav: Latest<NavState> = topic::NAV_STATE,
        /// What navigation saw last, for when it was seen.
        mocap: Latest<MocapPose> = topic::MOCAP_BASE,
        /// Where it shall be.
        mission: Latest<MissionState> = topic::MISSION_STATE,
        /// How the arm stands.
        links: Latest<LinksState> = topic::LINKS_STATE,
        /// How it shall be tuned.
        parameters: Latest<Parameters> = topic::PARAMETERS_COMMAND,
    }
}

outputs! {
    /// What the service writes.
    pub struct Outputs {
        /// The wanted wrench.
        command: Output<BaseCommand> = topic::BASE_COMMAND,
        /// The valves.
        thrusters: Output<ThrustersCommand> = topic::THRUSTERS_COMMAND,
        /// How it is tuned.
        parameters: Output<Parameters> = topic::PARAMETERS_STATE,
        /// Changes of mode.
        events: Output<Event> = topic::EVENTS,
    }
}

/// The wrench in body axes that gives the base this acceleration (table axes) with the arm held as it is.
fn wrench(model: &Model, state: &State, acceleration: [f64; 3]) -> Wrench {
    let force = model.inverse_dynamics(state, &State::from_slices(&acceleration, &[]).q);
    let (sin, cos) = state.q[2].sin_cos();
    [cos * force[0] + sin * force[1], cos * force[1] - sin * force[0], force[2]]
}

/// The leg that is flown, and what of the mission it was made for.
#[derive(Clone, Copy)]
struct Flown {
    phase_start_ns: u64,
    goal: [f64; 3],
    leg: Leg,
}

/// What the base shall do now.
#[derive(Clone, Copy)]
enum Guidance {
    /// This acceleration, table axes.
    Accelerate([f64; 3]),
    /// Valves shut.
    Coast,
    /// This thruster open, from 0.
    Burn(usize),
}

/// How fast a stop damps out what is left, 1/s.
const DAMPING_1_S: f64 = 0.3;

/// The service.
pub struct Base {
    config: BaseConfig,
    allocator: Allocator,
    modulator: Modulator,
    flown: Option<Flown>,
    integral: [f64; 3],
    /// The stop that is under way, and when its phase began.
    stop: Option<(u64, Stop)>,
    /// How long the newest measurement had waited for the step that it came with, ns.
    waited_ns: Option<u64>,
    sample: BaseCommand,
    tuning: Tuning,
}

impl Base {
    /// For a vehicle.
    pub fn new(config: BaseConfig) -> Self {
        let count = config.thruster_wrenches.len();
        let tuning = Tuning::new(Self::NAME, &config.tuned());
        let min_steps = (config.shortest_pulse_s / config.period_s - 1e-6).ceil().max(1.0) as u32;
        Self {
            allocator: Allocator::new(&config.thruster_wrenches),
            modulator: Modulator::new(count, min_steps),
            config,
            flown: None,
            integral: [0.0; 3],
            stop: None,
            waited_ns: None,
            sample: BaseCommand::default(),
            tuning,
        }
    }

    /// Takes what the ground tunes. What the integral holds against a steady force stays what it is.
    fn tune(&mut self, now: Time, inputs: &Inputs, outputs: &mut Outputs) {
        if let Some(wanted) = inputs.parameters.fresh()
            && let Some(values) = self.tuning.follow(now.ns(), wanted, |event| outputs.events.publish(event))
        {
            let was = self.config.bandwidth_rad_s;
            self.config.tune(values);
            self.integral = self.integral.map(|error| error * (was / self.config.bandwidth_rad_s).powi(3));
        }
        if let Some(state) = self.tuning.report(now.ns()) {
            outputs.parameters.publish(state);
        }
    }

    /// The mode that the inputs allow, with the state and the goal to fly.
    fn mode(now: Time, inputs: &Inputs) -> (u8, Option<(&NavState, &MissionState)>) {
        let Some(mission) = inputs.mission.within(now, MAX_MISSION_AGE_NS) else { return (BaseCommand::STALE, None) };
        match mission.base_mode {
            MissionState::BASE_FREE => return (BaseCommand::OFF, None),
            MissionState::BASE_VALVES => return (BaseCommand::OPEN_LOOP, None),
            _ => {}
        }
        match inputs.nav.within(now, MAX_NAV_AGE_NS) {
            Some(nav) if nav.mode != NavState::INITIALISING && nav.mode != NavState::LOST => {
                (BaseCommand::CONTROL, Some((nav, mission)))
            }
            _ => (BaseCommand::STALE, None),
        }
    }

    /// The leg that the mission wants; a new one begins where the base is, and takes the time that the thrusters need.
    fn leg(&mut self, now: Time, state: &State, mission: &MissionState, events: &mut Output<Event>) -> Leg {
        let (phase_start_ns, goal) = (mission.phase_start_ns, mission.base_goal);
        if let Some(flown) = self.flown
            && flown.phase_start_ns == phase_start_ns
            && flown.goal == goal
        {
            return flown.leg;
        }
        let from = [state.q[0], state.q[1], state.q[2]];
        let to: [f64; 3] =
            std::array::from_fn(|i| goal[i] + if mission.base_goal_relative == 0 { 0.0 } else { from[i] });
        // A controller that was restarted within a phase makes the rest of its time do.
        let gone_s = now.seconds_since(Time::from_ns(phase_start_ns));
        let given_s = (mission.base_duration_s - gone_s).max(0.0);
        let drift = mission.base_goal_rate;
        let to = std::array::from_fn(|i| to[i] + drift[i] * gone_s);
        let model = *self.model(mission);
        let leg = Leg { start: now, from, to, duration_s: given_s, drift }.stretched(|reference| {
            let mut there = *state;
            let acceleration = reference.map(|r| r.acceleration / ABILITY);
            for (i, r) in reference.iter().enumerate() {
                (there.q[i], there.v[i]) = (r.position, r.velocity);
            }
            !self.allocator.allocate(wrench(&model, &there, acceleration)).is_saturated()
        });
        if leg.duration_s > given_s + LATE_S && given_s > 0.0 {
            let needed_s = leg.duration_s;
            let message = format_args!("the thrusters need {needed_s:.0} s for this goal, not {given_s:.0} s");
            events.publish(Event::new(now.ns(), Self::NAME, Event::WARNING, message));
        }
        self.flown = Some(Flown { phase_start_ns, goal, leg });
        leg
    }

    /// The vehicle, with the target where the mission says that it is held.
    fn model(&self, mission: &MissionState) -> &Model {
        let held = self.config.compound.as_ref().filter(|_| mission.target_held != 0);
        held.unwrap_or(&self.config.model)
    }

    /// What the mission's goal asks for now.
    fn guide(&mut self, now: Time, state: &State, mission: &MissionState, events: &mut Output<Event>) -> Guidance {
        if mission.base_mode != MissionState::BASE_STOP {
            self.stop = None;
            let leg = self.leg(now, state, mission, events);
            return Guidance::Accelerate(self.acceleration(now, &leg, state));
        }
        self.flown = None;
        self.integral = [0.0; 3];
        let body = Body::of(self.model(mission), state);
        let of_this_phase = self.stop.filter(|(phase_start_ns, _)| *phase_start_ns == mission.phase_start_ns);
        let (_, stop) = self.stop.insert(of_this_phase.unwrap_or((mission.phase_start_ns, Stop::default())));
        let rates = [state.v[0], state.v[1], state.v[2]];
        (self.sample.reference, self.sample.error) = ([state.q[0], state.q[1], state.q[2]], rates);
        match stop.step(&body, &self.config.thruster_wrenches, self.config.period_s) {
            Action::Coast => Guidance::Coast,
            Action::Burn(thruster) => Guidance::Burn(thruster),
            Action::Damp => {
                let damped = |i: usize| -beyond(DAMPING_1_S * rates[i], self.config.dead_band[i]);
                Guidance::Accelerate(std::array::from_fn(damped))
            }
        }
    }

    /// The acceleration that leads along the leg, table axes.
    fn acceleration(&mut self, now: Time, leg: &Leg, state: &State) -> [f64; 3] {
        let c = &self.config;
        let (w, z) = (c.bandwidth_rad_s, c.damping_ratio);
        let mut acceleration = [0.0; 3];
        for (i, r) in leg.at(now).iter().enumerate() {
            let apart = state.q[i] - r.position;
            // A navigation that was restarted has forgotten its whole turns.
            let error = if i == 2 { apart - TAU * (apart / TAU).round() } else { apart };
            // The integral holds against a tilted table. It is slow, and stops where the thrusters are at their end and
            // where the spring would do nothing: an integral that goes on there makes a limit cycle.
            if self.sample.saturated == 0 {
                self.integral[i] += beyond(error, c.dead_band[i] / (w * w)) * c.period_s;
            }
            let spring_and_damper = -w * w * error - 2.0 * z * w * (state.v[i] - r.velocity);
            let against_a_steady_force = -INTEGRAL_SHARE * w * w * w * self.integral[i];
            acceleration[i] = r.acceleration + beyond(spring_and_damper, c.dead_band[i]) + against_a_steady_force;
            self.sample.reference[i] = r.position;
            self.sample.error[i] = error;
        }
        acceleration
    }
}

/// The vehicle as navigation and telemetry know it.
fn vehicle_state(nav: &NavState, links: Option<&LinksState>, link_count: usize) -> State {
    let mut state = State::from_slices(&[nav.x_m, nav.y_m, nav.theta_rad], &[nav.vx_m_s, nav.vy_m_s, nav.omega_rad_s]);
    if let Some(links) = links {
        for (slot, angle) in state.q.iter_mut().skip(3).take(link_count).zip(links.q_rad) {
            *slot = angle;
        }
    }
    state
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
        self.tune(now, inputs, outputs);
        self.waited_ns = inputs.mocap.fresh().map(|pose| now.age_ns(pose.received_ns));
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
            let state = vehicle_state(nav, inputs.links.get(), self.config.model.link_count());
            let guidance = self.guide(now, &state, mission, &mut outputs.events);
            let wrench = match guidance {
                Guidance::Accelerate(wanted) => wrench(self.model(mission), &state, wanted),
                Guidance::Coast | Guidance::Burn(_) => [0.0; 3],
            };
            let allocation = self.allocator.allocate(wrench);
            let s = &mut self.sample;
            [s.force_x_n, s.force_y_n, s.torque_nm] = wrench;
            s.duty_cycle = allocation.duty;
            s.saturated = u8::from(allocation.is_saturated());
            valves.valves = self.modulator.step(&allocation.duty);
            if let Guidance::Burn(thruster) = guidance
                && let Some(valve) = valves.valves.get_mut(thruster)
            {
                *valve = 1;
            }
            // The measurement's own time travels on: the age of a measurement when its valve command leaves.
            valves.stamp_ns = nav.stamp_ns;
        } else {
            self.flown = None;
            self.integral = [0.0; 3];
            self.stop = None;
            self.modulator.reset();
            let s = &mut self.sample;
            (s.force_x_n, s.force_y_n, s.torque_nm) = (0.0, 0.0, 0.0);
            s.duty_cycle = Default::default();
            s.saturated = 0;
            if let Some(mission) = inputs.mission.get().filter(|_| mode == BaseCommand::OPEN_LOOP) {
                let count = self.config.thruster_wrenches.len().min(MAX_THRUSTERS);
                valves.valves[..count].copy_from_slice(&mission.valves[..count]);
            }
        }
        outputs.command.publish(self.sample);
        outputs.thrusters.publish(valves);
    }

    fn waited_ns(&self) -> Option<u64> {
        self.waited_ns
    }
}
